"""Motion classes of objects ahead (CN104635233A, thresholds IV, transitions V)."""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from plugin.tracking.classification_kernels import ClassRules
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings

NAMES = (
    "unclassified",
    "stationary",
    "same_direction",
    "oncoming",
    "stopped_was_same_direction",
    "stopped_was_oncoming",
)


@settings
class ClassSettings:
    """Thresholds and cycles; the patent leaves k₁, k₂ and V_min to trials in the car; these are ours."""

    minimum_speed_mps: float = Field(
        1.5, gt=0, description="V_min; above the speed error of a track that is three cycles old"
    )
    k1: float = Field(
        0.02,
        ge=0,
        description="k₁, factor of the ego speed: the radial speed's error grows with it (azimuth error)",
    )
    k2_s: float = Field(
        0.1, ge=0, description="k₂, factor of the ego acceleration: one cycle of delay of the ego speed"
    )
    oncoming_speed_mps: float = Field(-3.0, lt=0, description="V_x, as published")
    near_zero_mps: float = Field(
        0.5, ge=0, description="speed below which an object counts as near 0 (stopping)"
    )
    settle_cycles: int = Field(
        3, ge=1, le=100, description="cycles from unclassified to a class, as published"
    )
    stop_cycles: int = Field(2, ge=1, le=100, description="cycles from moving to stopped, as published")
    go_cycles: int = Field(3, ge=1, le=100, description="cycles from standing to moving, as published")


class ClassState(NamedTuple):
    """(T,) each, int8."""

    state: Array  # index into NAMES
    candidate: Array  # the class that may come next
    cycles: Array  # consecutive cycles of the candidate so far


def init(tracks: int) -> ClassState:
    """New tracks, unclassified."""
    return ClassState(*(np.zeros(tracks, np.int8) for _ in ClassState._fields))


def moving_threshold(options: ClassSettings, speed_mps: Array, acceleration_mps2: Array) -> Array:
    """V_t = V_min + k₁ v_ego + k₂ a_ego (eq. 16)."""
    return options.minimum_speed_mps + options.k1 * speed_mps + options.k2_s * acceleration_mps2


def rules(options: ClassSettings) -> ClassRules:
    """The kernel's view of the settings; its step is `classification_kernels.advance`."""
    return kernel_view(ClassRules, options)
