"""The tracker of a fleet: predict, gate, assign, update, initiate, confirm, coast, delete, classify.

Tracks of all vehicles lie in flat arrays, sorted by vehicle, with the vehicle's row as `owner`. State is
explicit: `init(n)`, then `step(state, detections, ego, dt)` gives the next state and the present tracks;
`reindex` removes and adds vehicles.
"""

from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from plugin.tracking import classification
from plugin.tracking import tracker_kernels as kernels
from plugin.tracking.association import NONE, assign
from plugin.tracking.association_kernels import gate_pairs, unclaimed
from plugin.tracking.classification import ClassSettings, ClassState
from plugin.tracking.detections import Detections, EgoMotion, Estimate, SensorMotion, sensor_motion
from plugin.tracking.filters import FilterName, FilterSettings, make
from sumo_net.arrays import Array
from sumo_net.batch import join, select
from sumo_net.settings import kernel_view, settings

_LONGEST_HISTORY = 60


@settings
class TrackerSettings:
    """Rules of the tracker."""

    filter: FilterName = Field("imm", description="name of the filter, see `plugin.tracking.filters`")
    filters: FilterSettings = Field(default_factory=FilterSettings)
    classes: ClassSettings = Field(default_factory=ClassSettings)
    gate: float = Field(
        25.0,
        gt=0,
        description="gate, as a squared Mahalanobis distance; 16 keeps 99.9 % of 3 components, 25 also keeps "
        "turns",
    )
    label_gate: float = Field(
        400.0, gt=0, description="gate where the association is given: beyond it the target has jumped"
    )
    confirm_hits: int = Field(3, ge=1, description="M of the M-of-N rule")
    confirm_scans: int = Field(5, ge=1, le=_LONGEST_HISTORY, description="N of the M-of-N rule")
    coast_s: float = Field(
        0.8, gt=0, description="time for which a confirmed track is kept without a detection"
    )
    nearest_m: float = Field(0.3, gt=0, description="a track nearer than this has been passed and is deleted")
    furthest_m: float = Field(500.0, gt=0, description="a track further away than this is deleted")
    fastest_mps: float = Field(150.0, gt=0, description="a track faster than this over ground is deleted")

    @model_validator(mode="after")
    def _hits_fit_into_scans(self) -> Self:
        if self.confirm_hits > self.confirm_scans:
            raise ValueError(
                f"confirm_hits = {self.confirm_hits}: must be at most confirm_scans = {self.confirm_scans}"
            )
        return self


class Tracks(NamedTuple):
    """T tracks, (T,) each, sorted by owner."""

    owner: Array  # int64, row of the vehicle
    track_id: Array  # int64, unique within the vehicle, never used again
    label: Array  # int64, the given target or -1
    age: Array  # int64, scans since the first detection, including it
    history: Array  # int64, bit i set: detected i scans ago
    unseen_s: Array  # since the last detection
    confirmed: Array  # bool
    restarts: Array  # int64, how often the filter's covariance was lost and reset


class TrackerState(NamedTuple):
    """State of the tracker between scans."""

    tracks: Tracks
    classes: ClassState
    filter: Any  # the filter's own states
    rows: Array  # (T,) int64, each track's row among them
    next_id: Array  # (n,) int64


class TrackList(NamedTuple):
    """The tracks after a step, (T,) each, tentative ones too."""

    owner: Array
    track_id: Array
    label: Array
    confirmed: Array  # bool
    detection: Array  # int64, index of the detection taken, -1 where the track coasts
    motion_state: Array  # int8, index into classification.NAMES
    restarts: Array
    estimate: Estimate


class Tracker:
    """The step with its settings; holds no state."""

    def __init__(self, options: TrackerSettings) -> None:
        self.options = o = options
        self._filter = make(o.filter, o.filters)
        self._rules = kernel_view(kernels.TrackRules, o, classes=classification.rules(o.classes))

    def init(self, n: int) -> TrackerState:
        """n vehicles without tracks."""
        nobody = np.zeros(0, np.int64)
        none = Tracks(*(nobody,) * 5, unseen_s=np.zeros(0), confirmed=np.zeros(0, np.bool_), restarts=nobody)
        nothing = Detections(nobody, np.zeros(0), np.zeros(0), np.zeros(0), nobody)
        still = SensorMotion(*(np.zeros(n) for _ in SensorMotion._fields))
        no_state = self._filter.start(nothing, still)
        return TrackerState(none, classification.init(0), no_state, nobody, np.zeros(n, np.int64))

    def reindex(self, state: TrackerState, rows: Array) -> TrackerState:
        """The state for a changed fleet: its vehicle i is the old row rows[i], or a new one where that is -1.

        Tracks of vehicles not in `rows` are dropped.
        """
        rows = np.asarray(rows, np.int64)
        new_row = np.full(len(state.next_id), NONE, np.int64)
        new_row[rows[rows >= 0]] = np.flatnonzero(rows >= 0)
        owner = new_row[state.tracks.owner]
        kept = np.flatnonzero(owner >= 0)
        kept = kept[np.argsort(owner[kept], kind="stable")]
        chosen = _select(state, kept)
        next_id = np.where(rows >= 0, state.next_id[np.maximum(rows, 0)] if len(state.next_id) else 0, 0)
        return chosen._replace(tracks=chosen.tracks._replace(owner=owner[kept]), next_id=next_id)

    def join(self, *states: TrackerState) -> TrackerState:
        """The states of several fleets as one, their vehicles in the order given."""
        vehicles, filtered, moved = 0, 0, []
        followed = [state for state in states if len(state.rows)] or list(states[:1])
        filters = [select(state.filter, slice(_used(state))) for state in followed]
        for state in states:
            tracks = state.tracks._replace(owner=state.tracks.owner + vehicles)
            moved.append(state._replace(tracks=tracks, filter=(), rows=state.rows + filtered))
            vehicles, filtered = vehicles + len(state.next_id), filtered + _used(state)
        return join(*moved)._replace(filter=join(*filters))

    def step(
        self, state: TrackerState, detections: Detections, ego: EgoMotion, dt_s: Array | float
    ) -> tuple[TrackerState, TrackList]:
        """One scan of every vehicle.

        Parameters
        ----------
        detections : D detections in any order.
        ego : the n vehicles' motion, at the time of the scan.
        dt_s : (n,) array or one number, time since the vehicle's last scan; after a gap longer than
            `coast_s` all its tracks end.

        Raises ValueError where a detection or a time step is not a number, or a time step is negative.
        """
        options, filter_, n = self.options, self._filter, len(state.next_id)
        dt = np.empty(n)  # always a contiguous array: one compiled variant of the kernels
        dt[:] = dt_s
        fit, by_owner, gap = kernels.examine(detections, dt, options.coast_s)
        if not fit:
            _check(detections, dt)
        order = np.arange(len(detections.owner))
        if not by_owner:
            order = np.argsort(detections.owner, kind="stable")
            detections = select(detections, order)
        sensor = sensor_motion(ego, options.filters.mount_forward_m)
        if gap:
            state = _select(state, np.flatnonzero(dt[state.tracks.owner] <= options.coast_s))
        owner, room = state.tracks.owner, len(order)
        predicted, lost = filter_.predict(state.filter, state.rows, owner, dt, sensor, room)
        state = state._replace(filter=predicted)
        if lost.any():
            state = self._restart(state, lost)
        chosen, free, z, state = self._associate(state, detections, sensor)
        after = filter_.update(state.filter, z, chosen, owner, sensor)
        begun = select(detections, free)
        if len(free):
            after = filter_.join(after, len(owner), filter_.start(begun, sensor))
            owner = np.concatenate([owner, begun.owner])
        moving = classification.moving_threshold(options.classes, ego.speed_mps, ego.acceleration_mps2)
        tracks, classes, next_id, detection, estimates, rows = kernels.settle(
            state.tracks,
            state.classes,
            state.next_id,
            chosen,
            begun,
            free,
            order,
            filter_.estimate(after, owner, sensor),
            dt,
            moving,
            self._rules,
        )
        state = TrackerState(Tracks(*tracks), ClassState(*classes), after, rows, next_id)
        return state, _listed(state, detection, Estimate(*estimates))

    def _associate(
        self, state: TrackerState, detections: Detections, sensor: SensorMotion
    ) -> tuple[Array, Array, Array, TrackerState]:
        """Detection of each track or -1, the detections that start tracks, z, and the state."""
        options = self.options
        z = self._filter.measure(detections)
        *pairs, lost = self._gated(state, detections, z, sensor)
        if lost.any():
            state = self._restart(state, lost)
            *pairs, _ = self._gated(state, detections, z, sensor)
        track, detection, distance = pairs
        tracks = state.tracks
        gate = np.where(tracks.label < 0, options.gate, options.label_gate)
        cost = gate * np.where(tracks.confirmed, 2.0, 1.0)  # confirmed tracks are preferred
        chosen = assign(track, detection, distance, len(z), cost)
        return chosen, unclaimed(track, detection, chosen, tracks.confirmed, len(z)), z, state

    def _gated(
        self, state: TrackerState, detections: Detections, z: Array, sensor: SensorMotion
    ) -> tuple[Array, Array, Array, Array]:
        """Tracks, detections and distances of the pairs, and which S (T,) are lost, as `gate_pairs`."""
        options, tracks = self.options, state.tracks
        expected, S = self._filter.expect(state.filter, tracks.owner, sensor)
        found: tuple[Array, Array, Array, Array] = gate_pairs(
            expected,
            S,
            tracks.label,
            tracks.owner,
            z,
            detections.label,
            detections.owner,
            self._filter.angle,
            options.gate,
            options.label_gate,
        )
        return found

    def _restart(self, state: TrackerState, lost: Array) -> TrackerState:
        tracks = state.tracks
        return state._replace(
            filter=self._filter.restart(state.filter, lost),
            tracks=tracks._replace(restarts=tracks.restarts + lost),
        )


def _used(state: TrackerState) -> int:
    """Number of the filter's leading rows that contain all tracks' states."""
    return int(state.rows.max()) + 1 if len(state.rows) else 0


def _listed(state: TrackerState, detection: Array, estimate: Estimate) -> TrackList:
    tracks = state.tracks
    return TrackList(
        tracks.owner,
        tracks.track_id,
        tracks.label,
        tracks.confirmed,
        detection,
        state.classes.state,
        tracks.restarts,
        estimate,
    )


def _select(state: TrackerState, index: Array) -> TrackerState:
    return state._replace(
        tracks=select(state.tracks, index),
        classes=select(state.classes, index),
        rows=state.rows[index],
    )


def _check(detections: Detections, dt: Array) -> None:
    for name in ("range_m", "range_rate_mps", "azimuth_rad"):
        finite = np.isfinite(getattr(detections, name))
        if not finite.all():
            row = int(np.argmin(finite))
            raise ValueError(f"{name}[{row}] = {getattr(detections, name)[row]}: must be a finite number")
    if not (dt >= 0.0).all():
        raise ValueError(f"dt_s = {dt[~(dt >= 0.0)][0]}: must be 0 or more")
