"""Where a trip begins: SUMO puts the vehicle right behind a junction, often at full speed."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.road_networks import netgenerate
from sumo_net.driver import CAUSES, Driver
from sumo_net.ego import Ego
from sumo_net.road import RoadNetwork
from sumo_net.traffic import Traffic
from tests.true_drives import all_equipped

# entered from the corner by a turn alone, from the middle by both, and straight on
TRIPS = (("C2B2", "B2A2"), ("C1B1", "B1A1"), ("A0A1", "A1A2"), ("B1B0", "B0A0"), ("B1C1", "C1C2"))


@pytest.fixture(scope="module", params=["right", "left"])
def begun(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Truth of the first 3 s of trips that begin at the start of an edge, at SUMO's full speed."""
    net_file: Path = tmp_path_factory.mktemp("grid") / "grid.net.xml"
    hand = ("--lefthand",) if request.param == "left" else ()
    netgenerate("--grid", "--grid.number", "3", "--grid.length", "200", "-L", "2", *hand)(net_file)
    trips = "".join(
        f'<trip id="{k}{lane}" depart="0" from="{a}" to="{b}" departLane="{lane}" departSpeed="max"/>'
        for k, (a, b) in enumerate(TRIPS)
        for lane in (0, 1)
    )
    return all_equipped(net_file, trips, 30)


def test_who_begins_behind_a_corner_has_not_turned_round_it(begun: pd.DataFrame) -> None:
    keeping = begun[begun["cause"] == CAUSES.index("lane_keeping")]
    assert keeping["handle"].nunique() == 2 * len(TRIPS)
    drift = keeping["lane_offset_m"] - keeping.groupby("handle")["lane_offset_m"].transform("first")
    assert drift.abs().max() < 0.6  # lane keeping sways; it was 2.0 m, out of the lane
    assert keeping["yaw_rate_rps"].abs().max() < 0.08


def test_who_is_teleported_out_of_a_junction_has_not_turned_there_at_full_speed(tmp_path: Path) -> None:
    """SUMO puts a vehicle that stood in a junction for too long behind it, at the speed limit."""
    net_file, routes = tmp_path / "grid.net.xml", tmp_path / "grid.rou.xml"
    netgenerate("--grid", "--grid.number", "3", "--grid.length", "200", "-L", "2")(net_file)
    routes.write_text('<routes><trip id="car" depart="0" from="A1B1" to="B1B0"/></routes>')
    command = ["-n", str(net_file), "-r", str(routes), "--step-length", "0.1", "--no-step-log", "true"]
    command += ["--time-to-teleport", "1", "--no-warnings", "true"]
    rows, stood = [], 0
    with Traffic.start(command) as traffic:
        ego = Ego(RoadNetwork.from_net_file(net_file), traffic, 1, Driver(distraction_per_min=0.0))
        for _ in range(400):
            traffic.step()
            snapshot = traffic.snapshot()
            truth = ego.step(snapshot, np.ones(len(snapshot.handle), np.bool_))
            traffic.write_lateral(truth.handle, ego.front_lateral_m())
            lanes = [traffic.lane_ids[lane] for lane in snapshot.lane.tolist()]
            if lanes and lanes[0].startswith(":"):
                traffic.vehicles.setSpeed("car", 0.0)
                stood += 1
            rows.append(pd.DataFrame(truth._asdict()).assign(lane=lanes))
            if lanes and lanes[0].startswith("B1B0"):
                traffic.vehicles.setSpeed("car", -1.0)
    after = pd.concat(rows).query("lane.str.startswith('B1B0')").head(20)
    assert stood > 10
    assert after["speed_mps"].iloc[0] > 10.0
    drift = after["lane_offset_m"] - after["lane_offset_m"].iloc[0]
    assert drift.abs().max() < 0.2  # it was 1.6 m, half out of the lane
    assert after["yaw_rate_rps"].abs().max() < 0.08
