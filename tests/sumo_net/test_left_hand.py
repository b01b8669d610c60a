"""A network where traffic keeps left is the mirror image of one where it keeps right, markings and all."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.road_networks import _both, _edge, _node, netconvert
from sumo_net import lane_graph
from sumo_net.road import RoadNetwork
from sumo_net.road_marking import Markings
from sumo_net.roadside import PARKED, Roadside, place

BUS_LANE = '<lane index="0" allow="bus"/><lane index="1" width="2.9"/><lane index="2" width="3.5"/>'


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Keeping right, and the same upside down keeping left."""
    folder, files = tmp_path_factory.mktemp("sides"), []
    for name, sign in (("right", 1), ("left", -1)):
        nodes = [
            _node("a", 0, 0),
            _node("b", 300, sign * 40),
            _node("c", 600, 0),
            _node("d", 300, sign * 300),
        ]
        edges = [*_both("ab", "a", "b"), _edge("bc", "b", "c", 3, inside=BUS_LANE)]
        edges += [_edge("cb", "c", "b", 2), *_both("bd", "b", "d", 2)]
        files.append(folder / f"{name}.net.xml")
        more = ["--lefthand"] if name == "left" else []
        netconvert(nodes, edges, "--offset.disable-normalization", *more)(files[-1])
    return files[0], files[1]


def test_lanes_are_counted_from_the_right(both: tuple[Path, Path]) -> None:
    for file, order in zip(both, (["bc_0", "bc_1", "bc_2"], ["bc_2", "bc_1", "bc_0"]), strict=True):
        graph = lane_graph.read(file)
        assert graph.edges["bc"].lanes == order
        assert [graph.lanes[lane].index for lane in order] == [0, 1, 2]


@pytest.mark.parametrize(
    "lane", ["ab_0", "ab_back_0", "bc_0", "bc_1", "bc_2", "cb_0", "cb_1", "bd_0", "bd_1"]
)
def test_markings_are_mirrored(both: tuple[Path, Path], lane: str) -> None:
    right, left = (Markings(lane_graph.read(file), 0.5, 0.5).section(lane) for file in both)
    kept, mirrored = (np.isfinite(section.border_offset_m) for section in (right, left))
    assert kept.sum() >= 2
    order = np.argsort(-right.border_offset_m[kept])  # slots run from right to left
    assert left.border_offset_m[mirrored] == pytest.approx(-right.border_offset_m[kept][order])
    assert left.border_kind[mirrored].tolist() == right.border_kind[kept][order].tolist()
    assert (left.road_left_m, left.road_right_m) == pytest.approx((-right.road_right_m, -right.road_left_m))


def test_the_road_turns_the_other_way(both: tuple[Path, Path]) -> None:
    drawn = []
    for file in both:
        roads = RoadNetwork.from_net_file(file)
        path = roads.path("bc_1", ("bc",), "ab_0")
        table, first = roads.table, roads.table.first_sample[path]
        own = np.array([table.own_start_m[path] + 20.0, table.own_end_m[path] - 20.0]) / table.spacing_m[path]
        part = slice(first + int(own[0]), first + int(own[1]))
        at = np.linspace(330.0, 560.0, 24)
        drawn.append([np.interp(at, table.x_m[part], y[part]) for y in (table.y_m, table.heading_rad)])
    assert drawn[1][0] == pytest.approx(-drawn[0][0], abs=0.02)
    assert drawn[1][1] == pytest.approx(-drawn[0][1], abs=1e-3)


def test_cars_park_where_traffic_keeps(both: tuple[Path, Path]) -> None:
    roadside = Roadside(post_spacing_m=0, rail_side="none", rail_spacing_m=0, parked_per_km=20)
    right, left = (place(roadside, lane_graph.read(file)) for file in both)
    cars = [side for side in (right, left) if (side.length_m == PARKED[0]).all()]
    assert len(cars) == 2
    assert len(right.x_m) == len(left.x_m) > 3
    assert np.sort(left.y_m) == pytest.approx(np.sort(-right.y_m), abs=0.3)
