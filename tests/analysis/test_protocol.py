"""Protocols: plans, verdicts on synthetic drives, cells; a small one run in SUMO through the command."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from analysis.cli import main
from analysis.protocol.definition import CollisionTest, DepartureTest, Protocol, load, protocols
from analysis.protocol.judging import Verdict, judge
from analysis.protocol.planning import Trial, batches, half_span_m, trials_of
from analysis.protocol.report import comparison_row, trial_table
from analysis.protocol.running import outcome
from plugin.configuration import configuration_from
from sumo_net.settings import SettingsError

DRIFT = DepartureTest(
    name="drift",
    line="solid",
    speed_kmh=72.0,
    speed_tolerance_kmh=1.6,
    drift_mps=(0.5,),
    drift_tolerance_mps=0.1,
    trials=5,
    least_passed=3,
    earliest_m=0.75,
    latest_m=0.30,
)
STOPPED = CollisionTest(
    name="stopped",
    speed_kmh=72.0,
    speed_tolerance_kmh=1.6,
    leader_kmh=0.0,
    gap_m=150.0,
    ttc_least_s=2.1,
    trials=7,
    least_passed=5,
)
SPAN, FRONT = half_span_m(), 0.9
NO_TRACKS = pd.DataFrame({"time_s": [], "target_id": []})


@pytest.mark.parametrize("name", protocols())
def test_every_protocol_plans_scenarios_that_are_valid(name: str) -> None:
    protocol = load(name)
    assert protocol.from_memory == ("from memory" in protocol.notes)
    trials = trials_of(protocol)
    assert len({trial.vehicle_id for trial in trials}) == len(trials)
    planned = batches(protocol, trials)
    assert sorted(t.vehicle_id for batch in planned for t in batch.trials) == sorted(
        t.vehicle_id for t in trials
    )
    for batch in planned:
        configuration = configuration_from(batch.changes, name)
        road = sum(element.length_m for element in configuration.highway.elements)
        assert max(actor.position_m for actor in configuration.actors) < road - 50.0
        turned = sum(e.length_m * abs(e.curvature_1pm) for e in configuration.highway.elements)
        assert turned < 2.0 * math.pi


def test_figures_of_the_tests_are_the_known_ones() -> None:
    ldw, fcw = load("nhtsa-ldw"), load("nhtsa-fcw")
    assert {(t.speed_kmh, t.earliest_m, t.latest_m, t.trials) for t in ldw.departure} == {
        (72.4, 0.75, 0.3, 5)
    }
    assert {t.line for t in ldw.departure} == {"solid", "dashed", "dots"}
    assert {t.name: t.ttc_least_s for t in fcw.collision} == {
        "stopped": 2.1,
        "decelerating": 2.4,
        "slower": 2.0,
    }
    assert {(t.least_passed, t.trials) for t in fcw.collision} == {(5, 7)}


def test_unknown_names_and_impossible_figures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"did you mean 'nhtsa-ldw'"):
        load("nhtsa-lwd")
    with pytest.raises(ValueError, match=r"leader_kmh = 80\.0: below speed_kmh"):
        dataclasses.replace(STOPPED, leader_kmh=80.0)
    file = tmp_path / "mine.toml"
    file.write_text(SMALL.replace("least_passed = 1", "least_passed = 2"))
    with pytest.raises(SettingsError, match=r"least_passed = 2: at most trials = 1"):
        load(str(file))


def drifting(alert_at: float | None, rate: float = 0.5, speed: float = 20.0, side: str = "left") -> Any:
    """Steps of a drift to the left from 1.2 m before the border; the alert at this distance to it."""
    time = np.arange(0.1, 12.0, 0.1)
    gap = 1.2 - rate * np.clip(time - 4.0, 0.0, None)
    offset = 1.875 - SPAN - gap
    on = np.zeros(len(time), bool) if alert_at is None else gap <= alert_at
    return pd.DataFrame(
        {
            "time_s": time,
            "speed_mps": speed,
            "true_lateral_offset_m": offset,
            "true_heading_error_rad": 0.0,
            "true_lateral_speed_mps": np.where(time > 4.0, rate, 0.0),
            "ldw_state": np.where(on, f"warning {side}", "ready"),
        }
    )


@pytest.mark.parametrize(
    ("steps", "passed", "valid", "why", "margin"),
    [
        (drifting(0.5), True, True, "", 0.25),
        (drifting(0.0), True, True, "", 0.3),
        (drifting(0.9), False, True, "m too early", -0.15),
        (drifting(None), False, True, "no alert", -math.inf),
        (drifting(-0.4), False, True, "no alert", -math.inf),
        (drifting(2.0), False, True, "alert before the departure", -0.45),
        (drifting(0.5, side="right"), False, True, "the alert was a warning right", 0.25),
        (drifting(0.5, rate=0.3), False, False, "invalid: drifted at 0.30 m/s", None),
        (drifting(0.5, speed=21.0), False, False, "invalid: 3.6 km/h off the speed", None),
        (drifting(0.5).iloc[:30], False, False, "invalid", None),
    ],
)
def test_verdicts_on_departures(
    steps: Any, passed: bool, valid: bool, why: str, margin: float | None
) -> None:
    trial = Trial(DRIFT, "drift left 0.5", 1, 1, 0.0, 1, 0.5)
    verdict = judge(trial, steps, NO_TRACKS, SPAN, FRONT)
    assert (verdict.passed, verdict.valid) == (passed, valid), verdict.why
    assert why.removeprefix("invalid") in verdict.why
    if margin is not None:
        assert verdict.margin == pytest.approx(margin, abs=0.051)  # alerts fall on steps of 0.05 m


def coming_up(alert_ttc_s: float | None, level: str = "reminder") -> Any:
    """Steps of a car at 20 m/s that approaches a stationary one from 150 m."""
    time = np.arange(0.1, 7.45, 0.1)
    gap = 150.0 - 20.0 * (time - 0.1)
    on = np.zeros(len(time), bool) if alert_ttc_s is None else gap <= 20.0 * alert_ttc_s + 1e-6
    return pd.DataFrame(
        {"time_s": time, "speed_mps": 20.0, "true_gap_m": gap, "fcw_state": np.where(on, level, "ready")}
    )


def test_verdicts_on_approaches() -> None:
    trial = Trial(STOPPED, "stopped", 1, 1, 0.0)
    good = judge(trial, coming_up(2.5), NO_TRACKS, SPAN, FRONT)
    assert good.passed
    assert good.ttc_s == pytest.approx(2.5)
    assert good.margin == pytest.approx(0.4)
    late = judge(trial, coming_up(1.9), NO_TRACKS, SPAN, FRONT)
    assert (late.passed, late.valid, late.why) == (False, True, "0.20 s too late")
    assert judge(trial, coming_up(None), NO_TRACKS, SPAN, FRONT).why == "no alert"
    beside = Trial(dataclasses.replace(STOPPED, expect="none", leader_lane="left"), "beside", 1, 1, 0.0)
    seen = pd.DataFrame({"time_s": [1.0], "target_id": [f"{beside.vehicle_id}_leader"]})
    assert judge(beside, coming_up(None), seen, SPAN, FRONT).passed
    assert judge(beside, coming_up(2.0), seen, SPAN, FRONT).why == "an alert of a vehicle beside"
    assert not judge(beside, coming_up(None), NO_TRACKS, SPAN, FRONT).valid
    ranged = Trial(
        dataclasses.replace(
            STOPPED,
            ttc_least_s=None,
            latest_reaction_s=0.4,
            latest_mps2=5.0,  # 8 + 40 m
            detect_reaction_s=1.0,
            detect_mps2=4.0,  # 20 + 50 m
        ),
        "ranged",
        1,
        1,
        0.0,
    )
    steps = coming_up(2.5)
    followed = pd.DataFrame({"time_s": steps["time_s"][32:], "target_id": f"{ranged.vehicle_id}_leader"})
    far = judge(ranged, steps, followed, SPAN, FRONT)
    assert far.passed
    assert far.margin == pytest.approx(2.0)  # alert at 50 m
    assert far.followed_from_m == pytest.approx(150.0 - 20.0 * 3.2)
    near = judge(ranged, steps, followed.iloc[8:], SPAN, FRONT)
    assert near.why == "followed from 70.0 m only" or near.passed
    assert "followed from" in judge(ranged, steps, followed.iloc[9:], SPAN, FRONT).why


def test_the_braking_leader_s_time_to_collision_counts_its_braking() -> None:
    test = dataclasses.replace(
        STOPPED, leader_kmh=72.0, gap_m=30.0, brake_mps2=3.0, ttc_least_s=2.4, ttc="accelerated"
    )
    time = np.arange(0.1, 8.0, 0.1)
    braked = np.clip(time - 4.1, 0.0, None)
    gap = 30.0 - 1.5 * braked**2
    steps = pd.DataFrame({"time_s": time, "speed_mps": 20.0, "true_gap_m": gap})
    steps["fcw_state"] = np.where(time >= 5.6 - 1e-6, "reminder", "ready")
    verdict = judge(Trial(test, "braking", 1, 1, 0.0), steps, NO_TRACKS, SPAN, FRONT)
    left = (-4.5 + math.sqrt(4.5**2 + 2 * 3.0 * (30.0 - 1.5**3))) / 3.0  # √(2 · 30 / 3) − 1.5 s
    assert left == pytest.approx(math.sqrt(20.0) - 1.5)
    assert verdict.ttc_accelerated_s == pytest.approx(left, abs=0.02)
    assert verdict.ttc_s == pytest.approx((30.0 - 1.5**3) / 4.5, rel=0.01)
    assert verdict.leader_braking_mps2 == pytest.approx(3.0, rel=0.01)
    assert verdict.passed


def test_cells_and_totals() -> None:
    protocol = Protocol(
        title="t", source="s", from_memory=True, overall_share=0.8, departure=(dataclasses.replace(DRIFT),)
    )
    cells = list(dict.fromkeys(trial.cell for trial in trials_of(protocol)))
    assert cells == ["drift left 0.5", "drift right 0.5"]

    def verdicts(good: int, cell: str) -> list[Verdict]:
        return [
            Verdict("drift", cell, k + 1, 1, f"{cell}{k}", k < good, margin=0.1 * k, margin_unit="m")
            for k in range(5)
        ]

    both = outcome(protocol, verdicts(5, cells[0]) + verdicts(3, cells[1]))
    assert both.passed
    assert both.share == pytest.approx(0.8)
    assert not outcome(protocol, verdicts(5, cells[0]) + verdicts(2, cells[1])).passed  # the cell
    assert not outcome(protocol, verdicts(3, cells[0]) + verdicts(3, cells[1])).passed  # the total
    repeated = dataclasses.replace(verdicts(0, cells[1])[0], valid=False, attempt=1)
    again = outcome(protocol, [*verdicts(5, cells[0]), repeated, *verdicts(3, cells[1])])
    assert again.passed
    assert len(trial_table(again)) == 11
    assert comparison_row("mine", "refined", "camp", again)["least_margin"] == "0.00 m"


SMALL = """
title = "A small one"
source = "nobody"
from_memory = false
[settings.driver]
sleepy_share = 0.0
alert_sd_least_m = 0.0
alert_sd_most_m = 0.0
distraction_per_min = 0.0
[[departure]]
name = "drift"
line = "solid"
sides = ["left"]
speed_kmh = 72.0
speed_tolerance_kmh = 1.6
drift_mps = [0.6]
drift_tolerance_mps = 0.12
settle_s = 2.0
trials = 1
least_passed = 1
earliest_m = 0.9
latest_m = 0.3
"""


def test_a_protocol_through_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(SMALL)
    bad.write_text(SMALL.replace("earliest_m = 0.9", "earliest_m = 0.3"))
    trials = {}
    for file, status, words in ((good, 0, "good: PASSED: 100.0%"), (bad, 1, "bad: FAILED: 0.0%")):
        with pytest.raises(SystemExit) as ended:
            main(["protocol", str(file), "--out", str(tmp_path / "out"), "--workers", "1"])
        assert (ended.value.code or 0) == status
        assert words in capsys.readouterr().out
        trials[file.stem] = pd.read_csv(tmp_path / "out" / f"{file.stem}_trials.csv").iloc[0]
    assert trials["good"]["drift_mps"] == pytest.approx(0.6, abs=0.06)
    assert trials["good"]["speed_mps"] == pytest.approx(20.0, abs=0.05)
    assert 0.3 < trials["good"]["distance_to_line_m"] < 0.9
    assert "too early" in trials["bad"]["why"]
    with pytest.raises(SystemExit) as ended:
        main(["protocol", str(good), "--distance-model", "mazdda", "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
