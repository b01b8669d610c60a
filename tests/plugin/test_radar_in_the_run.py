"""The radar chain inside a real SUMO run: its tables against each other, and against truth."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from plugin.record import read_table
from tests.plugin.test_assistance import run
from tests.processes import in_process


@pytest.fixture(scope="module")
def dense_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("radar")
    in_process(run, out, {"duration_s": 12.0, "fraction": 0.1, "seed": 5, "formats": ("parquet",)})
    return out


def test_tracks_follow_what_is_really_there(dense_run: Path) -> None:
    tracks = read_table(dense_run, "tracks")
    assert tracks["vehicle_id"].nunique() >= 10
    assert not tracks.duplicated(["vehicle_id", "time_s", "track_id"]).any()
    settled = tracks[tracks.groupby(["vehicle_id", "track_id"]).cumcount() >= 10]
    measured = settled[settled["true_range_m"].notna()]
    assert len(measured) > 2000
    for name, tolerance in (("range_m", 1.0), ("range_rate_mps", 0.5), ("azimuth_rad", 0.01)):
        error = measured[name] - measured[f"true_{name}"]
        assert np.sqrt(np.square(error).mean()) < tolerance
    assert not (tracks["target_id"] == tracks["vehicle_id"]).any()


def test_every_kind_of_object_gets_its_class(dense_run: Path) -> None:
    tracks = read_table(dense_run, "tracks")
    settled = tracks[tracks.groupby(["vehicle_id", "track_id"]).cumcount() >= 3]
    known = settled[settled["true_motion_state"].notna()]
    assert {"stationary", "same_direction", "oncoming"} <= set(known["true_motion_state"])
    assert (known["motion_state"] == known["true_motion_state"]).mean() > 0.99
    beside = known[known["target_id"].str.startswith("roadside:")]
    assert set(beside["true_motion_state"]) == {"stationary"}


def test_the_warnings_target_is_a_track_in_path_and_truly_the_leader(dense_run: Path) -> None:
    steps, tracks = read_table(dense_run, "steps"), read_table(dense_run, "tracks")
    targets = steps[steps["fcw_track_id"].notna() & steps["lane_locked"]]
    assert len(targets) > 200
    key = ["vehicle_id", "time_s", "track_id"]
    joined = targets.rename(columns={"fcw_track_id": "track_id"}).merge(tracks, on=key)
    assert len(joined) == len(targets)
    assert joined["in_path"].all()
    # SUMO has a vehicle follow the leader on the new lane as soon as either begins to change lanes
    close = joined[(joined["true_gap_m"] < 60.0) & joined["true_leader_visible"]]
    error = close["fcw_gap_m"] - close["true_gap_m"]
    assert error.abs().median() < 1.0
    assert (error.abs() < 3.0).mean() > 0.98
    free = steps[steps["fcw_track_id"].isna()]
    assert free[["fcw_gap_m", "fcw_ttc_s", "fcw_shown_distance_m"]].isna().all(axis=None)


def test_lamps_and_buzzer_belong_to_the_state(dense_run: Path) -> None:
    steps = read_table(dense_run, "steps")
    assert set(steps["fcw_state"]) <= {"inactive", "ready", "reminder", "danger", "suppressed"}
    assert (steps["fcw_lamp_danger"] == (steps["fcw_state"] == "danger")).all()
    assert (steps.loc[steps["fcw_state"] == "ready", "fcw_buzzer"] == "silent").all()


def test_roadside_rows_are_thinned_and_vehicles_rows_are_not(dense_run: Path) -> None:
    tracks = read_table(dense_run, "tracks")
    beside = tracks["target_id"].isna() | tracks["target_id"].fillna("").str.startswith("roadside:")
    every = np.sort(tracks.loc[beside, "time_s"].unique())
    assert np.diff(every) == pytest.approx(1.0, abs=1e-6)
    vehicles = tracks[~beside].groupby(["vehicle_id", "track_id"])["time_s"]
    assert vehicles.diff().dropna().median() == pytest.approx(0.1, abs=1e-6)
    assert pd.notna(tracks["time_s"]).all()
