"""Posts, rails and parked cars beside the road: where they stand, and where they do not."""

from pathlib import Path

import numpy as np
import pytest

from sumo_net import lane_graph
from sumo_net.highway import Highway
from sumo_net.network import build
from sumo_net.road import RoadNetwork
from sumo_net.road_kernels import project, station_of
from sumo_net.roadside import POST, Roadside, RoadsideTable, place

NET = """<net>
 <edge id="ab" from="a" to="b"><lane id="ab_0" index="0" length="400" width="3.5" shape="0,-5.25 400,-5.25"/>
  <lane id="ab_1" index="1" length="400" width="3.5" shape="0,-1.75 400,-1.75"/></edge>
 {more}
</net>"""
BACK = (
    '<edge id="ba" from="b" to="a">'
    '<lane id="ba_0" index="0" length="400" width="3.5" shape="400,1.75 0,1.75"/></edge>'
)


def lay(folder: Path, roadside: Roadside, more: str = "") -> RoadsideTable:
    (folder / "n.net.xml").write_text(NET.format(more=more))
    return place(roadside, lane_graph.read(folder / "n.net.xml"), 0.5, 0.5)


ONLY_POSTS = Roadside(rail_spacing_m=0, parked_per_km=0)


def test_posts_by_hand(tmp_path: Path) -> None:
    table = lay(tmp_path, ONLY_POSTS)
    right, left = table.y_m < 0, table.y_m > 0
    assert table.x_m[right].tolist() == pytest.approx([25.0 + 50.0 * k for k in range(8)])
    assert table.y_m[right] == pytest.approx(np.full(8, -7.0 - 0.5 - 0.5))
    assert table.y_m[left] == pytest.approx(np.full(8, 0.5 + 0.5))
    assert (np.diff(table.x_m) >= 0).all()
    assert len(set(table.handle.tolist())) == 16
    assert table.handle.max() == -2
    assert (table.height_m == POST[2]).all()


def test_nothing_stands_between_the_directions_of_an_undivided_road(tmp_path: Path) -> None:
    table = lay(tmp_path, Roadside(rail_side="both", parked_per_km=20), BACK)
    assert (np.abs(table.y_m) > 3.5).all()
    cars = table.length_m > 2
    assert cars.sum() >= 4
    assert {*np.round(np.abs(table.y_m[cars]), 6)} <= {round(7.0 + 0.35 + 0.9, 6), round(3.5 + 0.35 + 0.9, 6)}


def test_nothing_asked_for_nothing_laid(tmp_path: Path) -> None:
    assert len(lay(tmp_path, Roadside(post_spacing_m=0, rail_spacing_m=0, parked_per_km=0)).handle) == 0


def test_same_seed_same_places(tmp_path: Path) -> None:
    a, b = (lay(tmp_path, Roadside(parked_per_km=20)) for _ in range(2))
    c = lay(tmp_path, Roadside(parked_per_km=20, seed=2))
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)
    assert len(a.x_m) != len(c.x_m) or (a.x_m != c.x_m).any()


def test_the_built_highway_is_lined_all_along(tmp_path: Path) -> None:
    highway = Highway()
    built = build(highway, tmp_path)
    roads = RoadNetwork.from_highway(built)
    table = place(Roadside(), roads.graph, highway.shoulder_right_m, highway.shoulder_left_m)
    edge = built.carriageways[0].edges[1]
    path = roads.path(f"{edge}_0", built.carriageways[0].edges[1:])
    lane = roads.graph.lanes[f"{edge}_0"]
    outside = -0.5 * lane.width_m - highway.shoulder_right_m - 0.5
    distances = []
    for x, y, length in zip(table.x_m, table.y_m, table.length_m, strict=True):
        if np.hypot(*(lane.shape - [x, y]).T).min() < 150.0 and length == POST[0]:
            _, d = project(roads.table, path, x, y, station_of(roads.table, path, 0.5 * lane.length_m))
            distances.append(d)
    near = np.abs(np.array(distances) - outside)
    assert np.sort(near)[:3] == pytest.approx([0.0] * 3, abs=0.02)
    total = sum(roads.graph.lanes[f"{e}_0"].length_m for way in built.carriageways for e in way.edges)
    assert (table.length_m == POST[0]).sum() == pytest.approx(2 * total / 50.0, rel=0.05)
