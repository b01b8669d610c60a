"""Overtaking on the lane of the opposite direction: the vehicle's own way stays one drive."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.road_networks import _both, _edge, _node, netconvert
from sumo_net import lane_graph
from sumo_net.driver import CAUSES
from sumo_net.ego import Ego
from sumo_net.lane_changes import LaneChanges
from sumo_net.opposite import OppositeLanes
from sumo_net.road import RoadNetwork
from sumo_net.road_kernels import pose_at
from sumo_net.road_table import OWN_RIGHT
from sumo_net.traffic import Traffic

ROUTES = """<routes>
<vType id="lorry" vClass="truck" maxSpeed="6" length="12" sigma="0"/>
<vType id="car" vClass="passenger" lcOpposite="2" lcAssertive="1" sigma="0"/>
<vehicle id="slow" type="lorry" depart="0" departPos="150" departSpeed="max"><route edges="am mb"/></vehicle>
<vehicle id="other" type="lorry" depart="0" departSpeed="max"><route edges="bm ma"/></vehicle>
<vehicle id="fast" type="car" depart="1" departSpeed="max"><route edges="am mb"/></vehicle>
</routes>"""


@pytest.fixture(scope="module", params=["right", "left"])
def rural(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slightly bent road of two lanes, one in each direction, with a junction amid the overtaking."""
    file = tmp_path_factory.mktemp("rural") / "rural.net.xml"
    rest = [(320, 0), (500, 0), (700, 5), (1000, 20), (2500, 95)]
    shape = " ".join(f"{x},{y}" for x, y in rest)
    back = " ".join(f"{x},{y}" for x, y in reversed(rest))
    edges = [_edge("am", "a", "m", more='priority="9"'), _edge("ma", "m", "a", more='priority="9"')]
    edges += [_edge("mb", "m", "b", more=f'priority="9" shape="{shape}"')]
    edges += [_edge("bm", "b", "m", more=f'priority="9" shape="{back}"')]
    nodes = [_node("a", 0, 0), _node("m", 320, 0), _node("b", 2500, 95), _node("side", 320, -200)]
    hand = ("--lefthand",) if request.param == "left" else ()
    netconvert(nodes, [*edges, *_both("side", "side", "m")], "--opposites.guess", *hand)(file)
    return file


def run(file: Path, equipped: bool) -> pd.DataFrame:
    """Truth of all vehicles over 60 s, and snapshots; `equipped`: lateral motion is written to SUMO."""
    routes = file.with_suffix(".rou.xml")
    routes.write_text(ROUTES)
    command = ["-n", str(file), "-r", str(routes), "--step-length", "0.1", "--no-step-log", "true"]
    rows = []
    with Traffic.start(command) as traffic:
        roads = RoadNetwork.from_net_file(file)
        ego, opposite = Ego(roads, traffic, 1), OppositeLanes(roads.graph, traffic)
        changes = LaneChanges(roads.graph, traffic.lane_ids)
        for step in range(600):
            traffic.step()
            snapshot = opposite.step(traffic.snapshot())
            truth = ego.step(snapshot, np.ones(len(snapshot.handle), np.bool_))
            if equipped:
                traffic.write_lateral(truth.handle, opposite.of_lane(truth.handle, ego.front_lateral_m()))
            seen = changes.step(snapshot, np.zeros(len(snapshot.handle), np.bool_))
            there = {"sumo_x_m": snapshot.x_m, "sumo_y_m": snapshot.y_m, "seen_y_m": seen.y_m}
            names = [traffic.vehicle_id(handle) for handle in truth.handle.tolist()]
            lanes = [traffic.lane_ids[lane] for lane in snapshot.lane.tolist()]
            rows.append(pd.DataFrame(truth._asdict() | there).assign(step=step, id=names, lane=lanes))
    return pd.concat(rows)


@pytest.fixture(scope="module")
def drive(rural: Path) -> pd.DataFrame:
    """A drive of equipped vehicles."""
    return run(rural, True)


def test_the_lane_is_the_other_one_driven_the_other_way(rural: Path) -> None:
    roads = RoadNetwork.from_net_file(rural)
    assert {"am_0", "ma_0", "mb_0", "bm_0"} <= set(roads.graph.against)
    with_it, against = roads.path("bm_0"), roads.path("bm_0 against", ("mb",), "mb_0")
    table = roads.table
    own_m = table.own_end_m[with_it] - table.own_start_m[with_it]
    for s in (100.0, 600.0, own_m - 100.0):
        x, y, heading, curvature = pose_at(table, with_it, table.own_start_m[with_it] + s)
        there = pose_at(table, against, table.own_end_m[against] - s)
        assert there[:2] == pytest.approx((x, y), abs=0.01)
        assert (there[2] - heading) % (2 * np.pi) == pytest.approx(np.pi, abs=1e-3)
        assert there[3] == pytest.approx(-curvature, abs=1e-4)
    own = [table.border_offset_m[table.first_segment[path], OWN_RIGHT:][:2] for path in (with_it, against)]
    assert own[0] == pytest.approx([-1.6, 1.6])
    assert own[1] == pytest.approx([-1.6, 1.6])
    kinds = [
        table.border_kind[table.first_segment[path], OWN_RIGHT:][:2].tolist() for path in (with_it, against)
    ]
    assert kinds[0] == kinds[1][::-1]
    assert len(set(kinds[0])) == 2


def test_the_overtaking_car_drives_on(drive: pd.DataFrame) -> None:
    car = drive[drive["id"] == "fast"]
    against = car[car["lane"].str.endswith(" against")]
    assert len(against) > 30
    assert against["lane"].str.startswith(":m").any()
    assert car["lane"].iloc[-1] == "mb_0"
    moved = np.hypot(car["x_m"].diff(), car["y_m"].diff())
    assert (moved - 0.1 * car["speed_mps"]).abs().max() < 0.1
    assert car["heading_rad"].abs().max() < 0.3
    assert car["yaw_rate_rps"].abs().max() < 0.3


def test_it_is_where_sumo_has_it(drive: pd.DataFrame) -> None:
    car = drive[drive["id"] == "fast"].reset_index()
    bumper_m = np.median(car["sumo_x_m"] - car["x_m"])
    assert (car["sumo_x_m"] - car["x_m"] - bumper_m).abs().max() < 0.5
    # SUMO's lateral position is that of the step before; where it changes lanes, the middle of the new one
    stays = car["lane"] == car["lane"].shift()
    bumper_y_m = car["y_m"] + bumper_m * np.sin(car["heading_rad"])
    assert (car["sumo_y_m"] - bumper_y_m)[stays].abs().max() < 0.4


def test_both_changes_are_lane_changes(drive: pd.DataFrame, rural: Path) -> None:
    car = drive[drive["id"] == "fast"]
    changing = car[car["signal"] != 0]
    side = -1 if lane_graph.read(rural).left_hand else 1
    assert changing["signal"].iloc[0] == side
    assert changing["signal"].iloc[-1] == -side
    assert {CAUSES[cause] for cause in changing["cause"]} == {"lane_change_signalled"}


def test_others_see_the_change_of_a_vehicle_that_is_not_equipped_spread_over_time(rural: Path) -> None:
    car = run(rural, False).query("id == 'fast'")
    assert car["sumo_y_m"].diff().abs().max() > 3.0
    assert car["seen_y_m"].diff().abs().max() < 0.4


def test_who_does_not_overtake_stays_on_lanes_in_their_direction(drive: pd.DataFrame) -> None:
    lanes = drive.groupby("id")["lane"].unique()
    assert len(lanes["slow"]) == 3
    assert lanes["slow"][1].startswith(":m")  # across the junction
    assert not any(lane.endswith(" against") for lane in (*lanes["slow"], *lanes["other"]))
