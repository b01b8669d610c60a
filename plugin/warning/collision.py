"""Rear-end collision warning: who is in path, how near is too near, and what the driver sees and hears.

The target is the nearest object in the path. The path is the lane that the camera sees, with its curvature;
while the lane is lost, the circle that the vehicle steers. Two levels: a reminder (lift off) and danger
(brake).
"""

import dataclasses
import functools
import math
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from plugin.motion.estimate import MotionEstimate
from plugin.tracking.tracker import TrackList
from plugin.warning import collision_kernels as kernels
from plugin.warning import safe_distance
from plugin.warning.collision_kernels import (
    ALARM,
    CHIME,
    DANGER,
    INACTIVE,
    READY,
    REMINDER,
    SILENT,
    SUPPRESSED,
    CollisionNumbers,
    PathNumbers,
)
from plugin.warning.safe_distance import SafeDistance
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings
from sumo_net.vehicle import Vehicle

__all__ = [
    "ALARM",
    "BUZZER",
    "CHIME",
    "CODES",
    "DANGER",
    "INACTIVE",
    "READY",
    "REMINDER",
    "SILENT",
    "SUPPRESSED",
    "Collision",
    "CollisionState",
    "CollisionWarning",
    "InPath",
    "Targets",
    "init",
    "step",
    "targets_from",
    "time_by_tracks",
]

CODES = ("inactive", "ready", "reminder", "danger", "suppressed")
BUZZER = ("silent", "chime", "alarm")
REMEMBERED = 8  # tracks in path, for the hysteresis
LATEST_S = 0.25  # since the last detection of a target


@settings
class Collision:
    """When the driver is warned of the vehicle ahead."""

    distance: SafeDistance = Field(default_factory=SafeDistance, description="model and road surface")
    enter_m: float = Field(
        0.35, ge=0, description="an object enters the path this far inside the lane's borders"
    )
    leave_m: float = Field(0.05, ge=0, description="and stays in path until this far outside of them")
    half_lane_m: float = Field(1.6, gt=0, description="half width of the path while the lane is lost")
    stationary_half_m: float = Field(
        1.0, gt=0, description="half width of the path at any time, for objects that were never seen moving"
    )
    stationary_reach_s: float = Field(
        3.0, gt=0, description="such objects count only within this time at the own speed"
    )
    stationary_furthest_m: float = Field(90.0, gt=0, description="and only within this distance")
    stationary_steps: int = Field(
        5,
        ge=1,
        le=100,
        description="and, beyond `guess_reach_s`, only after this many steps in a row in the path",
    )
    sightings: int = Field(
        2,
        ge=0,
        le=100,
        description="within `sight_m` such an object becomes a target only when the camera saw a vehicle's "
        "rear there in this many frames, or …",
    )
    sight_m: float = Field(50.0, ge=0, description="distance within which the camera sees nearly all rears")
    unsighted_reach_s: float = Field(1.0, ge=0, description="… it is within this time at the own speed, or …")
    sight_share: float = Field(
        0.35,
        ge=0,
        le=1,
        description="… the camera sees a smaller share than this of moving vehicles' rears: it may be too "
        "dark",
    )
    sight_memory_s: float = Field(
        300.0, gt=0, description="time constant with which that share falls while there are none"
    )
    curvature_doubt_1pm: float = Field(
        1e-4,
        ge=0,
        le=1e-2,
        description="uncertainty of the lane's curvature: half of this times x² narrows the path at distance "
        "x",
    )
    lost_reach_s: float = Field(
        2.5,
        gt=0,
        description="while the lane is lost, only objects within this time at the own speed (3 m/s or more) "
        "count",
    )
    entry_gap_m: float = Field(
        2.0, ge=0, description="no object enters the path nearer than this: it is being passed"
    )
    entering_s: float = Field(
        1.0, ge=0, description="the lane that the vehicle will be in after so long belongs to the path, too"
    )
    guess_reach_s: float = Field(
        2.0,
        ge=0,
        description="… within this time at the own speed; beyond it, only once the vehicle is there",
    )
    near_half_m: float = Field(
        0.5, ge=0, description="an object in path is at most this far aside at the bumper …"
    )
    near_angle_rad: float = Field(
        math.radians(15.0), gt=0, lt=1.4, description="… and further ahead within this angle of the axis, 15°"
    )
    disagreement_mps2: float = Field(
        3.0,
        gt=0,
        description="the lane counts as lost if its curvature needs a lateral acceleration this far from the "
        "driven one",
    )
    jerk_mps3: float = Field(
        1.2,
        gt=0,
        description="the lane counts as lost if its curvature changes by this much at the own speed: roads "
        "are built for 0.3 to 0.9 m/s³",
    )
    road_reach_m: float = Field(
        60.0, gt=0, description="distance up to which the lane's change of curvature is continued"
    )
    least_speed_mps: float = Field(2.8, ge=0, description="lowest active speed: 10 km/h")
    speed_hysteresis_mps: float = Field(
        1.4, ge=0, description="it stays active until this much below that speed"
    )
    relief: float = Field(
        0.15, ge=0, description="a level ends when the gap exceeds its distance by this share"
    )
    confirm_steps: int = Field(
        2, ge=1, le=20, description="steps in a row that are needed before a level begins"
    )
    least_reminder_s: float = Field(1.0, ge=0, description="shortest duration of a reminder")
    least_danger_s: float = Field(
        0.6, ge=0, description="shortest duration of a danger warning, unless the driver brakes"
    )
    braking_mps2: float = Field(
        2.0,
        gt=0,
        description="a driver who brakes this hard, and enough, gets no danger warning and no sound",
    )
    least_closing_mps: float = Field(
        0.5, ge=0, description="no warning of a leader that closes more slowly than this and does not brake"
    )
    floor_ttc_s: float = Field(
        2.6, ge=0, description="time to collision of a reminder with any model, own braking not counted"
    )
    acceleration_slack_mps2: float = Field(
        0.5, ge=0, description="subtracted from the leader's deceleration, for the noise of the track"
    )
    hardest_braking_mps2: float = Field(9.0, gt=0, description="greatest deceleration of a leader")
    bumper_m: float | None = Field(
        None,
        ge=0,
        description="distance of the front bumper ahead of the centre of gravity; none: that of `vehicle`",
    )

    @model_validator(mode="after")
    def _border_on_the_road(self) -> Self:
        if self.enter_m >= self.half_lane_m:
            raise ValueError(f"enter_m = {self.enter_m}: must be below half_lane_m = {self.half_lane_m}")
        return self


class Targets(NamedTuple):
    """T tracks of the whole fleet, (T,) each, in the axes of the vehicle now."""

    owner: Array  # int64, row of the vehicle
    track_id: Array  # int64, unique within the vehicle
    x_m: Array  # from the centre of gravity
    y_m: Array
    vx_mps: Array  # over ground
    vy_mps: Array
    ax_mps2: Array  # over ground
    detected: Array  # bool: in this step
    usable: Array  # bool: confirmed, not oncoming, detected lately
    standing: Array  # bool: never seen moving
    sighted: Array  # bool: the camera sees the rear of a vehicle there in this frame


def targets_from(tracks: TrackList, unseen_s: Array, sighted_id: Array) -> Targets:
    """The tracker's list as targets; unseen_s (T,) is `TrackerState.tracks.unseen_s`, in the same order.

    sighted_id (n,) int64 : the track whose rear the camera of each vehicle sees in this frame, -1 for none.

    Left out are tracks that are tentative, oncoming (or were so before they stopped), or not detected for
    longer than LATEST_S: those of vehicles just passed drift into the path while they coast.
    """
    e = tracks.estimate
    kinds = kernels.kinds(tracks, unseen_s, sighted_id, LATEST_S)
    return Targets(
        tracks.owner,
        tracks.track_id,
        e.x_m,
        e.y_m,
        e.vx_mps,
        e.vy_mps,
        e.ax_mps2,
        *kinds,
    )


class CollisionState(NamedTuple):
    """The warning of n vehicles, (n, …) each."""

    fast: Array  # bool: above the speed from which it works
    level: Array  # int8: 0 none, 1 reminder, 2 danger
    since_s: Array  # since the reminder began
    danger_s: Array  # since danger began
    hits: Array  # int64, steps in a row below the reminder distance
    danger_hits: Array
    inside: Array  # (n, REMEMBERED) int64, ids of the tracks where the path is, else -1
    waited: Array  # (n, REMEMBERED) int64, for how many steps in a row
    sightings: Array  # (n, REMEMBERED) int64, how often the camera has seen their rears since
    watched: Array  # int64, the moving track whose rear the camera looks for, -1 for none
    sight_share: Array  # of such rears, how many it has seen lately, 0 to 1


class CollisionWarning(NamedTuple):
    """What the warning knows and what the driver gets, (n,) each; NaN where nothing is in path."""

    code: Array  # int8, index into CODES
    level: Array  # int8: 0 none, 1 reminder, 2 danger
    started: Array  # int8, the level, in the step in which it begins
    row: Array  # int64, the target among the tracks given, -1 for none
    nearest: Array  # int64, the nearest of these where the path is, be it a target or not, -1 for none
    track_id: Array  # int64, the target, -1 for none
    gap_m: Array  # bumper to bumper
    relative_mps: Array  # the target's speed minus the own, negative when closing
    ttc_s: Array  # gap over closing speed; inf when opening
    ttc_accelerated_s: Array  # with both accelerations, nobody going backwards
    reminder_m: Array  # the model's distances
    danger_m: Array
    lamp_reminder: Array  # bool
    lamp_danger: Array  # bool
    buzzer: Array  # int8, index into BUZZER: chime in the first step of a reminder, alarm all along danger
    shown_distance_m: Array  # the display, whole metres
    shown_relative_mps: Array  # the display, whole m/s


class InPath(NamedTuple):
    """Of T tracks, (T,) each."""

    inside: Array  # bool
    offset_m: Array  # left of the path's middle; NaN for tracks that are not usable


def on_vehicle(options: Collision, vehicle: Vehicle) -> Collision:
    """The settings with the vehicle's front bumper, where they name none."""
    bumper_m = vehicle.bumper_m if options.bumper_m is None else options.bumper_m
    return dataclasses.replace(options, bumper_m=bumper_m)


@functools.cache
def numbers(options: Collision, step_s: float = 0.1) -> tuple[PathNumbers, CollisionNumbers]:
    """The kernels' view of the settings; on the default vehicle where they name no bumper."""
    options = on_vehicle(options, Vehicle())
    path = kernel_view(
        PathNumbers,
        options,
        sight_memory_steps=options.sight_memory_s / step_s,
        near_slope=math.tan(options.near_angle_rad),
    )
    warning = kernel_view(
        CollisionNumbers,
        options,
        safe=safe_distance.numbers(options.distance),
        speed_on_mps=options.least_speed_mps,
        speed_off_mps=max(0.0, options.least_speed_mps - options.speed_hysteresis_mps),
        brakes_mps2=-options.braking_mps2,
        hardest_mps2=-options.hardest_braking_mps2,
        step_s=step_s,
    )
    return path, warning


def init(n: int) -> CollisionState:
    """n vehicles without a warning."""
    inside = np.full((n, REMEMBERED), kernels.NONE, np.int64)
    waited, sightings = np.zeros((2, n, REMEMBERED), np.int64)
    since, hits = np.full((2, n), np.inf), np.zeros((2, n), np.int64)
    remembered = inside, waited, sightings, np.full(n, kernels.NONE, np.int64), np.zeros(n)
    return CollisionState._make([np.zeros(n, bool), np.zeros(n, np.int8), *since, *hits, *remembered])


def step(
    state: CollisionState,
    targets: Targets,
    motion: MotionEstimate,
    speed_mps: Array,
    acceleration_mps2: Array,
    yaw_rate_rps: Array,
    options: Collision,
) -> tuple[CollisionState, CollisionWarning, InPath]:
    """One step of 0.1 s for n vehicles.

    motion : from the camera chain, NaN while the lane is lost. speed, acceleration and yaw rate (n,) are the
    vehicle's own sensors'.
    """
    n, tracks = len(speed_mps), len(targets.owner)
    new, out = init(n), _blank(n)
    found = InPath(np.empty(tracks, bool), np.empty(tracks))
    kernels.warn(
        state,
        targets,
        motion,
        speed_mps,
        acceleration_mps2,
        yaw_rate_rps,
        *numbers(options),
        new,
        out,
        *found,
    )
    return new, out, found


def time_by_tracks(tracks: TrackList, row: Array, speed_mps: Array, options: Collision) -> Array:
    """Time to collision (n,) with the tracks `row` (n,), -1 for none, as `step` has it of what it is given.

    NaN where there is none, inf where the gap opens. speed_mps (n,).
    """
    e = tracks.estimate
    out: Array = kernels.time_to(e.x_m, e.vx_mps, row, speed_mps, numbers(options)[0].bumper_m)
    return out


def _blank(n: int) -> CollisionWarning:
    codes, numbers, lamps = np.zeros((4, n), np.int8), np.empty((8, n)), np.zeros((2, n), np.bool_)
    row, nearest, track_id = np.full((3, n), kernels.NONE, np.int64)
    return CollisionWarning._make(
        [*codes[:3], row, nearest, track_id, *numbers[:6], *lamps, codes[3], *numbers[6:]]
    )
