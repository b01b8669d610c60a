"""Frames of footage with detected borders and predicted path."""

import cv2
import numpy as np

from analysis import canvas
from analysis.camera_view import draw_borders, draw_path
from camera_synth.camera import HEIGHT_PX, WIDTH_PX
from sumo_net.arrays import Array

GREATEST_WIDTH_PX = 960


def draw(picture: Array, rows: Array, columns: Array, path: Array, text: str) -> Array:
    """A copy of `picture` (BGR, any size) with borders, path and a line of text.

    rows (R,) y from the bottom up and columns (2, R) of the left and right border, path (H, 2) column and y,
    all of the 320x240 image; NaN is not drawn.
    """
    height, width = picture.shape[:2]
    scale = min(1.0, GREATEST_WIDTH_PX / width)
    # at least the size of the processed frames
    size = (max(round(width * scale), WIDTH_PX), max(round(height * scale), HEIGHT_PX))
    drawn = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    draw_borders(drawn, rows, columns)
    draw_path(drawn, path)
    canvas.text(drawn, text, 8, 16, size=16 if size[0] >= 640 else 11, back=canvas.DARK)
    return drawn
