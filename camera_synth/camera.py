"""The pinhole camera over a flat road: intrinsics, pose, ground <-> image.

Image coordinates are those of Zhang et al. 2011: x is the column (0 left), y counts *up from the bottom row*;
the array row is `height - 1 - y`. Ground coordinates are the vehicle's, ISO 8855: forward, left, origin below
the centre of gravity.
"""

import math
from typing import NamedTuple

from pydantic import Field

from sumo_net.compile import kernel
from sumo_net.settings import settings

WIDTH_PX, HEIGHT_PX = 320, 240
PROCESSED_ROWS = 150  # rows from the bottom that lane detection reads
PROCESSED_FROM = HEIGHT_PX - PROCESSED_ROWS  # their first array row


@settings
class Camera:
    """Calibration of a forward camera. The defaults are inferred from Zhang et al. 2011, who give none: the
    optical axis meets the road 33.5 m ahead, the horizon lies at y = 157.
    """

    height_m: float = Field(1.34, gt=0, le=5, description="height above the road")
    focal_px: float = Field(925.0, gt=0, description="focal length for the 320x240 image")
    focal_y_px: float | None = Field(
        None, gt=0, description="vertical focal length, where the image was scaled unequally; none: focal_px"
    )
    pitch_rad: float = Field(
        math.atan(1.34 / 33.5), gt=-0.5, lt=0.5, description="pitch angle, downwards positive"
    )
    yaw_rad: float = Field(0.0, gt=-0.5, lt=0.5, description="yaw angle, left positive")
    center_x_px: float = Field(160.0, description="column of the principal point")
    center_y_px: float = Field(
        120.0, description="row of the principal point, counted up from the bottom row"
    )
    forward_m: float = Field(0.0, description="distance of the camera ahead of the centre of gravity")
    left_m: float = Field(0.0, description="distance of the camera left of the vehicle's axis")

    @property
    def horizon_y_px(self) -> float:
        """y of the horizon, 157 by default."""
        return self.center_y_px + self.vertical_focal_px * math.tan(self.pitch_rad)

    @property
    def vertical_focal_px(self) -> float:
        """The vertical focal length, px."""
        return self.focal_px if self.focal_y_px is None else self.focal_y_px

    def px_per_m(self, y_px: float) -> float:
        """Columns per metre across the road in row y: focal_px / depth, which is linear in y. Without yaw."""
        squeeze = self.focal_px / self.vertical_focal_px
        sin, cos = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        return (self.focal_px * sin + squeeze * (self.center_y_px - y_px) * cos) / self.height_m

    @property
    def preview_m(self) -> float:
        """D_L: distance in m of the preview point from the centre of gravity, see `preview_distance`."""
        return preview_distance(projection(self))


class Projection(NamedTuple):
    """The camera's parameters as kernels take them."""

    focal: float
    center_x: float
    center_y: float
    height: float
    cos_pitch: float
    sin_pitch: float
    cos_yaw: float
    sin_yaw: float
    forward: float
    left: float
    focal_y: float  # vertical; `focal` is the horizontal one


def projection(camera: Camera) -> Projection:
    """Kernel parameters of a camera."""
    return Projection(
        camera.focal_px,
        camera.center_x_px,
        camera.center_y_px,
        camera.height_m,
        math.cos(camera.pitch_rad),
        math.sin(camera.pitch_rad),
        math.cos(camera.yaw_rad),
        math.sin(camera.yaw_rad),
        camera.forward_m,
        camera.left_m,
        camera.vertical_focal_px,
    )


def preview_distance(p: Projection) -> float:
    """D_L: distance in m from the centre of gravity to where the optical axis meets the road.

    33.5 m where the camera looks down by less than 0.01 rad, or not at all.
    """
    if p.sin_pitch <= 0.01:
        return 33.5
    return p.forward + p.height * p.cos_pitch / p.sin_pitch * p.cos_yaw


@kernel
def image_from_vehicle(forward, left, up, p):  # type: ignore[no-untyped-def]
    """(x, y, depth) of a point in the vehicle frame, up metres above the road; valid where depth > 0."""
    f0, l0, u0 = forward - p.forward, left - p.left, up - p.height
    ahead = p.cos_yaw * f0 + p.sin_yaw * l0
    aside = -p.sin_yaw * f0 + p.cos_yaw * l0
    depth = p.cos_pitch * ahead - p.sin_pitch * u0
    rise = p.sin_pitch * ahead + p.cos_pitch * u0
    return p.center_x - p.focal * aside / depth, p.center_y + p.focal_y * rise / depth, depth


@kernel
def vehicle_from_image(x, y, p):  # type: ignore[no-untyped-def]
    """(forward, left) of the road point seen at (x, y); valid below the horizon only, NaN above it."""
    t = (y - p.center_y) / p.focal_y
    fall = p.sin_pitch - t * p.cos_pitch
    if fall <= 0.0:
        return math.nan, math.nan
    ahead = p.height * (p.cos_pitch + t * p.sin_pitch) / fall
    depth = p.cos_pitch * ahead + p.sin_pitch * p.height
    aside = (p.center_x - x) * depth / p.focal
    forward = p.cos_yaw * ahead - p.sin_yaw * aside
    left = p.sin_yaw * ahead + p.cos_yaw * aside
    return forward + p.forward, left + p.left
