"""Bird's-eye view of the road, heading up: true lines and bodies, and the vehicle's estimates."""

import functools
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis import canvas
from analysis.drive import Drive
from camera_synth.camera import Camera, projection, vehicle_from_image
from sumo_net.arrays import Array
from sumo_net.polyline import stations
from sumo_net.road_table import DASHED, NO_MARKING

BEHIND_M, AHEAD_M = 12.0, 108.0
_ROAD, _PAINT, _BODY = (58, 54, 50), (120, 116, 112), (140, 136, 132)
_LEGEND_PX = 54
_LENGTH_M, _WIDTH_M, _NOSE_M = 4.3, 1.8, 1.6  # of the drawn own vehicle
CLASSES = {
    "same_direction": (canvas.GREEN, "same direction"),
    "oncoming": (canvas.VERMILION, "oncoming"),
    "stationary": (canvas.GREY, "stationary"),
    "stopped_was_same_direction": (canvas.ORANGE, "stopped"),
    "stopped_was_oncoming": (canvas.ORANGE, "stopped"),
    "unclassified": (canvas.WHITE, "unclassified"),
}


class View(NamedTuple):
    """Transform from metres in the vehicle frame to pixels, with equal scales."""

    width: int
    height: int
    scale: float  # pixels per metre

    def place(self, forward: Array, left: Array) -> Array:
        """(P, 2) column and row."""
        column = self.width / 2 - np.asarray(left, float) * self.scale
        row = self.height - _LEGEND_PX - (np.asarray(forward, float) + BEHIND_M) * self.scale
        return np.stack([column, row], axis=-1)


def birds_eye(drive: Drive, index: int, tracks: pd.DataFrame, width: int, height: int) -> Array:
    """A BGR picture of step `index`; `tracks` are the rows of that step."""
    view = View(width, height, (height - _LEGEND_PX) / (AHEAD_M + BEHIND_M))
    picture = np.full((height, width, 3), canvas.DARK, np.uint8)
    _road(picture, view, drive.road_m[index], drive.road_kind[index])
    _distances(picture, view)
    _bodies(picture, view, drive.bodies_m[index])
    ground = border_on_ground(drive.border_px[index], drive.border_rows, drive.camera)
    for points, colour in zip(ground, (canvas.LEFT, canvas.RIGHT), strict=True):
        canvas.line(picture, view.place(points[:, 0], points[:, 1]), colour, 2)
    path = drive.path_m[index]
    canvas.line(picture, view.place(np.r_[0.0, path[:, 0]], np.r_[0.0, path[:, 1]]), canvas.PATH, 2)
    _own(picture, view)
    target = drive.steps["fcw_track_id"].iloc[index]
    _tracks(picture, view, tracks, None if pd.isna(target) else int(target), drive, index)
    _legend(picture, width, height)
    return picture


def border_on_ground(columns: Array, rows: Array, camera: Camera) -> Array:
    """(2, R, 2) forward and left of border points, in the image columns (2, R) at rows (R,); NaN: a gap."""
    seen_by = projection(camera)
    out = np.full((2, len(rows), 2), np.nan)
    for side in range(2):
        for at in np.flatnonzero(np.isfinite(columns[side])).tolist():
            out[side, at] = vehicle_from_image(float(columns[side, at]), float(rows[at]), seen_by)
    return out


def _road(picture: Array, view: View, lines: Array, kinds: Array) -> None:
    known = [line for line in lines if np.isfinite(line).any()]
    if len(known) >= 2:
        right, left = (line[np.isfinite(line).all(axis=1)] for line in (known[0], known[-1]))
        around = np.concatenate([right, left[::-1]])
        canvas.area(picture, view.place(around[:, 0], around[:, 1]), _ROAD)
    for line, kind in zip(lines, kinds, strict=True):
        painted = (kind != NO_MARKING)[:, None] & np.isfinite(line)
        points = np.where(painted, line, np.nan)
        # a symbol for a dashed line: the dashes' true places are only in the camera image
        dashed = bool((kind[painted[:, 0]] == DASHED).any())
        points = _dashes(points) if dashed else points
        canvas.line(picture, view.place(points[:, 0], points[:, 1]), _PAINT, 1)


def _dashes(points: Array) -> Array:
    """(P, 2) points of dashes of 3 m and gaps of 3 m along a line, NaN after each dash."""
    finite = points[np.isfinite(points).all(axis=1)]
    if len(finite) < 2:
        return finite
    along = stations(finite)
    at = np.arange(0.0, along[-1], 6.0)[:, None] + np.array([0.0, 3.0, np.nan])
    return np.stack([np.interp(at.ravel(), along, column) for column in finite.T], axis=1)


def _distances(picture: Array, view: View) -> None:
    for distance in range(20, int(AHEAD_M), 20):
        _, row = view.place(np.array(distance), np.array(0.0))
        canvas.line(picture, np.array([[0.0, row], [8.0, row]]), canvas.GREY, 1)
        canvas.text(picture, f"{distance} m", 12, float(row), 12, canvas.GREY)


def _box(forward: float, left: float, heading: float, length: float, width: float) -> Array:
    along = np.array([np.cos(heading), np.sin(heading)]) * length / 2
    across = np.array([-np.sin(heading), np.cos(heading)]) * width / 2
    centre = np.array([forward, left])
    return np.array([centre + i * along + j * across for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))])


def _bodies(picture: Array, view: View, bodies: Array) -> None:
    for body in bodies[np.isfinite(bodies).all(axis=1)]:
        corners = _box(*body.tolist())
        canvas.line(picture, view.place(corners[:, 0], corners[:, 1]), _BODY, 1, closed=True)


def _own(picture: Array, view: View) -> None:
    corners = _box(_NOSE_M - _LENGTH_M / 2, 0.0, 0.0, _LENGTH_M, _WIDTH_M)
    canvas.area(picture, view.place(corners[:, 0], corners[:, 1]), canvas.WHITE)


def _tracks(
    picture: Array, view: View, tracks: pd.DataFrame, target: int | None, drive: Drive, index: int
) -> None:
    for track in tracks.itertuples():
        colour, _ = CLASSES.get(str(track.motion_state), CLASSES["unclassified"])
        (column, row) = view.place(np.array(track.x_m), np.array(track.y_m))
        if row > view.height - _LEGEND_PX:
            continue
        small = str(track.motion_state) == "stationary"
        canvas.dot(picture, column, row, 3 if small else 5, colour, -1 if track.measured else 1)
        if track.track_id == target:
            row = max(row, 14.0)  # beyond the view: drawn at its upper edge
            canvas.dot(picture, column, row, 11, canvas.WHITE, 2)
            gap = float(drive.steps["fcw_gap_m"].iloc[index])
            canvas.text(picture, f"{gap:.0f} m", column + 17, row, 14, bold=True, back=canvas.DARK)


@functools.cache
def _legend_entries() -> tuple[tuple[canvas.Colour, str], ...]:
    return tuple(dict.fromkeys(CLASSES.values()))


def _legend(picture: Array, width: int, height: int) -> None:
    picture[height - _LEGEND_PX :] = canvas.DARK
    place = [(14, 38), (14, 18), (164, 38), (164, 18), (284, 38)]
    for (colour, words), (x, up) in zip(_legend_entries(), place, strict=True):
        canvas.dot(picture, x, height - up, 5, colour)
        canvas.text(picture, words, x + 12, height - up, 13)
    canvas.dot(picture, 284, height - 18, 6, canvas.WHITE, 2)
    canvas.text(picture, "warning's target", 296, height - 18, 13)
