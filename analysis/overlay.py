"""Pictures with the found borders and the predicted path drawn in, as a video or a still."""

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np

from analysis.footage import IMAGE_SUFFIXES, FootageError
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Projection, image_from_vehicle

Array = np.ndarray[Any, Any]

GREATEST_WIDTH_PX = 960
LEFT_BGR, RIGHT_BGR, PATH_BGR, TEXT_BGR = (60, 60, 255), (80, 220, 60), (0, 200, 255), (255, 255, 255)
_CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".avi": "MJPG", ".mkv": "mp4v"}


class Overlay:
    """Writes drawn pictures to a video, or to a still where the file's suffix is an image's."""

    def __init__(self, path: Path, step_s: float) -> None:
        """Raises FootageError for a suffix that is neither a video's nor an image's."""
        suffix = path.suffix.lower()
        if suffix not in _CODECS and suffix not in IMAGE_SUFFIXES:
            known = ", ".join((*_CODECS, *IMAGE_SUFFIXES))
            raise FootageError(f"overlay = {path}: its suffix must be one of {known}")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path, self._step_s = path, step_s
        self._codec = _CODECS.get(suffix)
        self._writer: Any = None
        self._size = (0, 0)

    def add(self, picture: Array) -> None:
        """Append one picture; all get the first one's size. Raises FootageError where that fails."""
        if self._codec is None:
            if not cv2.imwrite(str(self._path), picture):
                raise FootageError(f"{self._path}: cannot be written")
            return
        if self._writer is None:
            self._size = (picture.shape[1] // 2 * 2, picture.shape[0] // 2 * 2)
            codec = cv2.VideoWriter.fourcc(*self._codec)
            self._writer = cv2.VideoWriter(str(self._path), codec, 1.0 / self._step_s, self._size)
            if not self._writer.isOpened():
                raise FootageError(f"{self._path}: cannot be written as a video")
        if (picture.shape[1], picture.shape[0]) != self._size:
            picture = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        self._writer.write(picture)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()


def draw(picture: Array, rows: Array, columns: Array, path: Array, text: str) -> Array:
    """A copy of `picture` (BGR, any size) with borders, path and a line of text.

    rows (R,) y from the bottom up and columns (2, R) of the left and right border, path (H, 2) column and y,
    all of the 320x240 image; NaN is not drawn.
    """
    height, width = picture.shape[:2]
    scale = min(1.0, GREATEST_WIDTH_PX / width)
    # never smaller than the frames that were looked at
    size = (max(round(width * scale), WIDTH_PX), max(round(height * scale), HEIGHT_PX))
    drawn = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    sx, sy = size[0] / WIDTH_PX, size[1] / HEIGHT_PX

    def place(x: Array, y: Array) -> Array:
        points = np.stack([(x + 0.5) * sx, (HEIGHT_PX - 0.5 - y) * sy], axis=1)
        fits = np.isfinite(points).all(axis=1) & (np.abs(points) < 4 * max(size)).all(axis=1)
        return np.rint(points[fits] * 16).astype(np.int32)

    for column, colour in zip(columns, (LEFT_BGR, RIGHT_BGR), strict=True):
        cv2.polylines(drawn, [place(column, rows)], False, colour, 2, cv2.LINE_AA, shift=4)
    cv2.polylines(drawn, [place(path[:, 0], path[:, 1])], False, PATH_BGR, 2, cv2.LINE_AA, shift=4)
    cv2.putText(drawn, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, TEXT_BGR, 1, cv2.LINE_AA)
    return np.asarray(drawn)


def path_in_image(forward_m: Array, left_m: Array, projection: Projection) -> Array:
    """(H, 2) column and y of a path on the road; NaN behind the image plane."""
    out = np.full((len(forward_m), 2), np.nan)
    for index, (forward, left) in enumerate(zip(forward_m, left_m, strict=True)):
        if np.isfinite(forward) and forward - projection.forward > 0.5:
            x, y, _ = image_from_vehicle(float(forward), float(left), 0.0, projection)
            out[index] = x, y
    return out
