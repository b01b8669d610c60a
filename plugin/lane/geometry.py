"""Conversion between borders in the image and the road in the ground plane.

The road model is left = X₀ + e·X + K·X²/2 in the vehicle frame (X forward from the centre of gravity), with
the same heading e and curvature K for both borders. In the default camera's image it is
x = 160 - X₀·u/h - e·f - K·h·f²/(2u), u = 157 - y (X₀, e, K left positive; small angles): a parabola only
for K = 0.
"""

from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import WIDTH_PX, Camera, projection
from plugin.lane.estimate import Borders, LaneEstimate, blank
from plugin.lane.geometry_kernels import lane_estimate_kernel
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings


@settings
class Plausibility:
    """How borders of the published search become a lane, and when they are accepted."""

    farthest_m: float = Field(60.0, gt=5, description="border points further ahead are not used in the fit")
    least_score: float = Field(
        5.0, gt=0, description="objective F, in grey levels, from which a border counts"
    )
    full_score: float = Field(40.0, gt=0, description="objective F at which a border scores 1")
    least_width_m: float = Field(2.3, gt=0)
    greatest_width_m: float = Field(5.0, gt=0)
    greatest_heading: float = Field(
        0.35, gt=0, description="greatest slope of the lane against the vehicle's axis"
    )
    greatest_curvature_1pm: float = Field(0.02, gt=0)
    inset_m: float = Field(
        0.075,
        ge=0,
        description="distance from the border to the marking's inner edge, where the objective is greatest: "
        "half a marking's width",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.greatest_width_m <= self.least_width_m:
            raise ValueError(
                f"greatest_width_m = {self.greatest_width_m}: "
                f"must be above least_width_m = {self.least_width_m}"
            )
        return self


class PlausibilityNumbers(NamedTuple):
    """The parameters of Plausibility, as kernels take them."""

    farthest_m: float
    least_score: float
    full_score: float
    least_width_m: float
    greatest_width_m: float
    greatest_heading: float
    greatest_curvature_1pm: float
    inset_m: float


def lane_estimate_from_borders(
    borders: Borders, shifted: Array, camera: Camera, plausibility: Plausibility | None = None
) -> LaneEstimate:
    """The lane of n vehicles from their borders in the image (`paper` mode).

    Border points are projected to the road by the camera's exact geometry and fitted by the road model.
    `shifted` (n,) int8 is the search state's. A lane is locked if both borders are seen and its width,
    heading and curvature are plausible; otherwise its values are NaN.
    """
    n = len(borders.score)
    out = blank(n)._replace(
        left_unseen_m=np.zeros(n), right_unseen_m=np.zeros(n), lane_shift=np.array(shifted, np.int8)
    )
    lane_estimate_kernel(
        np.ascontiguousarray(borders.left, np.float64),
        np.ascontiguousarray(borders.right, np.float64),
        np.ascontiguousarray(borders.score, np.float64),
        projection(camera),
        camera.preview_m,
        WIDTH_PX,
        kernel_view(PlausibilityNumbers, plausibility or Plausibility()),
        out,
    )
    return out


def marking_centres(borders: Borders, camera: Camera, plausibility: Plausibility | None = None) -> Borders:
    """The borders moved from the inner edges of the markings, where the search finds them, to their centres.

    A road point `inset` farther out is displaced by inset·focal/depth in x, and 1/depth is linear in y: so b
    and c change, a does not. (The camera's yaw, a few degrees, is neglected.)
    """
    inset = (plausibility or Plausibility()).inset_m
    at_bottom, per_row = camera.px_per_m(0.0), camera.px_per_m(0.0) - camera.px_per_m(1.0)
    moved = inset * np.array([0.0, per_row, -at_bottom])
    return Borders(borders.left + moved, borders.right - moved, borders.score)
