"""Videos for browsers and players: H.264 in MP4, VP9 in WebM; stills if the suffix is that of an image."""

import contextlib
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import av
import cv2
import numpy as np

from analysis.footage import IMAGE_SUFFIXES
from sumo_net.arrays import Array


class FilmError(ValueError):
    """Why a video or a still cannot be written, in one line."""


class _Coding(NamedTuple):
    codec: str
    pixels: str
    options: dict[str, str]


# browsers and phones decode only even sides and 4:2:0
_H264 = _Coding("libx264", "yuv420p", {"preset": "veryfast", "crf": "25", "movflags": "+faststart"})
_VP9 = _Coding(
    "libvpx-vp9",
    "yuv420p",
    {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "crf": "32", "b": "0"},
)
_MJPEG = _Coding("mjpeg", "yuvj420p", {"qscale": "3"})
_CODINGS = {".mp4": _H264, ".m4v": _H264, ".mov": _H264, ".mkv": _H264, ".webm": _VP9, ".avi": _MJPEG}


class Film:
    """Writes pictures to a video, or to a still if the file's suffix is that of an image."""

    def __init__(self, path: Path, step_s: float) -> None:
        """Raises FilmError for an unknown suffix, or a folder that cannot be made."""
        suffix = path.suffix.lower()
        if suffix not in _CODINGS and suffix not in IMAGE_SUFFIXES:
            known = ", ".join((*_CODINGS, *IMAGE_SUFFIXES))
            raise FilmError(f"{path}: its suffix must be one of {known}")
        if path.is_dir():
            raise FilmError(f"{path}: is a directory")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FilmError(f"{path.parent}: cannot be made ({error.strerror})") from None
        _check_writable(path)
        self._path = path
        self._rate = Fraction(1.0 / step_s).limit_denominator(1001)
        self._coding = _CODINGS.get(suffix)
        self._container: Any = None
        self._stream: Any = None

    def add(self, picture: Array) -> None:
        """Append one picture, (height, width, 3) uint8 BGR, scaled to the first one's size.

        Raises FilmError if it cannot be written.
        """
        if self._coding is None:
            with contextlib.suppress(cv2.error):
                if cv2.imwrite(str(self._path), picture):
                    return
            raise FilmError(f"{self._path}: cannot be written")
        try:
            if self._container is None:
                self._open(picture)
            size = (self._stream.width, self._stream.height)
            if (picture.shape[1], picture.shape[0]) != size:
                picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="bgr24")
            self._container.mux(self._stream.encode(frame))
        except (OSError, av.FFmpegError) as error:
            raise FilmError(f"{self._path}: cannot be written as a video ({_reason(error)})") from None

    def _open(self, picture: Array) -> None:
        assert self._coding is not None
        options = dict(self._coding.options)
        whole = {"movflags": options.pop("movflags")} if "movflags" in options else {}
        if self._path.suffix.lower() == ".mkv":
            whole = {}
        self._container = av.open(str(self._path), "w", options=whole)
        self._stream = self._container.add_stream(self._coding.codec, rate=self._rate, options=options)
        self._stream.width, self._stream.height = picture.shape[1] // 2 * 2, picture.shape[0] // 2 * 2
        self._stream.pix_fmt = self._coding.pixels

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file; an interrupted video can be played up to that point."""
        if self._container is not None:
            try:
                self._container.mux(self._stream.encode())
                self._container.close()
            except (OSError, av.FFmpegError) as failed:
                if kind is None:
                    reason = _reason(failed)
                    raise FilmError(f"{self._path}: cannot be written as a video ({reason})") from None


def _check_writable(path: Path) -> None:
    """Check before hours of work that the file can be written. It is left unchanged."""
    there = path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        raise FilmError(f"{path}: cannot be written ({error.strerror})") from None
    if not there:
        path.unlink()


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error)
