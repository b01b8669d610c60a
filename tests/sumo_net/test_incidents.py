"""Hard brakings, drivers who look away, cut-ins: in real SUMO runs, each in a process of its own."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from sumo_net.incidents import IncidentMaker, Incidents
from tests.processes import in_process


def traffic_run(out: Path, incidents: dict[str, float] | None, seed: int) -> dict[str, Any]:
    """Accelerations and lane changes of all vehicles over 25 s."""
    from sumo_net.demand import Demand
    from sumo_net.scenario import Scenario, prepare
    from sumo_net.traffic import Traffic

    scenario = Scenario(duration_s=25.0, warm_up_s=0.0, seed=3, demand=Demand(flow_per_lane_vph=1500.0))
    arguments = prepare(scenario, out).arguments
    braking, lanes, trace, last = 0, 0, [], {}
    with Traffic.start(arguments) as traffic:
        maker = None if incidents is None else IncidentMaker(Incidents(**incidents), traffic, seed)
        for _ in range(250):
            traffic.step()
            now = traffic.snapshot()
            if maker is not None:
                maker.step(now)
            braking += int((traffic.accelerations_mps2(now.handle) < -2.9).sum())
            trace.append(float(now.speed_mps.sum()))
            for handle, lane in zip(now.handle.tolist(), now.lane.tolist(), strict=True):
                before = last.get(handle, lane)
                same_edge = (
                    traffic.lane_ids[before].rsplit("_", 1)[0] == traffic.lane_ids[lane].rsplit("_", 1)[0]
                )
                lanes += lane != before and same_edge
                last[handle] = lane
    return {"brakes": braking, "changes": lanes, "trace": trace}


def test_incidents_happen_at_will_and_by_the_seed_alone(tmp_path: Path) -> None:
    none = in_process(traffic_run, tmp_path / "a", None, 1)
    never = in_process(traffic_run, tmp_path / "b", {}, 1)
    assert never["trace"] == none["trace"]
    often = {"brakings_per_h": 60.0, "follower_away": 0.5, "cut_ins_per_h": 600.0}
    many = in_process(traffic_run, tmp_path / "c", often, 1)
    assert many["brakes"] > none["brakes"] + 50
    assert many["changes"] > none["changes"]
    assert in_process(traffic_run, tmp_path / "d", often, 1)["trace"] == many["trace"]
    assert in_process(traffic_run, tmp_path / "e", often, 2)["trace"] != many["trace"]


def test_settings_are_checked() -> None:
    with pytest.raises(ValidationError, match="brakings_per_h"):
        Incidents(brakings_per_h=-1.0)
