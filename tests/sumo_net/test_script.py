"""Scripted traffic: refused settings, the path of a drift, real runs that follow their script."""

import functools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sumo_net.driver import Driver
from sumo_net.driver_kernels import DISTRACTION, LANE_KEEPING, at_speed, veer
from sumo_net.scenario import Scenario
from sumo_net.script import Actor, Manoeuvre
from sumo_net.script_player import ScriptError, ScriptPlayer
from sumo_net.settings import SettingsError, read
from tests.processes import in_process
from tests.sumo_net.bench_road import STILL, Bench, circle, straight


def test_line_of_a_drift() -> None:
    start, rate, ramp = 0.4, -0.6, 1.5
    times = np.linspace(0.0, 4.0, 4001)
    line, speed, acceleration = np.array([veer(start, rate, ramp, t) for t in times]).T
    assert line[0] == start
    assert np.gradient(line, times)[1:-1] == pytest.approx(speed[1:-1], abs=1e-5)
    assert np.gradient(speed, times)[1:-1] == pytest.approx(acceleration[1:-1], abs=1e-3)
    assert speed[-1] == rate
    assert line[-1] == pytest.approx(start + rate * (4.0 - 0.5 * ramp))
    assert veer(start, rate, ramp, -0.3) == (start, 0.0, 0.0)


@pytest.mark.parametrize("rate", [0.1, -0.6])
@pytest.mark.parametrize("road", [straight, circle(400.0)], ids=["straight", "bend"])
def test_a_driver_drifts_at_the_rate_and_comes_back(rate: float, road: Any) -> None:
    bench = Bench(Driver(**STILL), 1, 20.0, road)
    for _ in range(30):
        bench.step()
    began = bench.motion.offset_m[0]
    mind, preview = bench.mind, at_speed(bench.numbers.preview_s, 20.0)
    mind.veer_from_m[:], mind.veer_rate_mps[:], mind.veer_ramp_s[:] = 0.0, rate, 1.0
    mind.veer_elapsed_s[:], mind.veer_left_s[:], mind.cause[:] = -preview, 4.0 + preview, DISTRACTION
    offsets = []
    for _ in range(40):
        bench.step()
        offsets.append(bench.motion.offset_m[0] - began)
        assert bench.mind.cause[0] == DISTRACTION
    driven = np.diff(offsets)[-20:] / 0.1
    assert driven == pytest.approx(np.full(20, rate), abs=0.06 * abs(rate))
    assert offsets[-1] == pytest.approx(rate * (4.0 - preview - 0.5), abs=0.03)
    for _ in range(150):
        bench.step()
    assert bench.motion.offset_m[0] == pytest.approx(began, abs=0.03)
    assert bench.mind.cause[0] == LANE_KEEPING


def test_an_alert_ends_a_drift_after_the_reaction_time() -> None:
    bench = Bench(Driver(**STILL, reaction_mean_s=0.8, reaction_sd_s=0.0), 1, 20.0)
    bench.mind.veer_rate_mps[:], bench.mind.veer_left_s[:] = 0.4, 8.0
    for _ in range(20):
        bench.step()
    steps = 0
    while bench.mind.veer_left_s[0] > 0.0:
        bench.step(np.ones(1, np.bool_))
        steps += 1
    assert steps == 8


def test_settings_say_what_is_missing_or_too_much() -> None:
    with pytest.raises(ValidationError, match=r"do = 'veer' needs for_s"):
        Manoeuvre(who="a", at_s=1.0, do="veer", drift_mps=0.3)
    with pytest.raises(ValidationError, match=r"do = 'speed' has no side"):
        Manoeuvre(who="a", at_s=1.0, do="speed", speed_mps=3.0, side="left")
    with pytest.raises(ValidationError, match=r"offset_m = .*: needs equipped = true"):
        Actor(id="a", position_m=50.0, speed_mps=20.0, offset_m=0.3)
    actor = Actor(id="a", position_m=50.0, speed_mps=20.0)
    drift = Manoeuvre(who="a", at_s=1.0, do="veer", drift_mps=0.3, for_s=2.0)
    with pytest.raises(ValidationError, match=r"need equipped = true"):
        Scenario(actors=(actor,), script=(drift,))
    with pytest.raises(ValidationError, match=r"who = 'b' is not an actor: actors are a"):
        Scenario(actors=(actor,), script=(Manoeuvre(who="b", at_s=1.0, do="free"),))
    with pytest.raises(ValidationError, match=r"id = 'a' is used twice"):
        Scenario(actors=(actor, actor))
    with pytest.raises(SettingsError, match=r"unknown key 'actors\.0\.spede_mps': did you mean 'speed_mps'"):
        read(Scenario, {"actors": [{"id": "a", "position_m": 9.0, "spede_mps": 3.0}]}, "mine.toml")


ROAD = {"elements": [{"kind": "straight", "length_m": 1500.0}]}
ACTORS = [
    {"id": "ego", "lane": 1, "position_m": 100.0, "speed_mps": 25.0, "equipped": True, "offset_m": 0.2},
    {"id": "leader", "lane": 1, "position_m": 180.0, "speed_mps": 25.0},
    {"id": "late", "lane": 2, "position_m": 60.0, "speed_mps": 30.0, "at_s": 1.0},
]


def scripted_run(out: Path, script: list[dict[str, Any]], seconds: float) -> dict[str, Any]:
    """Speeds, lanes and truth of the actors, by step."""
    from sumo_net.driver import Driver
    from sumo_net.ego import Ego
    from sumo_net.road import RoadNetwork
    from sumo_net.scenario import Scenario, prepare
    from sumo_net.script_player import ScriptError, ScriptPlayer
    from sumo_net.settings import read
    from sumo_net.traffic import Traffic

    mapping = {
        "highway": ROAD,
        "warm_up_s": 0.5,
        "duration_s": seconds,
        "demand": {"flow_per_lane_vph": 0.0},
        "actors": ACTORS,
        "script": script,
    }
    scenario = read(Scenario, mapping, "test")
    prepared = prepare(scenario, out)
    rows: list[dict[str, Any]] = []
    with Traffic.start(prepared.arguments) as traffic:
        ego = Ego(RoadNetwork.from_highway(prepared.network), traffic, 1, Driver(**STILL), None, {"ego": 0.2})
        player = ScriptPlayer(scenario.actors, scenario.script, traffic, ego)
        for _ in range(prepared.warm_up_steps):
            traffic.step()
        try:
            for _ in range(prepared.recorded_steps):
                traffic.step()
                now = traffic.snapshot()
                names = [traffic.vehicle_id(h) for h in now.handle]
                truth = ego.step(now, np.array([name == "ego" for name in names]))
                if len(truth.handle):
                    traffic.write_lateral(truth.handle, ego.front_lateral_m())
                player.step(now)
                row = {
                    name: (now.speed_mps[i], traffic.lane_ids[now.lane[i]]) for i, name in enumerate(names)
                }
                row["time"] = traffic.time_s
                row["truth"] = (float(truth.lane_offset_m[0]), int(truth.cause[0]), int(truth.signal[0]))
                rows.append(row)
        except ScriptError as error:
            return {"error": str(error)}
    return {"rows": rows}


run = functools.partial(in_process, scripted_run)


def test_sumo_does_what_it_is_told(tmp_path: Path) -> None:
    script = [
        {"who": "leader", "at_s": 2.0, "do": "speed", "speed_mps": 5.0, "rate_mps2": 4.0},
        {"who": "ego", "at_s": 3.0, "do": "change_lane", "side": "right", "signal": False, "over_s": 3.0},
    ]
    rows = run(tmp_path, script, 9.0)["rows"]
    assert "late" not in rows[8]
    assert rows[14]["late"] == (30.0, "forward_0_2")
    assert rows[0]["truth"][0] == pytest.approx(0.2, abs=0.01)
    speed = np.array([row["leader"][0] for row in rows])
    told = np.clip(25.0 - 4.0 * 0.1 * (np.arange(len(rows)) - 19), 5.0, 25.0)
    assert speed == pytest.approx(told, abs=1e-6)
    # the ego holds its speed, 30 m behind a leader that brakes hard, and beside it later
    assert [row["ego"][0] for row in rows] == pytest.approx([25.0] * len(rows))
    assert {row["ego"][1] for row in rows[:30]} == {"forward_0_1"}
    assert {row["ego"][1] for row in rows[32:]} == {"forward_0_0"}
    causes = [row["truth"][1] for row in rows]
    assert causes.count(4) in range(28, 34)
    assert all(row["truth"][2] == 0 for row in rows)
    assert rows[-1]["truth"][0] == pytest.approx(0.2, abs=0.1)


def test_what_cannot_be_done_is_an_error(tmp_path: Path) -> None:
    script = [{"who": "late", "at_s": 2.0, "do": "change_lane", "side": "left"}]
    assert "'late' has not changed lanes by 2." in run(tmp_path / "a", script, 4.0)["error"]


class Deaf:
    """A SUMO in which one vehicle drives 20 m/s whatever it is told."""

    time_s, gone = 0.1, (KeyError,)

    def __init__(self) -> None:
        self.vehicles = self

    def vehicle_id(self, handle: int) -> str:
        return "deaf"

    def handle(self, vehicle_id: str) -> int:
        return {"deaf": 0}[vehicle_id]

    def __getattr__(self, name: str) -> Any:
        return lambda *given: None


def test_a_speed_that_is_not_driven_is_an_error() -> None:
    traffic: Any = Deaf()
    actor = Actor(id="deaf", position_m=50.0, speed_mps=20.0)
    slower = Manoeuvre(who="deaf", at_s=0.0, do="speed", speed_mps=10.0, rate_mps2=5.0)
    now: Any = SimpleNamespace(handle=np.array([0]), speed_mps=np.array([20.0]), lane=np.array([0]))
    player = ScriptPlayer((actor,), (slower,), traffic, SimpleNamespace())
    player.step(now)
    with pytest.raises(ScriptError, match=r"'deaf' drives 20\.00 m/s at 0\.1 s, commanded were 19\.50 m/s"):
        player.step(now)


def test_an_actor_that_sumo_leaves_out_is_an_error() -> None:
    traffic: Any = Deaf()
    actor = Actor(id="nobody", position_m=50.0, speed_mps=20.0)
    player = ScriptPlayer((actor,), (), traffic, SimpleNamespace())
    now: Any = SimpleNamespace(handle=np.zeros(0), speed_mps=np.zeros(0), lane=np.zeros(0))
    for _ in range(20):
        player.step(now)
        traffic.time_s += 0.1
    with pytest.raises(ScriptError, match=r"actor 'nobody' is not on the road at 2\.1 s"):
        player.step(now)
