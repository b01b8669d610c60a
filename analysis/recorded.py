"""The lane chain on recorded footage: lanes.csv, points.csv, and an overlay video.

lanes.csv has a row a frame, points.csv the borders' image points, y down from the top of the 320x240 image.
Rows are written as they come, so that an interruption keeps them.
"""

import csv
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from analysis.camera_view import path_in_image
from analysis.film import Film
from analysis.footage import Footage, FootageError, Recorded, frames, open_footage
from analysis.overlay import draw
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Camera, Projection, projection
from plugin.lane import genetic, refine
from plugin.lane.estimate import Borders, LaneEstimate
from plugin.lane.geometry import lane_estimate_from_borders
from plugin.lane.refine import Refine
from plugin.motion import observer
from plugin.motion.observer import ObserverSettings
from plugin.motion.prediction import PredictionSettings, predict, predictor
from sumo_net.randomness import stream_key
from sumo_net.settings import SettingsError, read, read_toml
from sumo_net.vehicle import Vehicle

Array = np.ndarray[Any, Any]

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
POINT_COLUMNS = ["frame", "side", "x_px", "y_px"]
POINT_ROWS_DOWN = np.arange(HEIGHT_PX - 5, 0, -5)  # every 5 rows, from near to far
PAPER_ROWS = 150  # what the published search looks at

LOOKS_AT_FIRST = 3  # at a first frame: the start, and what confirms a weak one
LOOKS_AT_STILL = 6
CUT_GREY = 8.0  # mean change between images of a folder from which on they are different places
CUT_GREY_VIDEO = 30.0


class Found(NamedTuple):
    """What one frame gave."""

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
    speed_mps: float = 25.0,
) -> Path:
    """Find the lane in a video, a folder of images or an image; writes into `out` and returns it.

    camera: a camera file, or a Camera for the 320x240 image. speed_mps: footage does not tell it. Raises
    SettingsError for the camera or a setting, FootageError for footage that cannot be read.
    """
    if mode not in MODES:
        raise SettingsError(f"mode = {mode!r}: allowed are {', '.join(MODES)}")
    if not (math.isfinite(speed_mps) and 0.0 <= speed_mps <= 100.0):
        raise SettingsError(f"speed_mps = {speed_mps}: must be 0 to 100")
    calibrated = camera if isinstance(camera, Camera) else _read_camera(Path(camera))
    footage = open_footage(source)
    next(frames(footage), None)  # where not even the first can be read, nothing is written
    directory = Path(out)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"out = {directory}: cannot be made ({error.strerror})") from None
    with ExitStack() as stack:
        lanes = stack.enter_context((directory / "lanes.csv").open("w", newline="", buffering=1))
        points = stack.enter_context((directory / "points.csv").open("w", newline="", buffering=1))
        lane_rows, point_rows = csv.writer(lanes), csv.writer(points)
        lane_rows.writerow(LANE_COLUMNS)
        point_rows.writerow(POINT_COLUMNS)
        film = stack.enter_context(Film(Path(overlay), footage.step_s)) if overlay is not None else None
        path = _Path(calibrated, speed_mps, footage.step_s) if film is not None else None
        for index, (recorded, found) in enumerate(_look(footage, calibrated, mode, speed_mps)):
            lane_rows.writerow(_lane_row(index, recorded.time_s, found))
            point_rows.writerows(_point_rows(index, found))
            if film is not None and path is not None:
                film.add(_drawn(recorded, found, path.of(found.lane)))
    return directory


def _read_camera(path: Path) -> Camera:
    mapping = read_toml(path)
    inner = mapping.get("camera", mapping)
    if not isinstance(inner, dict):
        raise SettingsError(f"{path}: camera = {inner!r}: must be a table of camera settings")
    return read(Camera, inner, str(path))


def _look(footage: Footage, camera: Camera, mode: str, speed_mps: float) -> Iterator[tuple[Recorded, Found]]:
    """Every frame with what the lane detector of `mode` finds in it."""
    chain = _Paper(camera) if mode == "paper" else _Refined(camera, footage.step_s, speed_mps)
    cut = CUT_GREY if footage.images else CUT_GREY_VIDEO
    before: Array | None = None
    for recorded in frames(footage):
        small = cv2.resize(recorded.grey, (32, 24), interpolation=cv2.INTER_AREA).astype(float)
        fresh = before is None or float(np.abs(small - before).mean()) > cut
        before = small
        looks = LOOKS_AT_STILL if footage.is_still else LOOKS_AT_FIRST
        yield recorded, chain.look(recorded.grey[None], fresh, looks)


class _Refined:
    """The default mode: the published search where there is no lane, then the tracker."""

    def __init__(self, camera: Camera, step_s: float, speed_mps: float) -> None:
        self._projection = projection(camera)
        self._refine = Refine(step_s=min(step_s, 1.0))
        self._numbers = genetic.search_numbers(genetic.GeneticSearch())
        self._speed = np.array([speed_mps])
        self._rows = HEIGHT_PX - 1.0 - POINT_ROWS_DOWN
        self._state = refine.init(1)

    def look(self, frame: Array, fresh: bool, looks: int) -> Found:
        """One frame; `fresh`: it has nothing to do with the one before."""
        if fresh:
            self._state = refine.init(1)
        lane = self._step(frame, np.zeros(1) if fresh else self._speed)
        if fresh or not lane.locked[0]:
            # nothing is known from before: the same frame again, which confirms and settles a start
            for _ in range(looks - 1):
                lane = self._step(frame, np.zeros(1))
        reach = max(float(self._state.reach_m[0]), 10.0)
        columns = refine.border_columns(self._state, self._rows, self._projection, reach)[0]
        fitted = refine.border_columns(self._state, refine.PARABOLA_ROWS, self._projection)
        borders = refine.parabolas(self._state, fitted, refine.PARABOLA_ROWS)
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
        """One frame; the source looks once at each, whatever `looks`."""
        del looks
        if fresh:
            self._state = self._fresh()
        self._state, borders = genetic.search(frame, self._state, self._numbers)
        lane = lane_estimate_from_borders(borders, self._state.shifted, self._camera)
        y = self._rows
        columns = np.stack([(a * y + b) * y + c for a, b, c in (borders.left[0], borders.right[0])])
        return Found(lane, borders, y, columns if lane.locked[0] else np.full_like(columns, np.nan))


class _Path:
    """The predicted path, by the observer and the predictor of a run, in the image."""

    def __init__(self, camera: Camera, speed_mps: float, step_s: float) -> None:
        self._projection: Projection = projection(camera)
        self._speed = np.array([speed_mps])
        vehicle = Vehicle()
        preview = refine.preview_distance(self._projection)
        self._schedule = observer.schedule(vehicle, preview, ObserverSettings(), step_s)
        self._state = observer.init(1, self._schedule)
        self._predictor = predictor(vehicle, PredictionSettings(horizon_s=2.0))

    def of(self, lane: LaneEstimate) -> Array:
        """(H, 2) column and y of the next 2 s."""
        self._state, motion = observer.step(self._state, self._schedule, lane, self._speed)
        ahead = predict(motion, self._speed, self._predictor)
        if np.isfinite(ahead.left_m[0]).all():
            return path_in_image(ahead.forward_m[0], ahead.left_m[0], self._projection)
        # no motion is known yet, as in a still: on with the lane's curvature from the heading of now
        forward = np.arange(1.0, 2.0 * self._speed[0] + 1.0)
        return path_in_image(forward, 0.5 * lane.curvature_1pm[0] * forward**2, self._projection)


def _lane_row(index: int, time_s: float, found: Found) -> list[str]:
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
        str(index),
        f"{time_s:.3f}",
        str(int(locked)),
        f"{lane.score[0]:.4f}",
        *(f"{value:.7g}" if math.isfinite(value) else "" for value in numbers),
    ]


def _point_rows(index: int, found: Found) -> Iterator[list[str]]:
    for side, columns in zip(("left", "right"), found.columns, strict=True):
        for y, x in zip(found.rows, columns, strict=True):
            if 0.0 <= x <= WIDTH_PX - 1.0:
                yield [str(index), side, f"{x:.2f}", f"{HEIGHT_PX - 1.0 - y:.0f}"]


def _drawn(recorded: Recorded, found: Found, path: Array) -> Array:
    lane = found.lane
    text = (
        f"offset {lane.lateral_offset_m[0]:+.2f} m  curvature {lane.curvature_1pm[0]:+.5f} 1/m  "
        f"score {lane.score[0]:.2f}"
        if lane.locked[0]
        else "no lane"
    )
    return draw(recorded.picture, found.rows, found.columns, path, text)


__all__ = ["LANE_COLUMNS", "POINT_COLUMNS", "FootageError", "detect"]
