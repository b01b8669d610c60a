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
    } | more
    arrays = {name: np.array([value]) for name, value in row.items()}
    return arrays | dict.fromkeys(("predicted", "constant_velocity", "constant_radius", "true_state"), path)


def score(rows: list[dict[str, np.ndarray]], settle_every: int = 37) -> Recorder:
    recorder = Recorder("test")
    scorer = Scorer(recorder, {7: "a/b"})
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


def test_lane_that_flips_under_the_vehicle_is_no_crossing_of_the_other_border() -> None:
    def lane_change(k: int) -> dict[str, np.ndarray]:
        offset = np.clip(0.1 * (k - 50), 0.0, 2 * HALF_LANE)
        return columns(k, offset - (2 * HALF_LANE if offset > HALF_LANE else 0.0), 1.0, cause=3)

    departures = score([lane_change(k) for k in range(150)]).table("departures")
    assert departures["side"].tolist() == ["left"]
    assert departures["cause"].tolist() == ["lane_change_signalled"]
    assert departures["warned"].isna().all()


@pytest.mark.parametrize(
    ("start", "end", "side", "outcome", "lead"),
    [(11.5, 12.5, 1, "true", 0.75), (5.0, 5.5, 1, "false", None), (15.0, 15.3, -1, "nuisance", None)],
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
    assert recorder.table("departures")["warned"].tolist() == [outcome == "true"]


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
