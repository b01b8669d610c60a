"""Figures of the radar and the rear-end warning against tables that one can work out by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from analysis.rear_end import conflict_counts, track_accuracy, ttc_errors


def conflicts(*rows: tuple[float, float, bool, float]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["critical_s", "visible_s", "warned", "lead_time_s"])


def warnings(*rows: tuple[str, str, str]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["kind", "level", "outcome"])


def test_only_critical_conflicts_with_a_leader_in_view_are_due() -> None:
    f = conflict_counts(
        conflicts(
            (12.0, 3.0, True, 1.5),
            (12.0, 0.5, False, math.nan),
            (math.nan, 9.0, False, math.nan),
            (12.0, 1.0, False, math.nan),
        ),
        warnings(("ldw", "warning", "false"), ("fcw", "reminder", "true"), ("fcw", "danger", "false")),
        km=50.0,
    )
    assert (f["conflicts"], f["conflicts_critical"], f["conflicts_due"]) == (4, 3, 2)
    assert f["conflicts_due_warned_rate"] == pytest.approx(0.5)
    assert (f["fcw_reminder_true"], f["fcw_danger_false"], f["fcw_reminder_false"]) == (1, 1, 0)
    assert f["fcw_danger_false_per_100km"] == pytest.approx(2.0)
    assert f["fcw_danger_false_per_100km_low"] < 2.0 < f["fcw_danger_false_per_100km_high"]


def test_ttc_errors_count_below_three_seconds_and_a_gap_that_seems_to_open_as_infinite() -> None:
    steps = pd.DataFrame(
        {
            "true_ttc_s": [2.0, 2.5, 2.0, 1.0, 3.5, np.nan, 2.0],
            "true_leader_visible": [True, True, True, True, True, True, False],
            "fcw_ttc_s": [2.1, 2.3, 2.1, np.nan, 9.0, 1.0, np.nan],
            "fcw_track_id": pd.array([1, 1, 1, None, 1, 1, None], dtype="Int64"),
            "fcw_track_ttc_s": [2.2, 2.9, 1.6, 1.4, 9.0, 1.0, np.nan],
            "true_gap_m": 9.0,
        }
    )
    f = ttc_errors(steps)
    assert f["ttc_steps"] == 4
    assert f["ttc_error_median_s"] == pytest.approx(0.2)
    assert math.isinf(f["ttc_error_p95_s"])
    assert 0.37 < f["ttc_track_error_median_s"] <= f["ttc_track_error_p95_s"] <= 0.401
    assert f["ttc_no_target_rate"] == pytest.approx(0.25)
    assert (f["ttc_unforeseen_rate"], f["ttc_track_unforeseen_rate"]) == (0.25, 0.0)


def test_bodies_that_have_collided_have_no_time_to_collision() -> None:
    steps = pd.DataFrame(
        {
            "true_ttc_s": [1.0, 0.5, 0.0, 0.0],
            "true_leader_visible": True,
            "fcw_ttc_s": [1.1, 0.6, 38.8, np.nan],
            "fcw_track_id": pd.array([1, 1, 1, None], dtype="Int64"),
            "true_gap_m": [4.0, 2.0, -1.1, 0.0],
        }
    )
    f = ttc_errors(steps)
    assert (f["ttc_steps"], f["ttc_steps_overlapping"]) == (2, 2)
    shared = ttc_errors(steps.assign(true_leader_overlapped=[True, False, False, False]))
    assert (shared["ttc_steps"], shared["ttc_steps_overlapping"]) == (1, 3)
    assert f["ttc_error_p95_s"] == pytest.approx(0.1)
    assert math.isinf(f["ttc_error_with_overlap_p95_s"])
    assert f["ttc_no_target_rate"] == 0.0


def test_classes_count_from_the_fourth_row_of_a_track_on_where_the_truth_is_known() -> None:
    n = 6
    tracks = pd.DataFrame(
        {
            "run_id": "r",
            "vehicle_id": "a",
            "track_id": 3,
            "motion_state": ["unclassified"] * 3 + ["oncoming", "oncoming", "stationary"],
            "true_motion_state": ["oncoming"] * 5 + [None],
        }
    )
    for name, error in (("range_m", 0.5), ("range_rate_mps", 0.1), ("azimuth_rad", 0.0), ("vx_mps", 0.2)):
        tracks[f"true_{name}"], tracks[name] = np.arange(n), np.arange(n) + error
    f = track_accuracy(tracks)
    assert f["class_accuracy"] == 1.0
    assert f["class_accuracy_oncoming"] == 1.0
    assert f["track_range_rmse_m"] == pytest.approx(0.5)
    assert f["track_range_rate_rmse_mps"] == pytest.approx(0.1)
