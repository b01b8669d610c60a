"""Lane-departure warning: one warning for each approach to a border, and its suppression.

A warning is due towards a side when the vehicle drifts to it and either the time to lane crossing is at most
`threshold_s` or the wheel is within `edge_m` of the border. It is given in the zone of ISO 17361 (from
memory): not earlier than 0.75 m inside the border (1.5 s times the rate of departure between 0.5 and 1 m/s,
1.5 m above), not later than 0.3 m outside. One warning for each approach: the side is armed again when the
time to crossing is well above the threshold and the wheel back inside, by `rearm_gap_m`, or by `edge_m` once
the last warning is `rearm_s` ago.

A look that stands alone does not warn: one step before, the time to crossing must have been near the
threshold (`confirm_s` above it) or the wheel near the border. A true approach has been: no lead is lost. Nor
does an estimate that the camera's looks have just contradicted (`consistent_s`): it may be another lane's.
Nor is there a warning of a border that is only extrapolated from paint far ahead, as across a junction
(`unseen_m`); one whose paint is worn off warns while the lane's other border is seen beside the vehicle.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator

from plugin.motion.estimate import MotionEstimate
from plugin.warning import departure_kernels
from plugin.warning.departure_kernels import (
    INACTIVE,
    LANE_NOT_SEEN,
    READY,
    SUPPRESSED,
    WARNING_LEFT,
    WARNING_RIGHT,
    DepartureNumbers,
)
from plugin.warning.tlc import Crossing
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings

__all__ = [
    "CODES",
    "INACTIVE",
    "LANE_NOT_SEEN",
    "READY",
    "SUPPRESSED",
    "WARNING_LEFT",
    "WARNING_RIGHT",
    "DepartureSettings",
    "DepartureState",
    "DepartureWarning",
    "init",
    "numbers",
    "step",
]

CODES = ("inactive", "ready", "warning left", "warning right", "suppressed", "lane not seen")


@settings
class DepartureSettings:
    """Conditions of the lane-departure warning."""

    threshold_s: float = Field(
        1.0, gt=0, le=3, description="time to lane crossing below which a warning begins"
    )
    hysteresis_s: float = Field(
        0.5, ge=0, description="a warning ends, and its side may warn again, this much above the threshold"
    )
    confirm_s: float = Field(
        0.4,
        ge=0,
        description="the time to crossing of the step before must be at most this much above the threshold",
    )
    urgent_s: float = Field(
        0.3,
        ge=0,
        description="time to crossing below which the warning is level 2, as with a wheel over the border",
    )
    consistent_s: float = Field(
        0.2, ge=0, description="time without a contradicting camera measurement that is needed for a warning"
    )
    unseen_m: float = Field(
        15.0,
        ge=0,
        description="distance driven since paint of either border was seen nearby, beyond which none warns",
    )
    edge_m: float = Field(
        0.10, ge=0, description="a wheel this near the border is warned of whatever its time to crossing"
    )
    least_drift_mps: float = Field(0.03, ge=0, description="least lateral speed towards a side for a warning")
    earliest_m: float = Field(
        0.75,
        gt=0,
        description="earliest warning line, inside the border (ISO 17361, from memory); at higher rates of "
        "departure …",
    )
    earliest_time_s: float = Field(
        1.5, gt=0, description="… this time times the rate of departure, if more …"
    )
    earliest_most_m: float = Field(1.5, gt=0, description="… but no further inside than this")
    latest_m: float = Field(
        0.3, ge=0, description="latest warning line, outside the border (ISO 17361, from memory)"
    )
    rearm_gap_m: float = Field(
        0.25, ge=0, description="distance of the wheel inside the border from which the side can warn again"
    )
    rearm_s: float = Field(
        3.0, ge=0, description="or time after the last warning, with the wheel edge_m inside"
    )
    least_speed_mps: float = Field(
        11.1, ge=0, description="lowest active speed: 40 km/h (11.1 m/s); streets are slower"
    )
    speed_hysteresis_mps: float = Field(
        1.4, ge=0, description="it stays active until this much below that speed"
    )
    signal_hold_s: float = Field(
        1.5, ge=0, description="a turn signal suppresses warnings of its side for this time after it ends"
    )
    least_duration_s: float = Field(0.5, ge=0, description="shortest duration of a warning")
    most_duration_s: float = Field(4.0, gt=0, description="longest duration of a warning")

    @model_validator(mode="after")
    def _ordered(self) -> "DepartureSettings":
        for low, high in (
            ("least_duration_s", "most_duration_s"),
            ("earliest_m", "earliest_most_m"),
            ("edge_m", "rearm_gap_m"),
            ("urgent_s", "threshold_s"),
        ):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(
                    f"{low} = {getattr(self, low)}: must not be above {high} = {getattr(self, high)}"
                )
        return self


class DepartureState(NamedTuple):
    """The warning of n vehicles, (n,) each."""

    fast: Array  # bool: fast enough for the warning to be active
    active: Array  # int8: side of the warning that is on, +1 left, -1 right, 0 none
    since_s: Array  # since the last warning began
    served_left: Array  # bool: this approach has already been warned of
    served_right: Array
    hold_left_s: Array  # remaining time of suppression by the turn signal
    hold_right_s: Array
    near_left: Array  # bool: as `near` of the last step
    near_right: Array
    crossed: Array  # int8: side of the border just crossed, until the wheel is clear of it


class DepartureWarning(NamedTuple):
    """Output for the driver, (n,) int8 each."""

    code: Array  # INACTIVE, READY, WARNING_LEFT, WARNING_RIGHT, SUPPRESSED, LANE_NOT_SEEN
    side: Array  # of the warning that is on: +1 left, -1 right, 0 none
    started: Array  # the side, in the step in which a warning begins
    level: Array  # 0 none, 1 warning, 2 at or over the border


def numbers(settings: DepartureSettings, step_s: float = 0.1) -> DepartureNumbers:
    """The kernel's view of the settings."""
    return kernel_view(
        DepartureNumbers,
        settings,
        speed_on_mps=settings.least_speed_mps,
        speed_off_mps=max(0.0, settings.least_speed_mps - settings.speed_hysteresis_mps),
        step_s=step_s,
    )


def init(n: int) -> DepartureState:
    """n vehicles without a warning."""
    return DepartureState(
        np.zeros(n, bool),
        np.zeros(n, np.int8),
        np.full(n, np.inf),
        np.zeros(n, bool),
        np.zeros(n, bool),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n, bool),
        np.zeros(n, bool),
        np.zeros(n, np.int8),
    )


def step(
    state: DepartureState,
    crossing: Crossing,
    motion: MotionEstimate,
    unseen_m: tuple[Array, Array],
    speed_mps: Array,
    signal: Array,
    numbers: DepartureNumbers,
) -> tuple[DepartureState, DepartureWarning]:
    """One step for n vehicles; signal (n,) is the turn signal, +1 left, -1 right, 0 none.

    unseen_m : of the left (n,) and the right border (n,), as in LaneEstimate.
    """
    n = len(speed_mps)
    heading = motion.heading_error_rad
    drift = speed_mps * np.sin(heading) + motion.lateral_speed_mps * np.cos(heading)
    new, out = init(n), DepartureWarning(*(np.zeros(n, np.int8) for _ in range(4)))
    departure_kernels.step(
        state, crossing, drift, motion.settled_s, motion.lane_shift, unseen_m, speed_mps, signal, numbers,
        new, out,
    )  # fmt: skip
    return new, out
