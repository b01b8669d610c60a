"""The camera image with detected borders, predicted path and the warning's target."""

import cv2
import numpy as np

from analysis import canvas
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Projection, image_from_vehicle
from sumo_net.arrays import Array


def enlarged(frame: Array, width: int, height: int) -> Array:
    """A grey (240, 320) or BGR frame as a BGR picture of another size."""
    shrink = frame.shape[1] > width
    picture = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA if shrink else cv2.INTER_LINEAR)
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if picture.ndim == 2 else picture)


def place(x: Array, y: Array, picture: Array) -> Array:
    """(P, 2) column and row in `picture` of points of the 320x240 image, y up from the bottom."""
    height, width = picture.shape[:2]
    return np.stack(
        [(x + 0.5) * width / WIDTH_PX - 0.5, (HEIGHT_PX - 0.5 - y) * height / HEIGHT_PX - 0.5], -1
    )


def draw_borders(picture: Array, rows: Array, columns: Array, width: int = 2) -> None:
    """Draw borders: rows (R,) y from the bottom up, columns (2, R) left and right, NaN for a gap."""
    for column, colour in zip(columns, (canvas.LEFT, canvas.RIGHT), strict=True):
        canvas.line(picture, place(column, rows, picture), colour, width)


def draw_path(picture: Array, path: Array, width: int = 2) -> None:
    """Draw path (H, 2), column and y in the 320x240 image."""
    canvas.line(picture, place(path[:, 0], path[:, 1], picture), canvas.PATH, width)


def path_in_image(forward_m: Array, left_m: Array, projection: Projection) -> Array:
    """(H, 2) column and y of a path on the road; NaN behind the image plane."""
    return points_in_image(forward_m, left_m, np.zeros(len(forward_m)), projection)


def points_in_image(forward_m: Array, left_m: Array, up_m: Array, projection: Projection) -> Array:
    """(P, 2) column and y of points in the vehicle frame; NaN behind the image plane."""
    out = np.full((len(forward_m), 2), np.nan)
    for index, (forward, left, up) in enumerate(zip(forward_m, left_m, up_m, strict=True)):
        if np.isfinite(forward) and forward - projection.forward > 0.5:
            x, y, _ = image_from_vehicle(float(forward), float(left), float(up), projection)
            out[index] = x, y
    return out
