"""Data of the drive viewer: pictures at a rate that fits the page, and the values drawn over them."""

import base64
import json
from typing import Any

import cv2
import numpy as np

from analysis.camera_view import path_in_image
from analysis.drive import Drive
from analysis.metrics import unsignalled
from analysis.report.reading import json_ready
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, projection
from plugin.tracking.classification import NAMES
from sumo_net.arrays import Array

DRIVES_BYTES = 6_500_000  # of all drives on a page: with Plotly and the timelines it stays under 15 MB
JPEG_QUALITY = 50
_RATES = (1, 2, 3, 4, 5, 10, 20)  # steps per picture
_BORDER_POINTS, _ROAD_POINTS, _PATH_POINTS = 30, 12, 10
_AHEAD_M = 160.0


def viewer_data(drive: Drive, most_bytes: int = DRIVES_BYTES) -> dict[str, Any]:
    """The drive in the form of the page's script; at least every 20th step, however small `most_bytes`."""
    tracks = {float(time): rows for time, rows in drive.tracks.groupby(drive.tracks["time_s"].round(2))}
    every = _every(drive, tracks, most_bytes)
    shown = range(0, len(drive.time_s), every)
    return {
        "vehicle": drive.vehicle_id,
        "every": every,
        "start": _start(drive),
        "width": WIDTH_PX,
        "height": HEIGHT_PX,
        "classes": list(NAMES),
        "steps": [_step(drive, i, tracks) for i in shown],
        "notes": [f"A picture every {every / 10:g} s", *drive.notes],
    }


def _start(drive: Drive) -> float:
    """Time at which the viewer starts: shortly before the first departure or warning."""
    meant = unsignalled(drive.departures)
    lane = drive.warnings[drive.warnings["kind"] == "ldw"]
    for moments in (meant["crossing_s"], lane["start_s"], drive.warnings["start_s"]):
        if len(moments):
            return round(float(moments.min()) - 0.5, 2)
    return round(float(drive.time_s[0]), 2)


def _every(drive: Drive, tracks: dict[float, Any], most_bytes: int) -> int:
    """The least reduction with which the steps fit, by the size of a sample of them."""
    count = len(drive.time_s)
    sample = np.unique(np.linspace(0, count - 1, min(count, 12)).astype(int)).tolist()
    mean = sum(len(json.dumps(_step(drive, i, tracks), separators=(",", ":"))) for i in sample) / len(sample)
    return next((every for every in _RATES if mean * count / every <= most_bytes), _RATES[-1])


def _jpeg(frame: Array) -> bytes:
    _, data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


def _step(drive: Drive, i: int, tracks: dict[float, Any]) -> dict[str, Any]:
    row = drive.steps.iloc[i]
    seen = tracks.get(round(float(drive.time_s[i]), 2))
    return {
        "time": round(float(drive.time_s[i]), 2),
        "picture": base64.b64encode(_jpeg(drive.frames[i])).decode(),
        "borders": [_border(drive, i, side) for side in (0, 1)],
        "path": _path_px(drive, i),
        "ground": _points(drive.path_m[i], _PATH_POINTS),
        "road": _road(drive, i),
        "bodies": [_rounded(body, (1, 1, 2, 1, 1)) for body in drive.bodies_m[i] if np.isfinite(body).all()],
        "tracks": [] if seen is None else [_track(one) for one in seen.itertuples()],
        "speed": _number(row["speed_mps"], 1),
        "offset": _number(row["lateral_offset_m"], 2),
        "tlc": _number(row["tlc_s"], 2),
        "side": _text(row["tlc_side"]),
        "lane": _text(row["ldw_state"]),
        "rear": _text(row["fcw_state"]),
        "ttc": _number(row["fcw_ttc_s"], 1),
        "gap": _number(row["fcw_gap_m"], 1),
    }


def _border(drive: Drive, i: int, side: int) -> list[list[float]]:
    """Column and row (down from the top) of the border where it was seen."""
    columns, rows = drive.border_px[i, side], drive.border_rows
    seen = np.flatnonzero(np.isfinite(columns) & (columns > -WIDTH_PX) & (columns < 2 * WIDTH_PX))
    if not len(seen):
        return []
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, _BORDER_POINTS).astype(int))]
    return [[round(float(columns[k]) + 0.5, 1), round(HEIGHT_PX - 0.5 - float(rows[k]), 1)] for k in chosen]


def _path_px(drive: Drive, i: int) -> list[list[float]]:
    points = path_in_image(drive.path_m[i, :, 0], drive.path_m[i, :, 1], projection(drive.camera))
    fits = points[np.isfinite(points).all(axis=1) & (np.abs(points) < 4 * WIDTH_PX).all(axis=1)]
    return [[round(float(x) + 0.5, 1), round(HEIGHT_PX - 0.5 - float(y), 1)] for x, y in fits]


def _points(path: Array, most: int) -> list[list[float]]:
    known = path[np.isfinite(path).all(axis=1)]
    if not len(known):
        return []
    chosen = known[np.unique(np.linspace(0, len(known) - 1, most).astype(int))]
    return [_rounded(point, (1, 2)) for point in chosen]


def _road(drive: Drive, i: int) -> list[list[Any]]:
    """[kind, points] of the painted lines ahead."""
    found = []
    for line, kind in zip(drive.road_m[i], drive.road_kind[i], strict=True):
        known = np.isfinite(line).all(axis=1) & (line[:, 0] > -20.0) & (line[:, 0] < _AHEAD_M) & (kind > 0)
        if known.sum() > 1:
            found.append([int(kind[known][0]), _points(line[known], _ROAD_POINTS)])
    return found


def _track(track: Any) -> list[float | int | None]:
    """x, y, class, in path, measured, time to collision."""
    state = _text(track.motion_state)
    return [
        _number(track.x_m, 1),
        _number(track.y_m, 1),
        NAMES.index(state) if state in NAMES else 0,
        int(bool(json_ready(track.in_path))),
        int(bool(json_ready(track.measured))),
        _number(track.ttc_s, 1),
    ]


def _rounded(values: Array, decimals: tuple[int, ...]) -> list[float]:
    return [round(float(value), d) for value, d in zip(values, decimals, strict=True)]


def _number(value: Any, decimals: int) -> float | None:
    value = json_ready(value)
    return None if value is None else round(float(value), decimals)


def _text(value: Any) -> str:
    return str(json_ready(value) or "")
