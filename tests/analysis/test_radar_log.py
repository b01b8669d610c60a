"""Tracking recorded logs: reading, errors by line, gaps and jumps, and two recorded drives."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.radar_formats import FORMATS, comma2k19, load, track_recording, udacity
from analysis.radar_log import COLUMNS, LogError, read_log, rmse
from plugin.tracking.filters import FILTERS

HEADER = "time_s,range_m,range_rate_mps,azimuth_rad"
DATA = Path(os.environ.get("SUMO_ADAS_DATA", Path(__file__).parents[3] / "shared" / "data"))
UDACITY = DATA / "udacity_radar" / "obj_pose-laser-radar-synthetic-input.txt"
COMMA = DATA / "comma2k19_radar" / "radar.csv"


def write(path: Path, *lines: str) -> Path:
    file = path / "log.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def approach(times: np.ndarray, start: float = 80.0, speed: float = -5.0, extra: str = "") -> list[str]:
    return [f"{t:.3f},{start + speed * t:.4f},{speed},0.01{extra}" for t in times]


@pytest.mark.parametrize("name", FILTERS)
def test_a_log_is_tracked_and_written(tmp_path: Path, name: str) -> None:
    times = np.cumsum(np.tile([0.1, 0.05, 0.12], 12))
    file = write(tmp_path, HEADER, *approach(times))
    table = track_recording(file, tmp_path / "out", name)
    assert len(set(table["track_id"])) == 1
    assert list(table["time_s"]) == pytest.approx(list(times[2:]))  # confirmed by the third detection
    last = table.iloc[-1]
    assert last["range_m"] == pytest.approx(80 - 5 * times[-1], abs=0.2)
    assert last["ttc_s"] == pytest.approx(last["range_m"] / 5.0, rel=0.05)
    assert last["vx_mps"] == pytest.approx(-5.0, abs=0.1)  # no ego columns: the radar is at rest
    assert last["motion_state"] == "oncoming"
    assert pd.isna(last["target_id"]) or last["target_id"] == ""
    again = pd.read_csv(tmp_path / "out" / "tracks.csv")
    assert list(again.columns) == [column.name for column in COLUMNS]
    np.testing.assert_allclose(again["range_m"], table["range_m"])


def test_ego_motion_puts_objects_over_ground(tmp_path: Path) -> None:
    lines = approach(np.arange(20) * 0.1, speed=-20.0, extra=",20.0,0,0")
    file = write(tmp_path, f"{HEADER},ego_speed_mps,ego_acceleration_mps2,ego_yaw_rate_rps", *lines)
    last = track_recording(file, None).iloc[-1]
    assert last["vx_mps"] == pytest.approx(0.0, abs=0.2)
    assert last["motion_state"] == "stationary"


def test_several_rows_a_scan_given_targets_and_scans_that_saw_nothing(tmp_path: Path) -> None:
    lines = []
    for k in range(12):
        t = 0.1 * k
        if k == 6:
            lines.append(f"{t:.1f},,,,")
            continue
        lines += [f"{t:.1f},{50 - t:.2f},-1,0.0,red car", f"{t:.1f},{50 + t:.2f},1,0.002,7"]
    table = track_recording(write(tmp_path, f"{HEADER},target_id", *lines), tmp_path)
    assert set(table["target_id"]) == {"red car", "7"}
    assert table.groupby("target_id")["track_id"].nunique().tolist() == [1, 1]
    assert len(table) == 24
    assert table[~table["measured"]]["time_s"].unique().tolist() == [0.6]
    assert set(pd.read_csv(tmp_path / "tracks.csv", dtype=str)["target_id"]) == {"red car", "7"}


def test_a_gap_of_seconds_and_a_jump_end_tracks_and_start_them_anew(tmp_path: Path) -> None:
    times = np.arange(12) * 0.1
    gap = [*approach(times), *approach(times + 5.0, start=80.0)]
    table = track_recording(write(tmp_path, HEADER, *gap), None)
    assert table["track_id"].nunique() == 2
    assert table.groupby("track_id")["time_s"].min().tolist() == pytest.approx([0.2, 5.2])
    for target in ("", ",7"):
        head = HEADER + (",target_id" if target else "")
        jump = [*approach(times, extra=target), *approach(times + 1.2, start=140.0, extra=target)]
        table = track_recording(write(tmp_path, head, *jump), None)
        assert table["track_id"].nunique() == 2
        if target:
            at = table.groupby("track_id")["time_s"]
            assert at.max()[0] < at.min()[1]  # one target: never two tracks at once


def test_a_scan_written_twice_counts_once_and_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lines = approach(np.arange(10) * 0.1)
    once = track_recording(write(tmp_path, HEADER, *lines), None)
    assert caplog.messages == []
    double = write(tmp_path, HEADER, *[line for line in lines for _ in range(2)])
    assert load(double).dropped == 10
    pd.testing.assert_frame_equal(track_recording(double, None), once)
    assert caplog.messages == [f"{double}: 10 rows repeat others: left out"]


def test_a_comma_at_the_end_of_each_row_is_no_value(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    file = write(tmp_path, HEADER, *approach(np.arange(10) * 0.1, extra=","))
    assert set(track_recording(file, None)["track_id"]) == {0}
    assert not recwarn.list


GOOD = "0.0,50,-1,0.0"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "log.csv:1: is empty"),
        ([HEADER], "log.csv:2: holds no rows"),
        (["time_s,range_m,azimuth_rad", "0,50,0"], "log.csv:1: column range_rate_mps is missing"),
        (["time_s,range_m,range_rate_mps,azimuth_deg", GOOD], "log.csv:1: column azimuth_rad is missing"),
        ([HEADER + ",targetid", GOOD + ",1"], "column targetid is unknown: did you mean target_id?"),
        ([HEADER + ",range_m", GOOD + ",1"], "log.csv:1: column range_m is given twice"),
        ([HEADER, GOOD, "0.2,50,-1,0", "0.1,50,-1,0"], r"log.csv:4: time_s = '0.1' must not be before"),
        ([HEADER, GOOD, "0.1,50,nan,0"], r"log.csv:3: range_rate_mps = 'nan' must be a finite number"),
        ([HEADER, GOOD, "0.1,inf,-1,0"], r"log.csv:3: range_m = 'inf' must be a finite number"),
        ([HEADER, GOOD, "0.1,fifty,-1,0"], r"log.csv:3: range_m = 'fifty' must be a finite number"),
        ([HEADER, GOOD, ",50,-1,0"], r"log.csv:3: time_s = '' must be a finite number"),
        ([HEADER, GOOD, "0.1,50,,0"], r"log.csv:3: range_rate_mps = '' must be given"),
        ([HEADER, GOOD, "0.1,50"], r"log.csv:3: range_rate_mps = '' must be given"),
        ([HEADER, GOOD, "", "0.1,-3,-1,0"], r"log.csv:4: range_m = '-3' must not be negative"),
        (
            [HEADER, GOOD, "0.1,50,-1,3.2"],
            r"log.csv:3: azimuth_rad = '3.2' must lie within ±π; is it in degrees",
        ),
        ([HEADER, GOOD, "0.1,50,-1,0,7"], r"log.csv: is not a CSV file: .*line 3"),
        ([HEADER, "0.0,50,5,-1,0", "0.1,49,5,-1,0"], r"log.csv:2: holds 5 values for 4 columns.*decimal"),
        ([HEADER, "0,50,-1,0", "100,49.9,-1,0", "200,49.8,-1,0"], r"scans are 100 s apart.*milliseconds"),
        (
            [HEADER + ",target_id", GOOD + ",7", "0.1,50,-1,0,7", "0.1,60,-1,0,7"],
            r"log.csv:4: time_s = '0.1' is repeated for the same target_id",
        ),
        (
            [HEADER + ",ego_speed_mps", GOOD + ",20", "0.0,60,-1,0,21"],
            r"log.csv:3: ego_speed_mps = '21' must be the same in all rows of one scan",
        ),
        ([HEADER + ",ego_speed_mps", GOOD + ","], r"log.csv:2: ego_speed_mps = '' must be a finite number"),
    ],
)
def test_errors_name_file_line_and_column(tmp_path: Path, lines: list[str], said: str) -> None:
    file = write(tmp_path, *lines)
    if not lines:
        file.write_text("", encoding="utf-8")
    with pytest.raises(LogError, match=said) as caught:
        read_log(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_log_at_all_is_told(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path)
    (tmp_path / "picture.csv").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(LogError, match=r"picture\.csv"):
        read_log(tmp_path / "picture.csv")
    with pytest.raises(LogError, match="allowed are csv, comma2k19, udacity"):
        load(tmp_path / "none.csv", "mat")
    with pytest.raises(ValueError, match="allowed are imm"):
        track_recording(tmp_path / "none.csv", None, "kalman")


@pytest.mark.skipif(not UDACITY.exists(), reason="recorded data not here")
@pytest.mark.parametrize("name", ["imm", "adaptive", "ca"])
def test_udacity_object_is_followed_better_than_it_is_measured(name: str) -> None:
    log = load(UDACITY, "udacity")
    raw = udacity(UDACITY)
    measured = rmse(
        raw.assign(
            x_m=raw["range_m"] * np.cos(raw["azimuth_rad"]),
            y_m=raw["range_m"] * np.sin(raw["azimuth_rad"]),
            vx_mps=np.nan,
            vy_mps=np.nan,
        )
    )
    table = track_recording(UDACITY, None, name, "udacity")
    found = rmse(table)
    assert len(log.time_s) == len(table) == 250
    assert len(set(table["track_id"])) == 1
    assert set(table["target_id"]) == {"1"}
    for component in ("range_m", "range_rate_mps", "azimuth_rad", "x_m", "y_m"):
        assert found[component] < 0.7 * measured[component], component
    assert found["vx_mps"] < 0.6
    assert found["vy_mps"] < 0.7


@pytest.mark.skipif(not UDACITY.exists(), reason="recorded data not here")
@pytest.mark.parametrize("name", ["imm", "adaptive"])
def test_udacity_object_is_found_without_given_targets(name: str) -> None:
    table = track_recording(UDACITY, None, name, "udacity", own_association=True)
    assert len(set(table["track_id"])) == 1
    assert len(table) >= 240


@pytest.mark.skipif(not COMMA.exists(), reason="recorded data not here")
@pytest.mark.parametrize("name", ["imm", "adaptive"])
def test_comma_lead_car_is_one_track_whose_range_and_rate_agree(name: str) -> None:
    """Address 535 from 7 s on; the radar's own range and relative speed agree to 0.21 m/s RMS."""
    table = track_recording(COMMA, None, name, "comma2k19")
    lead = table[(table["target_id"] == "535.8")]
    assert len(set(lead["track_id"])) == 1
    assert lead["time_s"].min() < 7.5
    assert lead["time_s"].max() > 59.8
    slope = np.gradient(lead["range_m"], lead["time_s"])[5:-5]
    assert np.sqrt(np.mean((slope - lead["range_rate_mps"].iloc[5:-5]) ** 2)) < 0.21
    assert (lead["motion_state"].iloc[2:] == "same_direction").all()
    measured = comma2k19(COMMA).query("target_id == '535.8'").set_index("time_s")
    over_ground = measured["ego_speed_mps"] + measured["range_rate_mps"]
    difference = lead.set_index("time_s")["vx_mps"].iloc[5:] - over_ground
    assert np.sqrt(np.mean(difference**2)) < 0.3


@pytest.mark.skipif(not COMMA.exists(), reason="recorded data not here")
def test_comma_scans_are_the_radars_cycles() -> None:
    frame = comma2k19(COMMA)
    times = frame["time_s"].unique()
    assert len(frame) == 10100
    assert 1190 < len(times) < 1210
    assert np.diff(times).min() > 0.03
    assert not frame.duplicated(["time_s", "target_id"]).any()
    from_folder = comma2k19(COMMA.parent)
    pd.testing.assert_frame_equal(frame, from_folder)


@pytest.mark.skipif(not COMMA.exists(), reason="recorded data not here")
def test_comma_without_given_targets_keeps_the_lead_car() -> None:
    """Own association: from 10 s on some track is always within 2 m and 1° of address 535."""
    own = track_recording(COMMA, None, "imm", "comma2k19", own_association=True)
    frame = comma2k19(COMMA)
    lead = frame[(frame["target_id"] == "535.8") & (frame["time_s"] > 10.0)]
    held = []
    for row in lead.itertuples():
        now = own[np.isclose(own["time_s"], row.time_s)]
        near = (now["range_m"] - row.range_m).abs().lt(2.0) & (now["azimuth_rad"] - row.azimuth_rad).abs().lt(
            0.0175
        )
        held.append(near.any())
    assert np.mean(held) > 0.99


def test_formats_tell_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "fusion.txt").write_text("R\t1\t0.5\n", encoding="utf-8")
    with pytest.raises(LogError, match=r"fusion\.txt:1: must be"):
        load(tmp_path / "fusion.txt", "udacity")
    with pytest.raises(LogError, match=r"radar\.csv: no such file"):
        load(tmp_path, "comma2k19")
    assert set(FORMATS) == {"comma2k19", "udacity"}


def test_errors_are_known_also_where_the_tracker_associates(tmp_path: Path) -> None:
    """A row names the target of the detection that it took, none where it coasts."""
    time = np.arange(40) * 0.05
    both = []
    for name, begin, rate, azimuth in (("near", 20.0, -1.0, 0.1), ("far", 60.0, 2.0, -0.1)):
        one = pd.DataFrame({"time_s": time, "range_m": begin + rate * time, "range_rate_mps": rate})
        both.append(one.assign(azimuth_rad=azimuth, target_id=name, true_range_m=one["range_m"]))
    rows = pd.concat(both).sort_values(["time_s", "target_id"])
    gap = (rows["target_id"] == "near") & rows["time_s"].between(1.0, 1.1)
    rows[~gap].to_csv(tmp_path / "log.csv", index=False)
    table = track_recording(tmp_path / "log.csv", None, "imm", "csv", own_association=True)
    tracks = table.groupby("target_id")["track_id"].nunique()
    assert tracks.to_dict() == {"": 1, "near": 1, "far": 1}
    assert (table["target_id"] != "").eq(table["measured"]).all()
    assert rmse(table)["range_m"] < 0.05
