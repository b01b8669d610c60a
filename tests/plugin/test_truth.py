"""Scoring against the path then driven: a drift whose crossing one can compute by hand."""

from typing import Any

import numpy as np
import pytest

from plugin.events import in_placement_zone
from plugin.record import Recorder
from plugin.truth import HORIZONS_S, Scorer

HALF_LANE, HALF_WHEELS = 1.875, 0.75
INSIDE = HALF_LANE - HALF_WHEELS  # offset at which the outer edge meets the border


def columns(step: int, offset: float, drift: float, **more: Any) -> dict[str, np.ndarray]:
    """One vehicle that drives along +x at 25 m/s with the given offset."""
    path = np.zeros((1, len(HORIZONS_S), 3))
    path[0, :, 0] = 25.0 * np.array(HORIZONS_S)
    row = {
        "handle": 7,
        "step": step,
        "time_s": step / 10,
        "speed_mps": 25.0,
        "x_m": 2.5 * step,
        "y_m": offset,
        "world_heading_rad": 0.0,
        "true_lateral_offset_m": offset,
        "margin_left_m": INSIDE - offset,
        "margin_right_m": INSIDE + offset,
        "drift_mps": drift,
        "cause": 0,
        "signal": 0,
        "warning_side": 0,
        "tlc_s": np.nan,
        "lane_id": 0,
    } | more
    arrays = {name: np.array([value]) for name, value in row.items()}
    return arrays | dict.fromkeys(("predicted", "constant_velocity", "constant_radius", "true_state"), path)


def score(rows: list[dict[str, np.ndarray]], settle_every: int = 37) -> Recorder:
    recorder = Recorder("test")
    scorer = Scorer(recorder, {7: "a/b"}, {"lane_id": ["in_2"]})
    for i, row in enumerate(rows):
        scorer.add(row)
        if i % settle_every == settle_every - 1:
            scorer.settle(float(row["time_s"][0]))
    scorer.settle(np.inf, final=True)
    return recorder


def drift_and_back(step: int) -> tuple[float, float]:
    """0.5 m/s to the left from 10 s to 14 s, then back; the wheel crosses at 10 + 1.125 / 0.5 = 12.25 s."""
    t = step / 10
    if t < 10.0:
        return 0.0, 0.0
    if t < 14.0:
        return 0.5 * (t - 10.0), 0.5
    return max(2.0 - 0.5 * (t - 14.0), 0.0), -0.5 if t < 18.0 else 0.0


@pytest.mark.parametrize("settle_every", [13, 37, 1000])
def test_crossing_time_and_true_tlc_do_not_depend_on_when_rows_are_settled(settle_every: int) -> None:
    recorder = score([columns(k, *drift_and_back(k)) for k in range(300)], settle_every)
    departures = recorder.table("departures")
    assert departures["crossing_s"].tolist() == pytest.approx([12.25])
    assert departures["side"].tolist() == ["left"]
    assert departures["lateral_speed_mps"].tolist() == pytest.approx([0.5])
    assert departures["warned"].tolist() == [False]
    assert departures[["lane_id", "true_x_m", "true_y_m"]].values.tolist() == [
        ["in_2", 307.5, 1.15]
    ]  # 12.3 s
    steps = recorder.table("steps").set_index("time_s")
    assert len(steps) == 300
    assert steps["true_tlc_s"][11.0] == pytest.approx(1.25)
    assert steps["true_tlc_s"][13.0] == 0.0
    assert np.isnan(steps["true_tlc_s"][5.0])  # further away than the look-ahead
    assert np.isnan(steps["true_tlc_s"][20.0])


def test_crossing_is_no_event_again_before_the_wheel_came_back_inside() -> None:
    offsets = np.where(np.arange(100) % 2, INSIDE + 0.01, INSIDE - 0.01)
    offsets[:10] = 0.0
    recorder = score([columns(k, offset, 0.1) for k, offset in enumerate(offsets[:28])])
    assert len(recorder.table("departures")) == 1


@pytest.mark.parametrize(("pause", "departures"), [(15, 1), (25, 2)])
def test_crossing_is_an_event_again_after_two_seconds(pause: int, departures: int) -> None:
    offsets = [0.0] * 5 + [0.6] * 5 + [INSIDE + 0.01] + [INSIDE - 0.01] * pause + [INSIDE + 0.01] * 5
    recorder = score([columns(k, offset, 0.1) for k, offset in enumerate(offsets)])
    assert len(recorder.table("departures")) == departures


@pytest.mark.parametrize(("until_s", "cause"), [(11.0, "distraction"), (9.0, "lane_keeping")])
def test_an_episode_that_ended_within_two_seconds_is_the_cause(until_s: float, cause: str) -> None:
    rows = [columns(k, *drift_and_back(k), cause=int(k / 10 < until_s)) for k in range(200)]
    assert score(rows).table("departures")["cause"].tolist() == [cause]


def test_lane_that_flips_under_the_vehicle_is_no_crossing_of_the_other_border() -> None:
    def lane_change(k: int) -> dict[str, np.ndarray]:
        offset = np.clip(0.1 * (k - 50), 0.0, 2 * HALF_LANE)
        in_lane = offset - (2 * HALF_LANE if offset > HALF_LANE else 0.0)
        return columns(k, in_lane, 1.0, cause=3, y_m=offset)

    departures = score([lane_change(k) for k in range(150)]).table("departures")
    assert departures["side"].tolist() == ["left"]
    assert departures["cause"].tolist() == ["lane_change_signalled"]
    assert departures["warned"].isna().all()


@pytest.mark.parametrize(
    ("start", "end", "side", "outcome", "lead"),
    [
        (11.5, 12.5, 1, "true", 0.75),
        (8.0, 11.9, 1, "true", 4.25),  # ends less than half a second before the crossing
        (8.0, 11.6, 1, "false", None),
        (12.6, 13.0, 1, "true", -0.35),  # late
        (13.4, 13.8, 1, "nuisance", None),  # later than that
        (5.0, 5.5, 1, "false", None),
        (9.6, 9.8, -1, "false", None),
        (15.0, 15.3, -1, "nuisance", None),
        (13.6, 13.8, -1, "nuisance", None),  # the drift begins half a second later
    ],
)
def test_warning_outcomes(start: float, end: float, side: int, outcome: str, lead: float | None) -> None:
    rows = []
    for k in range(300):
        active = side if start <= k / 10 <= end else 0
        rows.append(columns(k, *drift_and_back(k), warning_side=active, tlc_s=0.9))
    recorder = score(rows)
    warning = recorder.table("warnings").iloc[0]
    assert len(recorder.table("warnings")) == 1
    assert (warning["outcome"], warning["start_s"]) == (outcome, start)
    assert warning["end_s"] == pytest.approx(end)
    assert warning["lead_time_s"] == pytest.approx(lead) if lead else np.isnan(warning["lead_time_s"])
    departure = recorder.table("departures").iloc[0]
    assert departure["warned"] == (outcome == "true" and lead > 0.0)
    assert departure["lead_time_s"] == pytest.approx(lead) if lead else np.isnan(departure["lead_time_s"])


def test_lead_is_from_the_first_warning_to_the_first_crossing() -> None:
    def swerve(k: int) -> float:
        """0.1 m over the border at 2 and at 4 s, 0.3 m inside between; it crosses at 1.8 and at 3.8 s."""
        return float(
            np.interp(
                k / 10,
                [0.0, 1.0, 1.6, 2.0, 3.0, 3.6, 4.0, 5.0],
                INSIDE + np.array([-0.6, -0.3, -0.1, 0.1, -0.3, -0.1, 0.1, -0.3]),
            )
        )

    def warned(k: int) -> bool:
        return 12 <= k <= 13 or 15 <= k <= 34

    rows = [columns(k, swerve(k), 0.5, warning_side=int(warned(k)), tlc_s=0.9) for k in range(120)]
    recorder = score(rows)
    assert recorder.table("departures")["crossing_s"].tolist() == pytest.approx([1.8, 3.8])
    assert recorder.table("departures")["lead_time_s"].tolist() == pytest.approx([0.6, 2.6])
    assert recorder.table("warnings")["lead_time_s"].tolist() == pytest.approx([0.6, 0.3])


@pytest.mark.parametrize(("speed", "due"), [(9.0, False), (12.0, True)])
def test_no_warning_is_due_for_a_slow_crossing(speed: float, due: bool) -> None:
    slow = [columns(k, *drift_and_back(k), speed_mps=speed, x_m=0.1 * speed * k) for k in range(300)]
    departures = score(slow).table("departures")
    assert departures["speed_mps"].tolist() == [speed]
    assert departures["warned"].notna().all() == due


@pytest.mark.parametrize(("signal", "until_s", "due"), [(1, 11.5, False), (1, 10.5, True), (-1, 11.5, True)])
def test_a_change_whose_turn_signal_ended_just_before_the_crossing_is_signalled(
    signal: int, until_s: float, due: bool
) -> None:
    # the wheel crosses at 12.25 s; a driver who breaks a change off ends the signal while still moving over
    rows = [
        columns(k, *drift_and_back(k), cause=4, signal=signal if k / 10 < until_s else 0) for k in range(200)
    ]
    departures = score(rows).table("departures")
    assert departures["cause"].tolist() == ["lane_change_unsignalled" if due else "lane_change_signalled"]
    assert departures["warned"].notna().all() == due


def test_prediction_error_is_measured_across_the_driven_path() -> None:
    predictions = score([columns(k, *drift_and_back(k)) for k in range(200)]).table("predictions")
    row = predictions.query("time_s == 10.0").set_index("horizon_s")
    assert row["lateral_error_m"].tolist() == pytest.approx([-0.25, -0.5, -0.75, -1.0])
    assert row["longitudinal_error_m"].tolist() == pytest.approx([0.0] * 4)
    assert predictions["time_s"].max() == pytest.approx(19.4)  # the last steps have no driven path to compare


def test_prediction_error_is_that_across_the_heading_then() -> None:
    turn, radius = 0.05, 50.0  # rad a step of 2.5 m
    angle = turn * np.arange(60)
    x, y = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
    rows = [
        columns(k, 0.0, 0.0, x_m=x[k], y_m=y[k], world_heading_rad=angle[k] - (angle[k] > np.pi) * 2 * np.pi)
        for k in range(60)
    ]
    found = score(rows).table("predictions").set_index(["time_s", "horizon_s"])
    for horizon in HORIZONS_S:  # predicted straight on
        away, there = 10 * horizon * turn, 25.0 * horizon
        across = np.cos(away) * -radius * (1 - np.cos(away)) - np.sin(away) * (there - radius * np.sin(away))
        assert found["lateral_error_m"][0.0, horizon] == pytest.approx(across, abs=1e-3)
        assert found["lateral_error_m"][3.0, horizon] == pytest.approx(across, abs=1e-3)


def test_nothing_is_scored_across_a_move() -> None:
    for at, departures in ((115, 1), (122, 0)):  # the wheel crosses in the step from 122 to 123
        moved = [columns(k, *drift_and_back(k), x_m=2.5 * k + 10.0 * (k > at)) for k in range(200)]
        recorder = score(moved)
        predictions, steps = recorder.table("predictions"), recorder.table("steps").set_index("time_s")
        assert not predictions["time_s"].between(at / 10 - 0.35, at / 10 + 0.05).any()
        assert predictions["longitudinal_error_m"].abs().max() < 1e-6
        assert len(recorder.table("departures")) == departures
        assert np.isnan(steps["true_tlc_s"][at / 10])


def test_vehicle_that_vanishes_and_comes_back_has_no_path_across_the_gap() -> None:
    rows = [columns(k, 0.0, 0.0) for k in [*range(50), *range(70, 120)]]
    predictions = score(rows).table("predictions")
    assert 4.8 not in predictions["time_s"].tolist()
    assert len(score(rows).table("steps")) == 100


def test_placement_zone() -> None:
    assert in_placement_zone(0.7, 0.3)
    assert not in_placement_zone(0.8, 0.3)
    assert in_placement_zone(1.1, 0.8)
    assert not in_placement_zone(1.6, 3.0)
    assert in_placement_zone(-0.3, 0.3)
    assert not in_placement_zone(-0.31, 0.3)
