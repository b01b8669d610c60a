"""One step of a drive as a picture: annotated camera image, dashboard below, bird's-eye view beside."""

from typing import Any

import numpy as np
import pandas as pd

from analysis import canvas
from analysis.birds_eye import birds_eye
from analysis.camera_view import (
    draw_borders,
    draw_path,
    enlarged,
    path_in_image,
    place,
    points_in_image,
)
from analysis.dashboard import draw_dashboard
from analysis.drive import Drive
from camera_synth.camera import projection
from sumo_net.arrays import Array

WIDTH_PX, HEIGHT_PX = 1280, 720
_CAMERA = 832, 624
_SHOWN_AFTER_S = 1.0  # a crossing is shown for this long
_TARGET_UP_M = 0.8  # height of the pin on the warning's target


class DrivePictures:
    """The pictures of a drive by step."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._projection = projection(drive.camera)
        tracks = drive.tracks.assign(key=drive.tracks["time_s"].round(2))
        self._tracks = {float(str(key)): rows for key, rows in tracks.groupby("key")}
        self._none = drive.tracks.iloc[:0]

    def __len__(self) -> int:
        return len(self._drive.time_s)

    def of(self, index: int) -> Array:
        """Step `index` as a (720, 1280, 3) uint8 BGR picture."""
        drive = self._drive
        step = drive.steps.iloc[index]
        tracks = self._tracks.get(round(float(drive.time_s[index]), 2), self._none)
        picture = np.empty((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
        picture[: _CAMERA[1], : _CAMERA[0]] = self.camera(index, *_CAMERA)
        draw_dashboard(picture[_CAMERA[1] :, : _CAMERA[0]], step)
        picture[:, _CAMERA[0] :] = birds_eye(drive, index, tracks, WIDTH_PX - _CAMERA[0], HEIGHT_PX)
        picture[:, _CAMERA[0] - 1 : _CAMERA[0] + 1] = (90, 86, 82)
        self._titles(picture, index, step)
        return picture

    def camera(self, index: int, width: int, height: int) -> Array:
        """The camera's picture of step `index` with borders, path and target, (height, width, 3) BGR."""
        drive = self._drive
        picture = enlarged(drive.frames[index], width, height)
        draw_borders(picture, drive.border_rows, drive.border_px[index], 3)
        path = drive.path_m[index]
        draw_path(picture, path_in_image(path[:, 0], path[:, 1], self._projection), 3)
        self._target(picture, index)
        return picture

    def _target(self, picture: Array, index: int) -> None:
        step = self._drive.steps.iloc[index]
        if pd.isna(step["fcw_track_id"]):
            return
        tracks = self._tracks.get(round(float(self._drive.time_s[index]), 2), self._none)
        for track in tracks[tracks["track_id"] == step["fcw_track_id"]].itertuples():
            # at the radar's position, often a corner: the radar does not know the body's size
            ends = points_in_image(
                np.full(2, track.x_m), np.full(2, track.y_m), np.array([0.0, _TARGET_UP_M]), self._projection
            )
            points = place(ends[:, 0], ends[:, 1], picture)
            colour = canvas.VERMILION if str(step["fcw_state"]) == "danger" else canvas.GREEN
            canvas.line(picture, points, colour, 3)
            column, row = points[1].tolist()
            canvas.dot(picture, column, row, 9, colour)
            canvas.dot(picture, column, row, 9, canvas.WHITE, 2)

    def _titles(self, picture: Array, index: int, step: Any) -> None:
        drive, now = self._drive, float(self._drive.time_s[index])
        canvas.text(picture, f"{now:.1f} s   {_short(drive.vehicle_id)}", 14, 18, 17, back=canvas.DARK)
        cause = step["true_cause"]
        if pd.notna(cause) and cause != "lane_keeping":
            words = f"driver: {str(cause).replace('_', ' ')}"
            canvas.text(picture, words, 14, 44, 17, canvas.ORANGE, back=canvas.DARK)
        crossing = drive.departures["crossing_s"].to_numpy(float)
        for side in drive.departures["side"][(crossing <= now) & (now < crossing + _SHOWN_AFTER_S)]:
            canvas.text(
                picture, f"over the {side} border", _CAMERA[0] / 2, 80, 26, canvas.WHITE, "centre", True,
                canvas.VERMILION,
            )  # fmt: skip


def _short(name: str) -> str:
    return name if len(name) <= 48 else name[:47] + "…"
