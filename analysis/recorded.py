"""The lane chain on recorded footage: lanes.csv, points.csv, and an overlay video.

lanes.csv has one row per frame, points.csv the borders' image points, y down from the top of the 320x240
image. Rows are written as they are computed, so that an interruption keeps them.
"""

import csv
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from analysis.ahead import Ahead, Driven
from analysis.film import Film
from analysis.footage import IMAGE_STEP_S, Footage, Recorded, frames, open_footage
from analysis.overlay import draw
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Camera, projection
from plugin.configuration import read_camera
from plugin.lane import genetic, refine
from plugin.lane.estimate import BORDER_Y, Borders, LaneEstimate
from plugin.lane.geometry import lane_estimate_from_borders
from plugin.lane.refine import Refine
from sumo_net.arrays import Array
from sumo_net.randomness import stream_key
from sumo_net.settings import SettingsError

MODES = ("refined", "paper")
LANE_COLUMNS = [
    "frame",
    "time_s",
    "lane_locked",
    "lane_score",
    "left_a",
    "left_b",
    "left_c",
    "right_a",
    "right_b",
    "right_c",
    "lateral_offset_m",
    "heading_error_rad",
    "curvature_1pm",
    "lane_width_m",
]
WARNING_COLUMNS = ["tlc_s", "tlc_side", "ldw_state"]  # besides, where the speed is given
POINT_COLUMNS = ["frame", "side", "x_px", "y_px"]
POINT_ROWS_DOWN = np.arange(HEIGHT_PX - 5, 0, -5)  # every 5 rows, from near to far
PAPER_ROWS = 150  # rows that the published search uses

_WHOLE = 0.98  # some containers miscount their frames
UNKNOWN_MPS = 25.0  # where the speed is not given
PITCH_STD_RAD = 0.006  # real cameras pitch more than simulated ones, and their files are less exact
LOOKS_AT_FIRST = 3  # at a first frame: the start, and what confirms a weak one
LOOKS_AT_STILL = 6
CUT_GREY = 8.0  # larger mean change between images of a folder: a different place
CUT_GREY_VIDEO = 30.0


class Found(NamedTuple):
    """Results of one frame."""

    lane: LaneEstimate  # of one vehicle
    borders: Borders
    rows: Array  # (R,) y up from the bottom, ascending
    columns: Array  # (2, R) of the left and right border, NaN where not seen


def detect(
    source: Path | str,
    camera: Path | str | Camera,
    out: Path | str,
    overlay: Path | str | None = None,
    mode: str = "refined",
    speed_mps: float | None = None,
    image_step_s: float = IMAGE_STEP_S,
) -> Path:
    """Find the lane in a video, a folder of images or an image; writes into `out` and returns it.

    camera: a camera file, or a Camera for the 320x240 image. speed_mps: footage does not tell it; without it
    there are no times to crossing and no warnings, and the tracker and the overlay's path take UNKNOWN_MPS.
    image_step_s: between the images of a folder, or the frames of a video that does not tell its rate.
    Raises SettingsError for the camera or a setting, FootageError for footage that cannot be read.
    """
    if mode not in MODES:
        raise SettingsError(f"mode = {mode!r}: allowed are {', '.join(MODES)}")
    if speed_mps is not None and not (math.isfinite(speed_mps) and 0.0 <= speed_mps <= 100.0):
        raise SettingsError(f"speed_mps = {speed_mps}: must be 0 to 100")
    calibrated = camera if isinstance(camera, Camera) else read_camera(Path(camera))
    footage = open_footage(source, image_step_s)
    next(frames(footage), None)  # raises before anything is written if the first cannot be read
    directory = Path(out)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"out = {directory}: cannot be made ({error.strerror})") from None
    with ExitStack() as stack:
        lanes = stack.enter_context((directory / "lanes.csv").open("w", newline="", buffering=1))
        points = stack.enter_context((directory / "points.csv").open("w", newline="", buffering=1))
        lane_rows, point_rows = csv.writer(lanes), csv.writer(points)
        lane_rows.writerow(LANE_COLUMNS if speed_mps is None else LANE_COLUMNS + WARNING_COLUMNS)
        point_rows.writerow(POINT_COLUMNS)
        film = stack.enter_context(Film(Path(overlay), footage.step_s)) if overlay is not None else None
        speed = UNKNOWN_MPS if speed_mps is None else speed_mps
        driven = Driven(calibrated, speed, footage.step_s)
        for recorded, found, fresh in _look(footage, calibrated, mode, speed):
            ahead = driven.step(found.lane, fresh)
            if speed_mps is None:
                ahead = ahead._replace(tlc_s=math.nan, side="", state="")
            warned = [] if speed_mps is None else _warning_row(ahead)
            lane_rows.writerow(_lane_row(recorded, found) + warned)
            point_rows.writerows(_point_rows(recorded.number, found))
            if film is not None:
                film.add(_drawn(recorded, found, ahead))
    return directory


def summary(directory: Path, footage: Footage) -> list[str]:
    """Lines on what `detect` has written."""
    lanes = pd.read_csv(directory / "lanes.csv", keep_default_na=False)
    lines = [f"{'frames':21} {len(lanes)}", f"{'lane found':21} {100 * lanes['lane_locked'].mean():.1f} %"]
    if "ldw_state" in lanes:
        warned = lanes["ldw_state"].str.startswith("warning")
        lines.append(f"{'departure warnings':21} {(warned & ~warned.shift(fill_value=False)).sum()}")
    return lines + _unreadable(lanes["frame"].to_numpy(), footage)


def _unreadable(frame: Array, footage: Footage) -> list[str]:
    """Notes on frames that are not among the numbers `frame` (N,) of those read."""
    notes = []
    inside = np.setdiff1d(np.arange(frame[-1]), frame)
    if footage.images:
        inside = np.setdiff1d(np.arange(footage.frame_count), frame)
    elif frame[-1] + 1 < _WHOLE * footage.frame_count:
        notes.append(
            f"note: {len(frame)} of {footage.frame_count} frames could be read: is the file cut short?"
        )
    if len(inside):
        first = footage.images[inside[0]].name if footage.images else f"frame {inside[0]}"
        more = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
        notes.insert(0, f"note: {first}{more} could not be read: left out")
    return notes


def _look(
    footage: Footage, camera: Camera, mode: str, speed_mps: float
) -> Iterator[tuple[Recorded, Found, bool]]:
    """Every frame, what the lane detector of `mode` finds in it, and whether it begins another scene."""
    chain = _Paper(camera) if mode == "paper" else _Refined(camera, footage.step_s, speed_mps)
    cut = CUT_GREY if footage.images else CUT_GREY_VIDEO
    before: Array | None = None
    for recorded in frames(footage):
        small = cv2.resize(recorded.grey, (32, 24), interpolation=cv2.INTER_AREA).astype(float)
        fresh = before is None or float(np.abs(small - before).mean()) > cut
        before = small
        looks = LOOKS_AT_STILL if footage.is_still else LOOKS_AT_FIRST
        yield recorded, chain.look(recorded.grey[None], fresh, looks), fresh


class _Refined:
    """The default mode: the published search while there is no lane, then the tracker."""

    def __init__(self, camera: Camera, step_s: float, speed_mps: float) -> None:
        self._projection = projection(camera)
        self._refine = Refine(step_s=min(step_s, 1.0), pitch_std_rad=PITCH_STD_RAD)
        self._numbers = genetic.search_numbers(genetic.GeneticSearch())
        self._speed = np.array([speed_mps])
        self._rows = HEIGHT_PX - 1.0 - POINT_ROWS_DOWN
        self._state = refine.init(1)

    def look(self, frame: Array, fresh: bool, looks: int) -> Found:
        """One frame; `fresh`: unrelated to the one before."""
        if fresh:
            self._state = refine.init(1)
        lane = self._step(frame, np.zeros(1) if fresh else self._speed)
        if fresh or not lane.locked[0]:
            # without history: the same frame again, to confirm and settle a start
            for _ in range(looks - 1):
                lane = self._step(frame, np.zeros(1))
        reach = max(float(self._state.reach_m[0]), 10.0)
        columns = refine.border_columns(self._state, self._rows, self._projection, reach)[0]
        fitted = refine.border_columns(self._state, BORDER_Y, self._projection)
        borders = refine.parabolas(self._state, fitted, BORDER_Y)
        return Found(lane, borders, self._rows, columns)

    def _step(self, frame: Array, speed_mps: Array) -> LaneEstimate:
        borders = None
        if refine.needs_search(self._state)[0]:
            fresh = genetic.init(np.array([stream_key(0, "recording", "search")], np.uint64))
            _, borders = genetic.search(frame, fresh, self._numbers)
        self._state, lane = refine.step(
            frame, borders, None, self._state, self._projection, speed_mps, self._refine
        )
        return lane


class _Paper:
    """The published search on every frame."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._numbers = genetic.search_numbers(genetic.GeneticSearch())
        self._state = self._fresh()
        self._rows = np.arange(4.0, PAPER_ROWS, 5.0)

    @staticmethod
    def _fresh() -> genetic.SearchState:
        return genetic.init(np.array([stream_key(0, "recording", "search")], np.uint64))

    def look(self, frame: Array, fresh: bool, looks: int) -> Found:
        """One frame; `looks` is ignored: the source uses each frame once."""
        del looks
        if fresh:
            self._state = self._fresh()
        self._state, borders = genetic.search(frame, self._state, self._numbers)
        lane = lane_estimate_from_borders(borders, self._state.shifted, self._camera)
        y = self._rows
        columns = np.stack([(a * y + b) * y + c for a, b, c in (borders.left[0], borders.right[0])])
        return Found(lane, borders, y, columns if lane.locked[0] else np.full_like(columns, np.nan))


def _lane_row(recorded: Recorded, found: Found) -> list[str]:
    lane, borders = found.lane, found.borders
    locked = bool(lane.locked[0])
    numbers = [
        *(borders.left[0] if locked else [math.nan] * 3),
        *(borders.right[0] if locked else [math.nan] * 3),
        lane.lateral_offset_m[0],
        lane.heading_error_rad[0],
        lane.curvature_1pm[0],
        lane.lane_width_m[0],
    ]
    return [
        str(recorded.number),
        f"{recorded.time_s:.3f}",
        str(int(locked)),
        f"{lane.score[0]:.4f}",
        *(f"{value:.7g}" if math.isfinite(value) else "" for value in numbers),
    ]


def _warning_row(ahead: Ahead) -> list[str]:
    return [f"{ahead.tlc_s:.3f}" if math.isfinite(ahead.tlc_s) else "", ahead.side, ahead.state]


def _point_rows(index: int, found: Found) -> Iterator[list[str]]:
    for side, columns in zip(("left", "right"), found.columns, strict=True):
        for y, x in zip(found.rows, columns, strict=True):
            if 0.0 <= x <= WIDTH_PX - 1.0:
                yield [str(index), side, f"{x:.2f}", f"{HEIGHT_PX - 1.0 - y:.0f}"]


def _drawn(recorded: Recorded, found: Found, ahead: Ahead) -> Array:
    lane = found.lane
    text = (
        f"offset {lane.lateral_offset_m[0]:+.2f} m  curvature {lane.curvature_1pm[0]:+.5f} 1/m  "
        f"score {lane.score[0]:.2f}"
        if lane.locked[0]
        else "no lane"
    )
    if math.isfinite(ahead.tlc_s):
        text += f"  crossing {ahead.side} in {ahead.tlc_s:.1f} s"
    if ahead.state.startswith("warning"):
        text += f"  {ahead.state.upper()}"
    return draw(recorded.picture, found.rows, found.columns, ahead.path, text)
