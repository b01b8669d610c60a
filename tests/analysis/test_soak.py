"""Vehicles come and go: nothing is kept of those that have left."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.soak import grew, sizes, slope
from tests.plugin.test_assistance import in_process

BYTES_A_VEHICLE = ("_equipped", "_bodies", "_lane", "_left", "_from_m", "_row", "_keys")  # arrays by handle


def come_and_go(out: Path) -> tuple[list[dict[str, int]], int, int]:
    """Sizes of all state each 2 s, vehicles seen and vehicles there at the end, on a road of 600 m."""
    from analysis.simulate import settings_of
    from plugin.assistance import DriverAssistance
    from sumo_net import traffic as module
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    module.REMEMBERED_S = 15.0  # in place of five minutes
    road = {"elements": [{"kind": "straight", "length_m": 600.0}], "lanes": 2}
    changes = {"highway": road, "warm_up_s": 5.0, "demand": {"flow_per_lane_vph": 1800.0}}
    changes["reaction"] = {"on": True}
    configuration = settings_of("highway", seed=2, duration_s=60.0, fraction=0.15, changes=changes)
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
            if step >= 250 and step % 20 == 0:
                states.append(sizes(adas, "adas") | sizes(traffic, "traffic"))
        there = len(traffic._numbers)
        seen = traffic._next_handle
    return states, seen, there


def test_no_state_is_left_of_vehicles_that_left(tmp_path: Path) -> None:
    states, seen, there = in_process(come_and_go, tmp_path)
    assert seen > 2.5 * there  # most have left
    last = states[-1]
    kept = {name for name in last if name.endswith(("._names", "._numbers", "._kinds", "._last_crossing"))}
    assert {name.rsplit(".", 1)[-1] for name in kept} == {"_names", "_numbers", "_kinds", "_last_crossing"}
    assert max(last[name] for name in kept) < 0.8 * seen
    first = {name: max(state.get(name, 0) for state in states[: len(states) // 2]) for name in last}
    per_vehicle = [
        name
        for name, size in last.items()
        if size > 1.5 * first[name] + 40 and not any(name.split("[")[0].endswith(known) for known in BYTES_A_VEHICLE)
    ]
    assert not [name for name in per_vehicle if ".table" not in name and "_store" not in name]


def test_growth_is_found() -> None:
    states = [{"a": 100 + k, "b": 100 + k % 7, "c": 5} for k in range(40)]
    assert grew(states) == {"a"}
    hours = np.linspace(0.0, 1.0, 50)
    rise, error = slope(hours, 500.0 + 3.0 * hours + 0.01 * np.sin(50.0 * hours))
    assert abs(rise - 3.0) < 0.05
    assert error < 0.05


def test_sizes_reach_what_objects_hold() -> None:
    from sumo_net.lane_changes import LaneChanges

    class Graph:
        lanes: dict[str, Any] = {}

    found = sizes(LaneChanges(Graph(), ["a_0"]), "changes")  # type: ignore[arg-type]
    assert found["changes._lane"] == 256
    assert found["changes._lane_ids"] == 1
