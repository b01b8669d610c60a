"""The default lane tracker, `refined` mode: both borders on the ground-plane road model.

It starts from the published search (`needs_search` tells which vehicles need one) and then tracks the lane by
itself: the state of `plugin.lane.road_model` is predicted over the step, marking candidates are collected
around the predicted borders, and a robust information update gives the new state. A lane that is no longer
seen or has become implausible is dropped, and the search is requested again. `plugin.lane.rival` decides when
another lane replaces the tracked one.
"""

import dataclasses
import functools
import math
import threading
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import WIDTH_PX, Projection, preview_distance
from plugin.lane.acquire import WIDEST_M
from plugin.lane.estimate import Borders, LaneEstimate, blank
from plugin.lane.follow import LOCKED, SEARCHING
from plugin.lane.hidden import nothing_hidden
from plugin.lane.lane_start import room_for
from plugin.lane.refine_fit import workspace
from plugin.lane.refine_kernels import REACH_M, columns_kernel, parabola_kernel, step_kernel
from plugin.lane.rival import RIVAL
from plugin.lane.road_model import STATES, rows_to_read
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings
from sumo_net.vehicle import Vehicle


@settings
class Refine:
    """Settings of the default lane tracker."""

    step_s: float = Field(0.1, gt=0, le=1, description="time between frames; 0.1 in a run")
    marking_width_m: float = Field(
        0.15, gt=0, le=0.5, description="width of paint that the ridge filter expects"
    )
    lane_width_m: float = Field(3.6, gt=0, description="prior of the lane width, mean")
    lane_width_std_m: float = Field(0.4, gt=0)
    min_width_m: float = Field(
        1.7, gt=0, description="narrower strips are no lanes; unusual widths need more evidence"
    )
    max_width_m: float = Field(9.0, gt=0, le=WIDEST_M, description="wider strips are no lanes")
    range_m: float = Field(
        REACH_M, gt=20, le=REACH_M, description="distance up to which the borders are tracked"
    )
    contrast: float = Field(6.0, gt=0, description="least response of a ridge, in grey levels")
    noise_factor: float = Field(
        2.5, ge=0, description="least response of a ridge, in standard deviations of its noise"
    )
    rear_axle_m: float | None = Field(
        None, ge=0, description="l_r, from the centre of gravity to the rear axle; none: that of `vehicle`"
    )
    rear_slip_s2pm: float | None = Field(
        None,
        ge=0,
        description="its slip angle per lateral acceleration; none: m l_f / (L k_r) of `vehicle`",
    )
    pitch_std_rad: float = Field(
        0.002, ge=0, description="standard deviation of the vehicle's pitch from the calibration"
    )
    pitch_time_s: float = Field(0.3, gt=0, description="correlation time of the pitch")
    bend_std_1pm: float = Field(
        6e-4, gt=0, description="standard deviation of the change of curvature over 15 m of unseen road"
    )
    bend_std_mps2: float = Field(
        0.4,
        ge=0,
        description="the same where a bend is seen, if more: a lateral acceleration at the own speed",
    )
    confirm_frames: int = Field(2, ge=0, description="frames that must confirm a weak start")
    patience_frames: int = Field(
        15, ge=0, description="frames in a row without the lane before it counts as lost"
    )
    one_sided_frames: int = Field(
        80, ge=0, description="frames in a row with one border only before the lane counts as lost"
    )

    @model_validator(mode="after")
    def _widths(self) -> Self:
        if not self.min_width_m < self.lane_width_m < self.max_width_m:
            raise ValueError(
                f"lane_width_m = {self.lane_width_m}: must lie between min_width_m = {self.min_width_m} "
                f"and max_width_m = {self.max_width_m}"
            )
        return self


class Tuning(NamedTuple):
    """The parameters of Refine as kernels take them, with those that are not settings."""

    step_s: float
    preview_m: float
    marking_width_m: float
    lane_width_m: float
    lane_width_std_m: float
    min_width_m: float
    max_width_m: float
    range_m: float
    contrast: float
    noise_factor: float
    rear_axle_m: float
    rear_slip_s2pm: float
    pitch_std_rad: float
    pitch_keep: float
    bend_std_1pm: float
    bend_std_mps2: float
    confirm_frames: int
    patience_frames: int
    one_sided_frames: int
    turn_std: float = 0.015
    turn_time_s: float = 0.8
    offset_walk: float = 0.006
    heading_walk: float = 0.0005
    width_walk: float = 0.01
    knot_walk: float = 3e-5  # per root metre driven
    noise_px: float = 0.7  # of a marking centre; rows are correlated, so larger than the scatter of one row
    noise_m: float = 0.02
    association_m: float = 0.03
    association_px: float = 0.7
    iterations: int = 3
    narrowing: float = 0.3  # factor on the association width from iteration to iteration
    gate: float = 3.0  # standard deviations of the prediction that are searched,
    reach_m: float = 0.12  # plus this
    reach_px: float = 2.5  # and this,
    furthest_aside_m: float = 1.2  # but not as far as the next lane's lines
    unsure_m: float = 0.5  # a standard deviation beyond which a row is not looked at
    bend_slow_mps: float = 14.0  # slower than this, any road is driven at times
    bend_most_mps2: float = 5.0  # lateral acceleration in the bends ahead that a road asks for
    bend_slope: float = 0.3  # and how much of the change from the one before goes on
    bend_keep: float = 0.95  # of the last knot's curvature in a new one
    odd_width: float = 0.05  # least odds of a width that lane_width_std_m makes unlikely
    line_within: float = 3.0  # votes that one for a line between two borders takes from them
    usual_width: float = 0.4  # odds from which on a lane counts in full
    odd_confirm_frames: int = 5  # that must follow the start of another one
    least_rows: int = 4
    least_share: float = 0.1
    lock_rows: int = 16
    near_m: float = 25.0  # so far ahead paint is near by
    odd_beyond_m: float = 0.9  # beyond a border, until which an odd strip there is no lane: half a car
    neighbour_share: float = 0.1  # of rows, from which on there is a lane beside
    next_std: float = 0.25  # of a neighbouring lane's width against the own lane's
    next_keep: float = 0.97
    outside_m: float = 1.2  # how far beyond a border the centre of gravity may be
    start_heading_std: float = 0.02
    jump_m: float = 0.5  # largest correction of the prediction by a frame
    jump_rad: float = 0.03
    proven_frames: int = 10  # frames with both borders after which a lane counts as proven
    rival_m: float = 0.3  # scatter of searches; beyond it and `gate` standard deviations they contradict
    rival_rad: float = 0.015
    rival_width_m: float = 0.4
    rival_looks: int = 5  # searches that must confirm a contradicting lane, at most;
    odd_looks: int = 20  # the same for one of unusual width against one of usual width
    yaw_rate_std: float = 0.003  # of the own yaw rate as a measurement
    usual_turn: float = 0.02  # rad/s, turn against the lane that halves the weight of a lane found anew
    odd_turn: float = 0.0016  # rad/s by which a fitted lane may miss the yaw rate while less of it is seen
    odd_frames: int = 3  # after which a proven lane that misses it is no longer proven
    odd_bend: float = 0.002  # 1/m, then added to the road's uncertainty each frame without any border


class LaneState(NamedTuple):
    """Tracker state of n vehicles."""

    status: Array  # (n,) int8 SEARCHING, TENTATIVE, LOCKED
    x: Array  # (n, STATES) road model
    P: Array  # (n, STATES, STATES) its covariance
    phase: Array  # (n,) metres by which knot 0 lies behind the centre of gravity
    misses: Array  # (n,) int32 frames in a row without the lane
    one_sided: Array  # (n,) int32 frames in a row without both borders
    age: Array  # (n,) int32 frames since the start
    found: Array  # (n, 2) share of rows where the left and the right border was seen
    beside: Array  # (n, 2) share of rows where the outer line of the lane to the left, right was seen lately
    unseen_m: Array  # (n, 2) driven since paint of the left, the right border was seen nearby; inf: never
    reach_m: Array  # (n,) how far ahead paint was seen lately
    share: Array  # (n, 2) what that usually is on this road
    proof: Array  # (n,) int32 frames since the start in which both borders were seen
    rival: Array  # (n, RIVAL) another lane that was found recently, see `plugin.lane.rival`


def init(n: int) -> LaneState:
    """State of n vehicles before their first frame."""
    return LaneState(
        np.zeros(n, np.int8),
        np.zeros((n, STATES)),
        np.zeros((n, STATES, STATES)),
        np.zeros(n),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros((n, 2)),
        np.zeros((n, 2)),
        np.full((n, 2), np.inf),
        np.zeros(n),
        np.zeros((n, 2)),
        np.zeros(n, np.int32),
        np.zeros((n, RIVAL)),
    )


def needs_search(state: LaneState) -> Array:
    """(n,) bool: which vehicles need the published search's borders in the next step."""
    return np.asarray(state.status == SEARCHING)


def on_vehicle(refine: Refine, vehicle: Vehicle) -> Refine:
    """The settings with the vehicle's rear axle, where they name none."""
    axle_m, slip_s2pm = refine.rear_axle_m, refine.rear_slip_s2pm
    return dataclasses.replace(
        refine,
        rear_axle_m=vehicle.rear_axle_m if axle_m is None else axle_m,
        rear_slip_s2pm=vehicle.rear_slip_s2pm if slip_s2pm is None else slip_s2pm,
    )


@functools.lru_cache(maxsize=32)
def tuning(refine: Refine, preview_m: float) -> Tuning:
    """Kernel parameters of the tracker; on the default vehicle where the settings name no rear axle."""
    return kernel_view(
        Tuning,
        on_vehicle(refine, Vehicle()),
        preview_m=preview_m,
        pitch_std_rad=max(refine.pitch_std_rad, 1e-6),
        pitch_keep=math.exp(-refine.step_s / refine.pitch_time_s),
    )


@functools.lru_cache(maxsize=32)
def _rows(p: Projection) -> Array:
    return rows_to_read(p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch)


class _WorkSpace(threading.local):
    """The kernel's work space, one per thread, without meaning between calls."""

    def __init__(self) -> None:
        self.of = functools.lru_cache(maxsize=4)(lambda rows: (workspace(rows), room_for(rows)))


_WORK_SPACE = _WorkSpace()


def step(
    frames: Array,
    borders: Borders | None,
    given: Array | None,
    state: LaneState,
    projection: Projection,
    speed_mps: Array,
    refine: Refine,
    hidden: Array | None = None,
    yaw_rate_rps: Array | None = None,
) -> tuple[LaneState, LaneEstimate]:
    """One frame of each of n vehicles.

    frames (n, 240, 320) uint8. borders: the published search's, for the vehicles that `given` (n,) bool
    marks; None for none. speed_mps (n,): of the step that led to these frames. hidden (n, BODIES, COLUMNS):
    the bodies ahead, from `plugin.lane.hidden`, if known. yaw_rate_rps (n,): the vehicles' own, NaN or None
    for a camera alone.

    Raises ValueError for frames of another shape or type.
    """
    n = len(state.status)
    if frames.shape != (n, 240, WIDTH_PX) or frames.dtype != np.uint8:
        raise ValueError(f"frames are {frames.dtype} {frames.shape}: must be uint8 ({n}, 240, {WIDTH_PX})")
    if borders is None:
        left, right, there = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, np.bool_)
    else:
        left, right = np.ascontiguousarray(borders.left), np.ascontiguousarray(borders.right)
        there = np.ones(n, np.bool_) if given is None else np.ascontiguousarray(given, np.bool_)
    new = LaneState(*(np.empty_like(part) for part in state))
    out, rows = blank(n), _rows(projection)
    step_kernel(
        np.ascontiguousarray(frames),
        left,
        right,
        there,
        nothing_hidden(n) if hidden is None else np.ascontiguousarray(hidden),
        state,
        rows,
        projection,
        np.ascontiguousarray(speed_mps, np.float64),
        np.full(n, np.nan) if yaw_rate_rps is None else np.ascontiguousarray(yaw_rate_rps, np.float64),
        tuning(refine, preview_distance(projection)),
        *_WORK_SPACE.of(len(rows)),
        new,
        out,
    )
    return new, out


def border_columns(state: LaneState, rows: Array, projection: Projection, furthest_m: float = 150.0) -> Array:
    """(n, 2, rows) columns of the left and the right border at rows (y, up from the bottom, ascending).

    NaN beyond furthest_m and for vehicles without a lock; columns may lie outside the image.
    """
    out = np.empty((len(state.status), 2, len(rows)))
    columns_kernel(
        state.x,
        state.phase,
        state.status,
        np.ascontiguousarray(rows, np.float64),
        projection,
        furthest_m,
        out,
    )
    return out


def parabolas(state: LaneState, columns: Array, rows: Array) -> Borders:
    """Both borders as x = a·y² + b·y + c, fitted where they are in the image; score: share of rows seen.

    columns: `border_columns` at rows. NaN for vehicles without a lock, or with fewer than five rows in the
    image.
    """
    n = len(state.status)
    left, right = np.empty((n, 3)), np.empty((n, 3))
    parabola_kernel(columns, rows, float(WIDTH_PX), left, right)
    return Borders(left, right, state.found.copy())


def locked(state: LaneState) -> Array:
    """(n,) bool: which vehicles have a locked lane."""
    return np.asarray(state.status == LOCKED)
