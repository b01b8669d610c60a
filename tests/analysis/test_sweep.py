"""Sweeps: what other thresholds of the warnings would have given in the runs of a campaign."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.campaign.sweep import _judge_collision, _judge_lane, sweep, thresholds
from sumo_net.settings import SettingsError


def test_thresholds_include_both_ends_and_say_what_is_wrong() -> None:
    assert thresholds("0.2:0.5:0.1") == [0.2, 0.3, 0.4, 0.5]
    for text in ("1", "2:1:0.1", "0:1:0.1", "1:2:0", "a:b:c", "0.1:2:0.0001"):
        with pytest.raises(SettingsError, match="--threshold"):
            thresholds(text)


def drifting(tlc: list[float], side: str = "left", cause: str = "distraction") -> pd.DataFrame:
    n = len(tlc)
    return pd.DataFrame(
        {
            "vehicle_id": "a",
            "time_s": np.round(10.0 + 0.1 * np.arange(n), 1),
            "speed_mps": 25.0,
            "tlc_s": tlc,
            "tlc_side": side,
            "true_cause": cause,
            "true_heading_error_rad": 0.01,
            "true_lateral_speed_mps": 0.0,
            "fcw_ttc_s": tlc,
            "true_ttc_s": tlc,
        }
    )


def test_a_sweep_finds_the_lead_that_a_threshold_gives() -> None:
    """Time to crossing falls by 0.1 s per step: the warning leads by the threshold."""
    tlc = [3.0 - 0.1 * k for k in range(31)]
    crossing = {
        "vehicle_id": "a",
        "side": "left",
        "crossing_s": 13.0,
        "cause": "distraction",
        "speed_mps": 25.0,
    }
    departures = pd.DataFrame([crossing])
    for threshold in (0.5, 1.0, 2.0):
        counts, leads = _judge_lane(drifting(tlc), departures, threshold)
        assert counts == [1, 1, 0, 0]
        assert leads == pytest.approx([threshold], abs=0.051)
    counts, leads = _judge_lane(drifting(tlc, side="right"), departures, 1.0)
    assert (counts[:2], leads) == ([1, 0], [])
    counts, _ = _judge_lane(drifting(tlc), departures.iloc[:0], 1.0)
    assert counts == [0, 0, 0, 1]  # a drift that the driver corrected
    counts, _ = _judge_lane(drifting(tlc, cause="lane_change_signalled"), departures.iloc[:0], 1.0)
    assert counts == [0, 0, 0, 0]
    counts, _ = _judge_lane(drifting([3.0, 3.0, 0.4, 3.0, 3.0]), departures.iloc[:0], 1.0)
    assert counts == [0, 0, 0, 0]  # a single frame


def test_a_sweep_of_collision_warnings_counts_due_conflicts() -> None:
    ttc = [5.0 - 0.1 * k for k in range(40)]
    conflict = {"vehicle_id": "a", "start_s": 12.0, "end_s": 13.9, "critical_s": 13.1, "visible_s": 3.0}
    counts, leads = _judge_collision(drifting(ttc), pd.DataFrame([conflict]), 3.0)
    assert counts == [1, 1, 0, 0]
    assert leads == pytest.approx([1.1], abs=0.051)
    counts, leads = _judge_collision(drifting(ttc), pd.DataFrame([conflict]), 1.5)
    assert (counts[:2], leads) == ([1, 0], [])
    # a warning half a second after the conflict's end belongs to it, later ones do not, as in the run
    for end_s, nuisance in ((12.4, 0), (12.2, 1)):
        over = conflict | {"start_s": 11.0, "end_s": end_s, "critical_s": np.nan}
        counts, _ = _judge_collision(drifting(ttc), pd.DataFrame([over]), 2.2)  # from 12.8 s on
        assert counts == [1, 0, 0, nuisance]


def test_the_share_of_no_events_is_not_zero(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "0000-0000000001"
    run.mkdir(parents=True)
    drifting([3.0, 2.9, 2.8]).to_parquet(run / "steps.parquet")
    columns = ["vehicle_id", "side", "crossing_s", "cause", "speed_mps"]
    pd.DataFrame(columns=columns).to_parquet(run / "departures.parquet")
    (run / "summary.json").write_text("{}")
    table = sweep(str(tmp_path), "ldw", [0.5, 1.0])
    assert table["events"].tolist() == [0, 0]
    assert table["hit_rate"].isna().all()
