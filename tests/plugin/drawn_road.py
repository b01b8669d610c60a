"""A flat road drawn by back-projecting every pixel: an oracle for the lane tests, simple and slow."""

import cv2
import numpy as np

from camera_synth.camera import Camera


def ground_of_pixels(camera, oversampling=2):
    """(forward, left) of the road point under each subpixel; NaN above the horizon."""
    step = 1.0 / oversampling
    column = np.arange(320 * oversampling) * step - 0.5 + step / 2
    row = np.arange(240 * oversampling) * step - 0.5 + step / 2
    x, y = np.meshgrid(column, 239.0 - row)
    # a ray in camera axes (right, up, ahead), turned by the pitch, meets the road
    right = (x - camera.center_x_px) / camera.focal_px
    up = (y - camera.center_y_px) / camera.focal_px
    ahead = np.cos(camera.pitch_rad) + np.sin(camera.pitch_rad) * up
    rise = -np.sin(camera.pitch_rad) + np.cos(camera.pitch_rad) * up
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(rise < -1e-6, -camera.height_m / rise, np.nan)
    forward, left = scale * ahead, -scale * right
    cos, sin = np.cos(camera.yaw_rad), np.sin(camera.yaw_rad)
    return cos * forward - sin * left + camera.forward_m, sin * forward + cos * left + camera.left_m


def draw(
    borders_m=(1.875, -1.875),
    *,
    slope=0.0,
    curvature=0.0,
    camera=None,
    line_m=0.15,
    dash_m=None,
    gap_m=9.0,
    phase_m=0.0,
    road=90.0,
    paint=200.0,
    sky=180.0,
    noise=2.0,
    seed=0,
):
    """(240, 320) uint8: markings centred on left = X₀ + slope·X + curvature·X²/2; dashed if dash_m is."""
    forward, left = ground_of_pixels(camera or Camera())
    grey = np.where(np.isnan(forward), sky, road)
    for border in borders_m:
        across = left - (border + slope * forward + curvature * forward**2 / 2)
        marked = np.abs(across) <= line_m / 2
        if dash_m is not None:
            marked &= (forward + phase_m) % (dash_m + gap_m) < dash_m
        grey[marked] = paint
    grey = grey.reshape(240, 2, 320, 2).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(grey, (3, 3), 0.6)
    grey += np.random.default_rng(seed).normal(0.0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
