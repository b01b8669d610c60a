"""A drive as a video, or one step of it as a still: `sumo-adas video`."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from analysis.drive import (
    Drive,
    DriveError,
    check_vehicle,
    load_drive,
    most_interesting,
    times_of,
    vehicles_with_frames,
)
from analysis.drive_picture import DrivePictures
from analysis.film import Film
from analysis.footage import IMAGE_SUFFIXES
from sumo_net.arrays import Array
from sumo_net.step import STEP_S


def make_video(
    directory: Path,
    out: Path,
    vehicle_id: str | None = None,
    begin_s: float | None = None,
    end_s: float | None = None,
    *,
    tell: Callable[[str], None] = lambda words: None,
) -> Drive:
    """Write the drive of a vehicle of a run to `out`, as a video or, by the suffix, a still.

    If the run kept no frames of it, the run is repeated first (`analysis.replay`). `vehicle_id` defaults to
    the most interesting vehicle. begin_s, end_s: SUMO time; a still shows begin_s, by default the most
    interesting step. `tell` receives messages for the user, a line each.

    Raises DriveError, FilmError, SettingsError or TrafficError.
    """
    if vehicle_id is None:
        vehicle_id = most_interesting(directory)
    else:
        check_vehicle(directory, vehicle_id)
    _check_time(vehicle_id, times_of(directory, vehicle_id), begin_s, end_s)
    with Film(out, STEP_S) as film:
        if vehicle_id not in vehicles_with_frames(directory):
            from analysis.replay import replay, settings_to_repeat

            settings_to_repeat(directory)  # or nothing is announced
            tell(f"no frames of '{vehicle_id}' were kept: the run is repeated for them")
            replay(directory, [vehicle_id], quiet=False)
        drive = load_drive(directory, vehicle_id)
        for note in drive.notes:
            tell(f"note: {note}")
        pictures = DrivePictures(drive)
        for index in _shown(drive, begin_s, end_s, out.suffix.lower() in IMAGE_SUFFIXES):
            film.add(pictures.of(int(index)))
    return drive


def moment_of_interest(drive: Drive) -> int:
    """Step of the first departure for which a warning was due, else of a warning, else the middle."""
    due = drive.departures[drive.departures["warned"].notna()]
    for times in (
        due["crossing_s"],
        drive.warnings.loc[drive.warnings["level"] == "danger", "start_s"] + STEP_S,
        drive.warnings["start_s"] + STEP_S,
    ):
        if len(times):
            return int(np.abs(drive.time_s - float(times.iloc[0])).argmin())
    return len(drive.time_s) // 2


def _check_time(vehicle_id: str, time_s: Array, begin_s: float | None, end_s: float | None) -> None:
    """Raises DriveError if the vehicle (its steps at `time_s`) did not drive in that time."""
    for name, value in (("from", begin_s), ("to", end_s)):
        if value is not None and not math.isfinite(value):
            raise DriveError(f"{name} = {value}: must be a time in s")
    if not _within(time_s, begin_s, end_s).any():
        raise DriveError(
            f"'{vehicle_id}' has no step in that time: it drove from {time_s[0]:.1f} s to {time_s[-1]:.1f} s"
        )


def _within(time_s: Array, begin_s: float | None, end_s: float | None) -> Array:
    first = -math.inf if begin_s is None else begin_s - STEP_S / 2
    last = math.inf if end_s is None else end_s + STEP_S / 2
    return (time_s >= first) & (time_s <= last)


def _shown(drive: Drive, begin_s: float | None, end_s: float | None, still: bool) -> list[int]:
    if still and begin_s is None:
        return [moment_of_interest(drive)]
    _check_time(drive.vehicle_id, drive.time_s, begin_s, end_s)  # of an earlier run, frames may be missing
    shown = np.flatnonzero(_within(drive.time_s, begin_s, end_s)).tolist()
    return shown[:1] if still else shown
