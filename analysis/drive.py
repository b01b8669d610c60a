"""Recorded drives: one vehicle's camera frames with detected borders, predicted paths and radar tracks."""

import difflib
import json
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Camera
from plugin.capture import FRAMES, OWNER, folder_name
from plugin.record import read_table
from sumo_net.arrays import Array
from sumo_net.settings import SettingsError, read


class DriveError(ValueError):
    """A drive that cannot be shown; the message is for users."""


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """T steps of one equipped vehicle; row i of `steps` belongs to frame i. Vehicle frame: ISO 8855."""

    vehicle_id: str
    run_id: str
    time_s: Array  # (T,) SUMO time
    frames: Array  # (T, 240, 320) uint8, what the camera saw
    steps: pd.DataFrame  # T rows of the table `steps`
    tracks: pd.DataFrame  # its radar tracks of every scan, roadside objects included
    warnings: pd.DataFrame  # its rows of these tables
    departures: pd.DataFrame
    conflicts: pd.DataFrame
    camera: Camera
    path_m: Array  # (T, H, 2) predicted path, forward and left, 0.1 s apart; NaN where unknown
    border_px: Array  # (T, 2, R) columns of the left and the right marking's centres; NaN where not seen
    border_rows: Array  # (R,) their y, up from the bottom row, ascending
    bodies_m: Array  # (T, M, 5) truth: forward, left of the centre, heading, length, width; NaN for unused
    road_m: Array  # (T, B, J, 2) truth: forward and left of painted lines from right to left; NaN for unused
    road_kind: Array  # (T, B, J) sumo_net.road_table: NO_MARKING, SOLID, DASHED
    notes: tuple[str, ...] = ()  # remarks for the viewer


def vehicles_with_frames(directory: Path) -> list[str]:
    """Ids of the vehicles whose frames lie beside the tables in `directory`, sorted."""
    return sorted(str(about["vehicle_id"]) for about in _owners(directory))


def vehicles_of(directory: Path) -> list[str]:
    """Ids of the run's equipped vehicles in the order in which they appeared. Raises DriveError."""
    return [str(name) for name in _table(directory, "steps")["vehicle_id"].unique()]


def most_interesting(directory: Path, among: Iterable[str] | None = None) -> str:
    """The vehicle with most departures, then danger warnings, then warnings, then steps.

    Only those in `among`, if given. Raises DriveError if no vehicle drove.
    """
    steps = _table(directory, "steps")
    names = list(steps["vehicle_id"].unique()) if among is None else list(among)
    if not names:
        raise DriveError(f"{directory}: no equipped vehicle drove")
    warnings = _table(directory, "warnings")
    departures = _table(directory, "departures")
    counts = [
        departures.loc[departures["warned"].notna(), "vehicle_id"],
        warnings.loc[warnings["level"] == "danger", "vehicle_id"],
        warnings["vehicle_id"],
        steps["vehicle_id"],
    ]
    by_name = [column.value_counts() for column in counts]
    return str(max(names, key=lambda name: [int(count.get(name, 0)) for count in by_name]))


def load_drive(directory: Path, vehicle_id: str | None = None) -> Drive:
    """The recorded drive of a vehicle, by default of the most interesting one that has frames.

    Raises DriveError if it has no frames: `analysis.replay.replay` makes them.
    """
    directory = Path(directory)
    available = vehicles_with_frames(directory)
    if vehicle_id is None:
        steps = _table(directory, "steps")
        rows = set(steps["vehicle_id"].unique())
        shown = [name for name in available if name in rows]
        if not shown:
            raise DriveError(f"{directory}: holds no frames of a vehicle (run with --frames N, or replay it)")
        vehicle_id = most_interesting(directory, shown)
    if vehicle_id not in available:
        check_vehicle(directory, vehicle_id)
        raise DriveError(
            f"{directory}: holds no frames of '{vehicle_id}' (run with --frames N, or replay it)"
        )
    return _load(directory, vehicle_id)


def check_vehicle(directory: Path, vehicle_id: str) -> None:
    """Raises DriveError, with the most similar id, if the run has no equipped vehicle of this id."""
    names = vehicles_of(directory)
    if not names:
        raise DriveError(f"{directory}: no equipped vehicle drove")
    if vehicle_id not in names:
        raise DriveError(f"{directory}: {unknown_vehicle(vehicle_id, names)}")


def unknown_vehicle(vehicle_id: str, names: Sequence[str]) -> str:
    """What is said of an id that is none of the `names`."""
    near = difflib.get_close_matches(vehicle_id, names, n=1)
    others = f"equipped are {', '.join(names[:5])}" + (", …" if len(names) > 5 else "")
    return f"no equipped vehicle '{vehicle_id}': " + (f"did you mean '{near[0]}'?" if near else others)


def times_of(directory: Path, vehicle_id: str) -> Array:
    """Times (T,) of the vehicle's steps, ascending. Raises DriveError."""
    steps = _table(directory, "steps")
    return np.sort(steps.loc[steps["vehicle_id"] == vehicle_id, "time_s"].to_numpy(float))


def _load(directory: Path, vehicle_id: str) -> Drive:
    folder = directory / FRAMES / folder_name(vehicle_id)
    about = json.loads((folder / OWNER).read_text(encoding="utf-8"))
    marks = _marks(folder)
    all_steps = _table(directory, "steps")
    steps = all_steps[all_steps["vehicle_id"] == vehicle_id].sort_values("time_s")
    times = np.round(steps["time_s"].to_numpy(float), 2)
    shown = np.round(marks["time_s"], 2)
    _, at, row = np.intersect1d(shown, times, return_indices=True)
    if not len(at):
        raise DriveError(f"{directory}: no step of '{vehicle_id}' has both a row and a frame")
    steps = steps.iloc[row].reset_index(drop=True)
    tracks = read_table(folder, "tracks")
    tracks = tracks[tracks["time_s"].round(2).isin(shown[at])].reset_index(drop=True)
    notes = [str(note) for note in about.get("notes", [])]
    if len(at) < len(times):
        notes.append(f"frames of {len(at)} of its {len(times)} steps")
    try:
        camera = read(Camera, about["camera"], str(folder / OWNER))
    except (KeyError, SettingsError) as error:
        raise DriveError(f"{folder / OWNER}: names no camera ({error})") from None
    events = {}
    for name in ("warnings", "departures", "conflicts"):
        table = _table(directory, name)
        events[name] = table[table["vehicle_id"] == vehicle_id].reset_index(drop=True)
    return Drive(
        vehicle_id=vehicle_id,
        run_id=str(about.get("run_id", "")),
        time_s=marks["time_s"][at],
        frames=_frames(folder, at),
        steps=steps,
        tracks=tracks,
        camera=camera,
        path_m=marks["path_m"][at],
        border_px=marks["border_px"][at],
        border_rows=marks["border_rows"],
        bodies_m=marks["bodies_m"][at],
        road_m=marks["road_m"][at],
        road_kind=marks["road_kind"][at],
        notes=tuple(notes),
        **events,
    )


def _owners(directory: Path) -> list[dict[str, Any]]:
    found = []
    for file in (Path(directory) / FRAMES).glob(f"*/{OWNER}"):
        try:
            about = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        whole = isinstance(about, dict) and about.get("vehicle_id") is not None
        if whole and any(file.parent.glob("marks-*.npz")):
            found.append(about)
    return found


def _marks(folder: Path) -> dict[str, Array]:
    parts = []
    for file in sorted(folder.glob("marks-*.npz")):
        try:
            with np.load(file, allow_pickle=False) as part:
                parts.append(dict(part))
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise DriveError(f"{file}: cannot be read ({error})") from None
    if not parts:
        raise DriveError(f"{folder}: holds no frames")
    rows = {"border_rows": parts[0].pop("border_rows")}
    return rows | {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _frames(folder: Path, at: Array) -> Array:
    frames = np.empty((len(at), HEIGHT_PX, WIDTH_PX), np.uint8)
    for frame, number in zip(frames, at.tolist(), strict=True):
        file = folder / f"{number:06}.png"
        try:
            image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_GRAYSCALE)
        except (OSError, cv2.error):
            image = None
        if image is None or image.shape != frame.shape:
            raise DriveError(f"{file}: is missing, or not a frame of this project")
        frame[:] = image
    return frames


def _table(directory: Path, name: str) -> pd.DataFrame:
    try:
        return read_table(Path(directory), name)
    except FileNotFoundError as error:
        raise DriveError(f"{error}") from None
