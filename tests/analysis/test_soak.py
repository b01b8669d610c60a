"""Vehicles come and go: no state is kept of those that have left."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.soak import grew, judge, sizes, slope
from tests.processes import in_process

BYTES_A_VEHICLE = ("_equipped", "_bodies", "_lane", "_left", "_from_m", "_row", "_keys")  # arrays by handle


def come_and_go(out: Path) -> dict[str, Any]:
    """A road of 600 m, on which a vehicle stays for about 25 s; the final state, and all sizes."""
    from analysis.simulate import settings_of
    from plugin.assistance import DriverAssistance
    from sumo_net import traffic as module
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    module.REMEMBERED_S = 10.0  # in place of five minutes
    road = {"elements": [{"kind": "straight", "length_m": 600.0}], "lanes": 2}
    changes = {"highway": road, "warm_up_s": 0.0, "demand": {"flow_per_lane_vph": 1800.0}}
    configuration = settings_of("highway", seed=2, duration_s=60.0, fraction=0.06, changes=changes)
    prepared = prepare(configuration, out)
    states = []
    with (
        Traffic.start(prepared.arguments) as traffic,
        DriverAssistance(
            traffic, configuration, prepared.network, out=out / "run", formats=("parquet",), threads=1
        ) as adas,
    ):
        for step in range(600):
            traffic.step()
            adas.step()
            if step >= 200 and step % 20 == 0:
                states.append(sizes(adas, "adas") | sizes(traffic, "traffic"))
        return {
            "states": states,
            "seen": traffic._next_handle,
            "equipped": adas._vehicles,
            "there": len(traffic._numbers),
            "names": len(traffic._names),
            "kinds": len(traffic._kinds),
            "left": [traffic.time_s - time for time, _ in traffic._left],
            "unknown": [handle for handle in adas._names if handle not in traffic.names],
            "equipped names": len(adas._names),
            "fleet": len(adas.vehicles),
        }


def test_no_state_is_left_of_vehicles_that_left(tmp_path: Path) -> None:
    end = in_process(come_and_go, tmp_path)
    assert end["seen"] > 2.5 * end["there"]  # most have left
    assert max(end["left"]) < 11.0
    assert end["names"] == end["kinds"] == end["there"] + len(end["left"])
    assert end["unknown"] == []
    assert end["fleet"] <= end["equipped names"] < end["equipped"]
    states = end["states"]
    last, half = states[-1], states[: len(states) // 2]
    most = {name: max(state.get(name, 0) for state in half) for name in last}
    grown = {name for name, size in last.items() if size > 1.5 * most[name] + 40}
    known = (*BYTES_A_VEHICLE, "_store", ".table")
    assert not {name for name in grown if not any(part in name for part in known)}


def test_growth_is_found() -> None:
    states = [{"a": 100 + k, "b": 100 + k % 7, "c": 5} for k in range(40)]
    assert grew(states) == {"a"}
    hours = np.linspace(0.0, 1.0, 50)
    rise, error = slope(hours, 500.0 + 3.0 * hours + 0.01 * np.sin(50.0 * hours))
    assert abs(rise - 3.0) < 0.05
    assert error < 0.05


@pytest.mark.parametrize(("leak_mb_per_h", "status"), [(0.0, 0), (20.0, 1)])
def test_memory_of_a_larger_fleet_is_no_leak(leak_mb_per_h: float, status: int) -> None:
    draw = np.random.default_rng(1)
    time_s = np.arange(30.0, 3601.0, 30.0)
    equipped, vehicles = draw.poisson(50, len(time_s)), draw.poisson(140, len(time_s))
    memory_mb = 500.0 + np.maximum.accumulate(0.7 * equipped) + np.maximum.accumulate(0.2 * vehicles)
    memory_mb += leak_mb_per_h * time_s / 3600.0 + draw.normal(0.0, 0.5, len(time_s))
    samples = np.column_stack([time_s, memory_mb, time_s, equipped, vehicles, 2.0 * time_s, time_s])
    assert judge(samples, []) == status
    plain, _ = slope(time_s / 3600.0, memory_mb)
    beside, _ = slope(time_s / 3600.0, memory_mb, *np.maximum.accumulate([equipped, vehicles], axis=1))
    assert abs(beside - leak_mb_per_h) < 2.0 < plain - leak_mb_per_h


def test_sizes_reach_what_objects_hold() -> None:
    from sumo_net.lane_changes import LaneChanges

    found = sizes(LaneChanges(None, ["a_0"]), "changes")  # type: ignore[arg-type]
    assert found["changes._lane"] == 256
    assert found["changes._lane_ids"] == 1
