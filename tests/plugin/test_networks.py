"""Runs on generated networks with all vehicle classes; `make networks` has more."""

import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.simulate import simulate
from benchmarks.networks import faults
from benchmarks.road_networks import write_scenario
from plugin import DriverAssistance
from sumo_net.traffic import TrafficError

NAMES = ("random_acute", "roundabout_left", "hairpins", "tracks")
STRAIGHT_ON = """<routes><vType id="car"><param key="has.adas.device" value="true"/></vType>
<trip id="out" type="car" depart="0" from="wm" to="em_back" departPos="60" departSpeed="max"/>
<trip id="back" type="car" depart="0" from="em" to="wm_back" departPos="60" departSpeed="max"/></routes>"""


def driven(
    name: str, folder: Path, duration_s: float = 6.0, trips: int = 18, routes: str | None = None
) -> pd.DataFrame:
    source = write_scenario(name, folder, duration_s, trips)
    if routes is not None:
        (folder / f"{name}.rou.xml").write_text(routes)
    simulate(str(source), folder / "out", duration_s=duration_s, fraction=0.2, quiet=True, seed=1, threads=1)
    return pd.read_csv(folder / "out" / "steps.csv", low_memory=False)


@pytest.mark.parametrize("name", NAMES)
def test_a_run_ends_and_what_is_not_known_is_empty(name: str, tmp_path: Path) -> None:
    steps = driven(name, tmp_path)
    assert steps["vehicle_id"].nunique() > 5
    assert faults(steps) == []
    assert steps["lane_locked"].any()
    tracks = pd.read_csv(tmp_path / "out" / "tracks.csv", low_memory=False)
    targets = steps[steps["fcw_track_id"].notna()].rename(columns={"fcw_track_id": "track_id"})
    found = targets.merge(tracks, on=["vehicle_id", "time_s", "track_id"])
    assert len(found) == len(targets)  # posts as well
    given = {f"{name}.{end}" for end in ("net.xml", "rou.xml", "sumocfg", "net.node.xml", "net.edge.xml")}
    assert {file.name for file in tmp_path.iterdir()} <= {"out", *given}  # nothing beside the user's files


def test_in_the_middle_of_a_junction_as_wide_as_a_square_no_lane_is_seen(tmp_path: Path) -> None:
    steps = driven("wide_junction", tmp_path, duration_s=20.0, routes=STRAIGHT_ON)
    assert faults(steps) == []
    # 120 m across; the markings beyond come into view some 55 m before them
    past_centre_m = np.where(steps["vehicle_id"] == "out", 1.0, -1.0) * (steps["true_x_m"] - 250.0)
    inside = (past_centre_m > -42.0) & (past_centre_m < 0.0)
    assert inside.sum() > 50
    assert not steps["on_marked_road"][inside].any()
    assert not steps["lane_locked"][inside].any()
    assert set(steps["ldw_state"][inside]) == {"lane not seen"}
    before = past_centre_m < -75.0
    assert steps["lane_locked"][before].mean() > 0.9


def test_a_fault_is_found() -> None:
    row = {"time_s": 0.1, "speed_mps": np.nan, "lane_locked": False, "lateral_offset_m": 0.3, "tlc_s": 1.0}
    row |= {"ldw_state": "lane not seen", "lateral_speed_mps": np.inf}
    steps = pd.DataFrame([row]).reindex(columns=[*row, *_others(row)])
    found = " ".join(faults(steps))
    for words in (
        "speed_mps is empty",
        "lateral_speed_mps is infinite",
        "lateral_offset_m is there",
        "and yet",
    ):
        assert words in found


def _others(row: dict[str, object]) -> list[str]:
    from benchmarks.networks import ALWAYS, SEEN

    return [name for name in (*ALWAYS, *SEEN, "left_c", "right_c") if name not in row]


def test_attached_to_libsumo_and_to_traci_the_tables_are_the_same(tmp_path: Path) -> None:
    import libsumo
    import sumolib
    import traci

    source = write_scenario("left_hand", tmp_path, 5.0, 20)
    command = ["-c", str(source), "--no-step-log", "true", "--no-warnings", "true"]

    def loop(simulation: object) -> pd.DataFrame:
        with DriverAssistance.attach(simulation, equip=0.2, seed=3, threads=1) as adas:
            for _ in range(40):
                simulation.simulationStep()  # type: ignore[attr-defined]
                adas.step()
        return adas.tables["steps"]

    libsumo.start(["sumo", *command])
    inside = loop(libsumo)
    libsumo.close()
    traci.start([sumolib.checkBinary("sumo"), *command], label="networks", stdout=subprocess.DEVNULL)
    connection = traci.getConnection("networks")
    try:
        outside = loop(connection)
    finally:
        connection.close()
    assert len(inside) > 50
    pd.testing.assert_frame_equal(inside, outside)


def test_another_step_length_is_refused_with_the_line_to_write(tmp_path: Path) -> None:
    import libsumo

    source = write_scenario("short", tmp_path, 5.0, 5)
    libsumo.start(["sumo", "-c", str(source), "--step-length", "0.5", "--no-step-log", "true"])
    try:
        with pytest.raises(TrafficError, match=r"needed is 0\.1 s: add --step-length 0\.1"):
            DriverAssistance.attach(libsumo)
    finally:
        libsumo.close()
