"""Drawing on BGR pictures: colours for colour-blind readers, subpixel lines, text."""

import functools
from pathlib import Path
from typing import Literal

import cv2
import matplotlib as mpl
import numpy as np
from PIL import ImageFont

from sumo_net.arrays import Array

Colour = tuple[int, int, int]  # BGR

# the palette of Okabe and Ito
SKY, ORANGE, GREEN, YELLOW = (233, 180, 86), (0, 159, 230), (115, 158, 0), (66, 228, 240)
VERMILION, PURPLE, WHITE, GREY, DARK = (
    (0, 94, 213),
    (167, 121, 204),
    (255, 255, 255),
    (150, 150, 150),
    (36, 32, 28),
)
LEFT, RIGHT, PATH = SKY, PURPLE, YELLOW

_SHIFT = 4  # coordinates in sixteenths of a pixel


def line(picture: Array, points: Array, colour: Colour, width: int = 2, closed: bool = False) -> None:
    """A line through points (P, 2) of column and row, with a gap where one is not finite."""
    fits: Array = np.asarray(np.isfinite(points).all(axis=1))
    fits[fits] = (np.abs(points[fits]) < 4 * max(picture.shape)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[False, fits, False].astype(np.int8)))
    parts = [
        np.rint(points[begin:end] * (1 << _SHIFT)).astype(np.int32)
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    cv2.polylines(picture, parts, closed, colour, width, cv2.LINE_AA, shift=_SHIFT)


def area(picture: Array, points: Array, colour: Colour) -> None:
    """A filled polygon, (P, 2) of column and row; nothing if one is not finite."""
    if np.isfinite(points).all() and (np.abs(points) < 4 * max(picture.shape)).all():
        cv2.fillPoly(
            picture, [np.rint(points * (1 << _SHIFT)).astype(np.int32)], colour, cv2.LINE_AA, shift=_SHIFT
        )


def dot(picture: Array, column: float, row: float, radius: float, colour: Colour, width: int = -1) -> None:
    """A disc, or a ring where `width` is positive."""
    if np.isfinite(column) and np.isfinite(row) and max(abs(column), abs(row)) < 4 * max(picture.shape):
        centre = round(column * (1 << _SHIFT)), round(row * (1 << _SHIFT))
        cv2.circle(picture, centre, round(radius * (1 << _SHIFT)), colour, width, cv2.LINE_AA, shift=_SHIFT)


def text(
    picture: Array,
    words: str,
    column: float,
    row: float,
    size: int = 18,
    colour: Colour = WHITE,
    anchor: Literal["left", "centre", "right"] = "left",
    bold: bool = False,
    back: Colour | None = None,
) -> None:
    """Text centred vertically at `row`, on a background of colour `back`; clipped to the picture."""
    mask = _words(words, size, bold)
    height, width = mask.shape
    left = round(column - {"left": 0.0, "centre": 0.5, "right": 1.0}[anchor] * width)
    top = round(row - height / 2)
    if back is not None:
        cv2.rectangle(picture, (left - 4, top - 1), (left + width + 3, top + height), back, -1)
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + width, picture.shape[1]), min(top + height, picture.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    part = mask[y0 - top : y1 - top, x0 - left : x1 - left, None]
    under = picture[y0:y1, x0:x1]
    under[:] = (under + part * (np.array(colour, np.float32) - under) + 0.5).astype(np.uint8)


@functools.lru_cache(maxsize=4096)
def _words(words: str, size: int, bold: bool) -> Array:
    """(height, width) float32, 0 to 1; the same height for all texts of a size, so that lines do not jump."""
    font = _font(size, bold)
    ascent, descent = font.getmetrics()
    shown = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in words)
    mask, offset = font.getmask2(shown, mode="L", anchor="ls")
    width, height = mask.size
    out = np.zeros((ascent + descent, max(width + max(offset[0], 0), 1)), np.float32)
    if width and height:
        top = max(ascent + offset[1], 0)
        drawn = np.array(mask, np.float32).reshape(height, width)[: ascent + descent - top]
        out[top : top + len(drawn), max(offset[0], 0) : max(offset[0], 0) + width] = drawn / 255.0
    return out


@functools.cache
def _font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    # comes with matplotlib; has Greek, Cyrillic and other letters of vehicle ids
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)
