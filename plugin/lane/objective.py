"""The published objective function of a lane border (Zhang et al. 2011, eqs. 2, 3, tables 1, 2).

Fifty blocks of 3×3 pixels lie along a candidate x = a·y² + b·y + c, one every three rows of the bottom 150.
F is the mean over those inside the image of α·ΔM + β·T: brightness relative to the road, and the step of
brightness across the border. T₁ is the step along the left border's diagonal, T₂ its mirror image for the
right border, T₃ vertical, T₄ horizontal. The third row label of table 2 prints β₂ where β₃ is meant.

Figure 2 of the source, which divides a block for T₁ to T₄, is not legible. Our reading: each T is the mean of
three pixels minus the mean of the three opposite ones, without the pixels between (a diagonal, the middle
row, the middle column); so F is greatest on the *inner* edge of a marking, half bright, half road.
"""

from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Camera
from plugin.lane.objective_kernels import BLOCK_PX, BLOCKS, UNIT, objective_kernel
from sumo_net.arrays import Array
from sumo_net.settings import settings

# Tables 1 and 2, a row per slope class: 0.5 <= |b| <= 2, |b| > 2, |b| < 0.5
ALPHA = (0.4, 0.2, 0.2)
BETA_DIAGONAL = (0.6, 0.5, 0.5)  # β₁ on the left border, β₂ on the right
BETA_3 = (0.0, 0.3, 0.0)
BETA_4 = (0.0, 0.0, 0.3)

# Parts of a block (upper row first) as on the left border: +1 in the first part, -1 in the second
PARTS_1 = ((1, 1, 0), (1, 0, -1), (0, -1, -1))  # upper left minus lower right
PARTS_3 = ((1, 1, 1), (0, 0, 0), (-1, -1, -1))  # upper minus lower
PARTS_4 = ((1, 0, -1), (1, 0, -1), (1, 0, -1))  # left minus right


@settings
class Objective:
    """Parameters of the objective function that the source does not state."""

    blocks: int = Field(
        BLOCKS,
        ge=10,
        le=BLOCKS,
        description="number of blocks along a border; fewer than the published 50 for a camera whose horizon "
        "is below y = 150",
    )
    minimum_blocks: int = Field(
        20, ge=1, le=BLOCKS, description="m: with n < m blocks in the image, F = min(Σ/n, Σ/m)"
    )
    road_left_px: int = Field(
        120,
        ge=0,
        lt=WIDTH_PX,
        description="first column of the region from which the road's mean grey is taken",
    )
    road_right_px: int = Field(200, gt=0, le=WIDTH_PX, description="first column beyond that region")
    road_rows: int = Field(
        60,
        ge=1,
        le=BLOCKS * BLOCK_PX,
        description="number of rows of that region, from the bottom (every third is read)",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.road_right_px <= self.road_left_px:
            raise ValueError(
                f"road_right_px = {self.road_right_px}: must be above road_left_px = {self.road_left_px}"
            )
        return self


class ObjectiveNumbers(NamedTuple):
    """The objective function's parameters as kernels take them."""

    stencils: Array  # (2, 3, 3, 3) int32: border (left, right), slope class, row from the top, column
    alpha: Array  # (3,) per slope class
    region: tuple[int, int, int]  # road_left_px, road_right_px, road_rows
    blocks: int
    minimum_blocks: int


def stencils() -> Array:
    """(2, 3, 3, 3) int32, in 1/90: α/9 + Σ βⱼ·partsⱼ/3 per border (the right mirrors the left) and class."""
    left = np.stack(
        [
            alpha / 9
            + (beta * np.array(PARTS_1) + beta_3 * np.array(PARTS_3) + beta_4 * np.array(PARTS_4)) / 3
            for alpha, beta, beta_3, beta_4 in zip(ALPHA, BETA_DIAGONAL, BETA_3, BETA_4, strict=True)
        ]
    )
    return np.ascontiguousarray(np.rint(UNIT * np.stack([left, left[:, :, ::-1]])), np.int32)


def blocks_below_horizon(camera: Camera) -> int:
    """How many of the 50 blocks are below this camera's horizon, for `Objective.blocks`.

    Raises ValueError where fewer than 10 are.
    """
    blocks = min(BLOCKS, int((camera.horizon_y_px - 2.0) // BLOCK_PX))
    if blocks < 10:
        raise ValueError(
            f"the horizon at y = {camera.horizon_y_px:.0f} leaves {blocks} blocks: at least 10 are needed"
        )
    return blocks


def objective_numbers(objective: Objective) -> ObjectiveNumbers:
    """Kernel parameters of the objective function."""
    region = (objective.road_left_px, objective.road_right_px, objective.road_rows)
    return ObjectiveNumbers(stencils(), np.array(ALPHA), region, objective.blocks, objective.minimum_blocks)


def objective(frames: Array, left: Array, right: Array, choices: Objective | None = None) -> Array:
    """(n, 2) objective F of the left and the right border (eqs. 2, 3), in grey levels.

    frames (n, 240, 320) uint8; left, right (n, 3) a, b, c. Raises ValueError on other shapes.
    """
    check_frames(frames)
    for name, border in (("left", left), ("right", right)):
        if border.shape != (len(frames), 3):
            raise ValueError(f"{name} has shape {border.shape}: must be ({len(frames)}, 3)")
    numbers = objective_numbers(choices or Objective())
    score = np.empty((len(frames), 2))
    objective_kernel(
        np.ascontiguousarray(frames),
        np.ascontiguousarray(left, np.float64),
        np.ascontiguousarray(right, np.float64),
        *numbers,
        score,
    )
    return score


def check_frames(frames: Array) -> None:
    """Raise ValueError unless `frames` is (n, 240, 320) uint8."""
    if frames.ndim != 3 or frames.shape[1:] != (HEIGHT_PX, WIDTH_PX) or frames.dtype != np.uint8:
        raise ValueError(
            f"frames are {frames.dtype} of shape {frames.shape}: must be uint8 (n, {HEIGHT_PX}, {WIDTH_PX})"
        )
