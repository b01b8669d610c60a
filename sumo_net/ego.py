"""True lateral motion of the equipped vehicles: SUMO moves them along the road, this module across it.

Each 0.1 s, `Ego.step` takes SUMO's snapshot, integrates driver and single-track model over the step that
SUMO has just made (10 substeps of 0.01 s), and returns the truth. When a vehicle changes lanes or drives on
to the next one, its world pose is carried over to the new path without a jump.

All vehicles have the dynamics of the same `Vehicle`, trucks and motorcycles too; only the distance between
the wheels follows SUMO's width.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from sumo_net.arrays import Array
from sumo_net.batch import join, select
from sumo_net.driver import Driver, Traits, attentive, numbers, stable_to_mps, traits
from sumo_net.driver_kernels import DISTRACTION, at_speed, reference
from sumo_net.ego_road_kernels import drive_on, onto_paths, stand
from sumo_net.settings import SettingsError
from sumo_net.snapshot import Snapshot
from sumo_net.vehicle import Vehicle, model

PUT_MPS = 2.0  # no vehicle gains this in a step: SUMO has taken it out of a jam and put it here at speed
B = TypeVar("B", bound=tuple[Any, ...])


class EgoTruth(NamedTuple):
    """Truth of n equipped vehicles after a step, ordered by handle."""

    handle: Array  # (n,) int64
    path: Array  # (n,) int32
    station_m: Array  # (n,) of the centre of gravity along the path
    path_offset_m: Array  # (n,) centre of gravity left of the path
    path_heading_rad: Array  # (n,) vehicle heading minus the path's
    x_m: Array  # (n,) centre of gravity, world
    y_m: Array
    heading_rad: Array
    speed_mps: Array  # (n,) along the vehicle's x axis
    acceleration_mps2: Array  # (n,) SUMO's
    lateral_speed_mps: Array  # (n,) along the vehicle's y axis, at the centre of gravity
    yaw_rate_rps: Array
    steer_rad: Array  # (n,) front wheels
    curvature_1pm: Array  # (n,) of the path at the centre of gravity
    lane_offset_m: Array  # (n,) left of the centre of the marked lane that contains the centre of gravity
    lane_heading_rad: Array  # (n,) relative to that lane
    lane_width_m: Array
    lanes_left: Array  # (n,) int32, that lane's place left (+) of SUMO's lane
    border_kind_right: Array  # (n,) int8 of that lane
    border_kind_left: Array
    signal: Array  # (n,) int8 turn signal, +1 left, -1 right, 0 none
    cause: Array  # (n,) int8, sumo_net.driver.CAUSES
    on_marked_road: Array  # (n,) bool


class Motion(NamedTuple):
    """Motion state of n equipped vehicles, carried from step to step."""

    handle: Array  # (n,) int64
    lane: Array  # (n,) int32, SUMO's
    path: Array  # (n,) int32
    station_m: Array  # (n,)
    along_mps: Array  # (n,) ds/dt
    offset_m: Array  # (n,) d, left of the path
    heading_rad: Array  # (n,) e, relative to the path
    lateral_speed_mps: Array  # (n,)
    yaw_rate_rps: Array  # (n,)
    steer_rad: Array  # (n,)
    lane_position_m: Array  # (n,) SUMO's; NaN after a change of lane and for new vehicles
    sumo_mps: Array  # (n,) SUMO's speed


class Drive(NamedTuple):
    """Inputs from the road and SUMO for the step that is integrated, at its beginning and end."""

    distance_m: Array  # (n,) along the path
    speed_before_mps: Array  # (n,) along the path
    speed_after_mps: Array
    curvature_before_1pm: Array  # (n,) at the centre of gravity
    curvature_after_1pm: Array
    preview_before_1pm: Array  # (n,) curvature at the driver's preview distance
    preview_after_1pm: Array
    curvature_sight_1pm: Array  # (n,) SIGHT_S ahead
    half_lane_m: Array  # (n,)
    alerted: Array  # (n,) bool


class Fleet(Protocol):
    """What Ego needs from the traffic; sumo_net.traffic.Traffic has it."""

    lane_ids: list[str]

    def vehicle_id(self, handle: int) -> str: ...

    def accelerations_mps2(self, handles: Array) -> Array: ...

    def route_ahead(self, handle: int) -> tuple[str, ...]: ...


class Ego:
    """The equipped fleet. Called once a step; vehicles may come and go."""

    def __init__(
        self,
        roads: Any,
        fleet: Fleet,
        seed: int,
        driver: Driver | None = None,
        vehicle: Vehicle | None = None,
        offsets_m: Mapping[str, float] | None = None,
    ) -> None:
        """`roads` is a RoadNetwork; `seed` and a vehicle's id determine all random draws of its driver.

        `offsets_m`: mean lateral positions by vehicle id, for drivers whose position is not drawn.
        """
        self._roads = roads
        self._fleet = fleet
        self._seed = seed
        self._offsets_m = dict(offsets_m or {})
        self._driver = driver or Driver()
        self._vehicle = vehicle or Vehicle()
        self._numbers = numbers(self._driver, self._vehicle)
        self._stable_mps = stable_to_mps(self._driver, self._vehicle)
        self._model = model(self._vehicle)
        self._traits = self._draw([], np.zeros(0))
        self._mind = attentive(self._traits)
        self._motion = standing(np.zeros(0, np.int64))
        self._front_lateral_m = np.zeros(0)

    def step(self, snapshot: Any, equipped: Array, alerted: Array | None = None) -> EgoTruth:
        """Move the equipped vehicles over the 0.1 s that led to this snapshot.

        `equipped` is a mask (N,) or the rows of the snapshot's equipped vehicles; those on no lane are left
        out. `alerted`: handles of vehicles whose driver is being warned; an episode then ends after the
        driver's reaction time. A vehicle that is new, or has been moved by more than 5 m, or put on another
        lane at speed (teleport, parking, re-insertion), starts at its driver's offset from the lane's centre.
        Raises SettingsError for one that drives faster than its driver can keep the lane.
        """
        rows = np.flatnonzero(equipped) if equipped.dtype == np.bool_ else np.sort(equipped)
        now = select(snapshot, rows[snapshot.lane[rows] >= 0])
        self._follow_fleet(now)
        if len(now.handle) and now.speed_mps.max() > self._stable_mps:
            raise SettingsError(self._too_fast(now))
        motion, mind = _own(self._motion), _own(self._mind)
        changed = np.flatnonzero(motion.lane != now.lane)
        # Who was put on another lane has not come the way that leads there: as new, on a lane of its own.
        put = changed[(now.speed_mps - motion.sumo_mps)[changed] > PUT_MPS]
        motion.lane[put] = motion.path[put] = -1
        new_path = motion.path.copy()
        for i in changed:
            new_path[i] = self._path_of(int(now.handle[i]), now.lane[i], motion.lane[i])
        motion.lane[:], motion.sumo_mps[:] = now.lane, now.speed_mps
        motion.lane_position_m[changed] = np.nan
        table, bumper = self._roads.table, self._vehicle.bumper_m
        if len(changed):
            onto_paths(
                motion, mind, self._traits, table, changed, new_path,
                now.lane_position_m, now.speed_mps, bumper, self._numbers, self._model,
            )  # fmt: skip
        drive = _no_drive(len(now.handle))
        if alerted is not None and len(alerted):
            drive.alerted[:] = np.isin(now.handle, alerted)
        drive_on(
            motion, mind, self._traits, drive, table, now.lane_position_m, now.speed_mps, bumper,
            self._numbers, self._model,
        )  # fmt: skip
        self._motion, self._mind = motion, mind
        return self._truth(table)

    def front_lateral_m(self) -> Array:
        """Offset (n,) of the front bumper's centre from SUMO's lane, for Traffic.write_lateral."""
        return self._front_lateral_m

    def half_span_m(self) -> Array:
        """Half the distance (n,) between the outer edges of the front wheels, in truth's order."""
        return self._traits.half_span_m

    def veer(self, handle: int, rate_mps: float, ramp_s: float, for_s: float) -> None:
        """Let a distracted driver drift off from the next step on, at `rate_mps` (left positive) for `for_s`.

        The rate is reached smoothly within `ramp_s`; at the end the driver steers back. Raises KeyError for a
        vehicle that is not equipped.
        """
        i, mind = self._row(handle), self._mind
        mind.veer_from_m[i] = reference(mind, self._traits, i)[0]
        mind.veer_rate_mps[i], mind.veer_ramp_s[i] = rate_mps, ramp_s
        # steering takes effect after `preview` seconds: starting at once, the drift would overshoot
        preview = at_speed(self._numbers.preview_s, self._motion.along_mps[i])
        mind.veer_elapsed_s[i], mind.veer_left_s[i] = -preview, for_s + preview
        mind.cause[i], mind.signal[i] = DISTRACTION, 0

    def next_change(self, handle: int, signal: bool, over_s: float | None) -> None:
        """Set whether the driver signals lane changes from now on, and their duration (None: unchanged).

        Raises KeyError for a vehicle that is not equipped.
        """
        i = self._row(handle)
        self._traits.signal_probability[i] = 1.0 if signal else 0.0
        if over_s is not None:
            self._traits.change_s[i] = over_s

    def drives(self, handle: int) -> bool:
        """Whether a vehicle is equipped and on the road."""
        return bool(np.isin(handle, self._motion.handle))

    def _too_fast(self, now: Any) -> str:
        i = int(np.argmax(now.speed_mps))
        name = self._fleet.vehicle_id(int(now.handle[i]))
        return (
            f"vehicle '{name}' drives {now.speed_mps[i]:.1f} m/s: lane keeping with these settings of "
            f"`driver` and `vehicle` is unstable above {self._stable_mps:.0f} m/s; give its vType a "
            "maxSpeed, equip other vehicles, or lower driver.bandwidth_rps"
        )

    def _row(self, handle: int) -> int:
        i = int(np.searchsorted(self._motion.handle, handle))
        if i == len(self._motion.handle) or self._motion.handle[i] != handle:
            raise KeyError(handle)
        return i

    def _path_of(self, handle: int, lane: int, came_from: int) -> int:
        names = self._fleet.lane_ids
        route = self._fleet.route_ahead(handle)
        return int(self._roads.path(names[lane], route, names[came_from] if came_from >= 0 else ""))

    def _draw(self, ids: Sequence[str], width_m: Array) -> Traits:
        drawn = traits(self._driver, self._vehicle, self._seed, ids, width_m)
        if self._offsets_m:
            own = [
                self._offsets_m.get(name, offset) for name, offset in zip(ids, drawn.offset_m, strict=True)
            ]
            drawn = drawn._replace(offset_m=np.array(own, dtype=float))
        return drawn

    def _follow_fleet(self, now: Any) -> None:
        # Ordered by handle, like the snapshot; most steps change nothing.
        have = self._motion.handle
        if np.array_equal(have, now.handle):
            return
        kept = np.isin(have, now.handle, assume_unique=True)
        new = ~np.isin(now.handle, have, assume_unique=True)
        ids = [self._fleet.vehicle_id(int(handle)) for handle in now.handle[new]]
        arrived = self._draw(ids, now.width_m[new])
        handles = np.concatenate([have[kept], now.handle[new]])
        order = np.argsort(handles)
        self._traits = select(join(select(self._traits, kept), arrived), order)
        self._mind = select(join(select(self._mind, kept), attentive(arrived)), order)
        self._motion = select(join(select(self._motion, kept), standing(now.handle[new])), order)

    def _truth(self, table: Any) -> EgoTruth:
        m, n = self._motion, len(self._motion.handle)
        pose, lane, self._front_lateral_m = stand(m, table, self._vehicle.bumper_m)
        x, y, heading, curvature, speed = pose
        right, left, kind_right, kind_left, lanes_left, marked = lane
        return EgoTruth(
            handle=m.handle,
            path=m.path,
            station_m=m.station_m,
            path_offset_m=m.offset_m,
            path_heading_rad=m.heading_rad,
            x_m=x,
            y_m=y,
            heading_rad=heading,
            speed_mps=speed,
            acceleration_mps2=self._fleet.accelerations_mps2(m.handle),
            lateral_speed_mps=m.lateral_speed_mps,
            yaw_rate_rps=m.yaw_rate_rps,
            steer_rad=m.steer_rad,
            curvature_1pm=curvature,
            lane_offset_m=m.offset_m - 0.5 * (right + left),
            lane_heading_rad=m.heading_rad.copy(),
            lane_width_m=left - right,
            lanes_left=lanes_left,
            border_kind_right=kind_right,
            border_kind_left=kind_left,
            signal=self._mind.signal,
            cause=self._mind.cause,
            on_marked_road=marked if n else np.zeros(0, np.bool_),
        )


def as_driven(snapshot: Snapshot, truth: EgoTruth, bumper_m: float) -> Snapshot:
    """The snapshot with the equipped vehicles at their true poses, as other vehicles see them.

    SUMO has the lateral position of the previous step and the lane's direction; in the step in which it
    changes lanes, it has them in the middle of the new one.
    """
    rows = np.searchsorted(snapshot.handle, truth.handle)
    x, y, heading = snapshot.x_m.copy(), snapshot.y_m.copy(), snapshot.heading_rad.copy()
    speed = snapshot.speed_mps.copy()
    x[rows] = truth.x_m + bumper_m * np.cos(truth.heading_rad)
    y[rows] = truth.y_m + bumper_m * np.sin(truth.heading_rad)
    heading[rows], speed[rows] = truth.heading_rad, truth.speed_mps
    return snapshot._replace(x_m=x, y_m=y, heading_rad=heading, speed_mps=speed)


def standing(handle: Array) -> Motion:
    """Motion of vehicles without a position yet (lane −1); the next step places them on their lane."""
    n = len(handle)
    return Motion(
        handle,
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        *(np.zeros(n) for _ in Motion._fields[3:]),
    )


def _no_drive(n: int) -> Drive:
    numbers_of = np.zeros((len(Drive._fields) - 1, n))
    return Drive._make([*numbers_of, np.zeros(n, np.bool_)])


def _own(batch: B) -> B:
    # A copy: kernels write in place.
    return type(batch)(*(part.copy() for part in batch))
