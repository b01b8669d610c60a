"""Recorded input: a video, a folder of images or one image, as 320x240 grey frames."""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image

from camera_synth.camera import HEIGHT_PX, WIDTH_PX
from sumo_net.arrays import Array
from sumo_net.settings import InputError
from sumo_net.start_up import standard_error

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")
IMAGE_STEP_S = 0.1  # between the images of a folder, where nobody says
MOST_PIXELS = 10**8  # of a picture; 8K video has a third of that
MOST_BYTES = 2**30  # of an image's file
MOST_LOST = 250  # unreadable frames of a video in a row, after which it is given up


class FootageError(InputError):
    """An error in a recording, as one line."""


class Recorded(NamedTuple):
    """One frame of a recording."""

    number: int  # from 0, unreadable frames counted
    time_s: float
    grey: Array  # (240, 320) uint8
    size_px: tuple[int, int]  # width and height before scaling
    picture: Array  # (height, width, 3) uint8 BGR as recorded


class Footage(NamedTuple):
    """A recording before it is read."""

    path: Path
    images: tuple[Path, ...]  # empty for a video
    step_s: float  # between frames
    frame_count: int  # 0 if the file does not say

    @property
    def is_still(self) -> bool:
        """One image alone."""
        return len(self.images) == 1


def open_footage(source: Path | str, image_step_s: float = IMAGE_STEP_S) -> Footage:
    """Determine the kind of `source`; images of a folder are `image_step_s` apart.

    Hidden files of a folder are no images. Raises FootageError if there is nothing to read.
    """
    path = Path(source)
    if not path.exists():
        raise FootageError(f"{path}: no such file or folder")
    if path.is_dir():
        images = sorted(
            (
                file
                for file in path.iterdir()
                if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
            ),
            key=_natural,
        )
        if not images:
            raise FootageError(f"{path}: holds no image ({', '.join(IMAGE_SUFFIXES)})")
        return Footage(path, tuple(images), image_step_s, len(images))
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return Footage(path, (path,), image_step_s, 1)
    video = _open_video(path)
    rate = video.get(cv2.CAP_PROP_FPS)
    count = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    video.release()
    return Footage(path, (), 1.0 / rate if 1.0 <= rate <= 1000.0 else image_step_s, max(count, 0))


def frames(footage: Footage) -> Iterator[Recorded]:
    """The frames in order, without those that cannot be read. Raises FootageError if none can."""
    yield from _images(footage) if footage.images else _video(footage)


def _images(footage: Footage) -> Iterator[Recorded]:
    failed: list[FootageError] = []
    for index, image in enumerate(footage.images):
        try:
            picture = read_picture(image)
        except FootageError as error:
            failed.append(error)
        else:
            yield _recorded(index, footage.step_s, picture)
    if len(failed) == len(footage.images):
        raise failed[0]


def _video(footage: Footage) -> Iterator[Recorded]:
    """A frame counts as unreadable while fewer have been tried than the file states."""
    video = _open_video(footage.path)
    try:
        index = found = lost = 0
        while lost <= MOST_LOST:
            there, picture = video.read()
            if there:
                yield _recorded(index, footage.step_s, picture)
                found, lost = found + 1, 0
            elif index < footage.frame_count:
                lost += 1
            else:
                break
            index += 1
    finally:
        video.release()
    if found == 0:
        raise FootageError(f"{footage.path}: holds no frame that can be read")


def read_picture(path: Path) -> Array:
    """One image, BGR, its own size.

    Raises FootageError if it cannot be read, or would have more than MOST_PIXELS when unpacked: a file of a
    kilobyte may declare a gigapixel.
    """
    _check_size(path)
    try:
        data = np.fromfile(path, np.uint8)
        with standard_error():  # to which decoders write
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except OSError as error:
        raise FootageError(f"{path}: cannot be read ({error.strerror})") from None
    except cv2.error:
        image = None
    if image is None:
        raise FootageError(f"{path}: is not an image that can be read")
    return np.asarray(image)


def _check_size(path: Path) -> None:
    """Check the image's size by its header alone."""
    try:
        if not path.is_file():  # reading a pipe would block
            raise FootageError(f"{path}: is not a file")
        if path.stat().st_size > MOST_BYTES:
            raise FootageError(f"{path}: is larger than {MOST_BYTES} bytes")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's own bound is lower
            with Image.open(path) as header:
                width, height = header.size
    except Image.DecompressionBombError:
        width = height = MOST_PIXELS
    except FootageError:
        raise
    except PermissionError as error:
        raise FootageError(f"{path}: cannot be read ({error.strerror})") from None
    except Exception:  # Pillow's plug-ins raise anything: struct.error, SyntaxError, KeyError and others
        raise FootageError(f"{path}: is not an image that can be read") from None
    _refuse_giants(path, width, height)


def _refuse_giants(path: Path, width: float, height: float) -> None:
    if width * height > MOST_PIXELS:
        raise FootageError(f"{path}: its pictures have more than {MOST_PIXELS} pixels: not accepted")


def _open_video(path: Path) -> Any:
    if not path.is_file():
        raise FootageError(f"{path}: is not a file")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        video = cv2.VideoCapture(str(path))
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not video.isOpened():
        raise FootageError(f"{path}: is neither an image nor a video that can be read")
    _refuse_giants(path, video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
    return video


def _recorded(index: int, step_s: float, picture: Array) -> Recorded:
    # the brightest channel: by its luminance, yellow paint is as grey as concrete
    grey = np.asarray(cv2.max(cv2.max(picture[..., 0], picture[..., 1]), picture[..., 2]))
    height, width = grey.shape
    if (width, height) != (WIDTH_PX, HEIGHT_PX):
        # shrink by area averaging, so that thin far markings keep their share of the pixels
        shrink = width >= WIDTH_PX and height >= HEIGHT_PX
        grey = cv2.resize(
            grey, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
        )
    return Recorded(index, index * step_s, np.ascontiguousarray(grey), (width, height), picture)


def _natural(path: Path) -> list[Any]:
    """Key that sorts frame2 before frame10."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", path.stem)]
