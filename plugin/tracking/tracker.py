"""The tracker of a fleet: predict, gate, assign, update, begin, confirm, coast, delete, classify.

Tracks of all vehicles lie in flat arrays, sorted by vehicle, with the vehicle's row as `owner`. State is
explicit: `init(n)`, then `step(state, detections, ego, dt)` gives the next state and the tracks as they are
now; `reindex` lets vehicles leave and come.
"""

from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from plugin.tracking import classification
from plugin.tracking.association import NONE, assign
from plugin.tracking.association_kernels import definite, gate_pairs, suppressed
from plugin.tracking.classification import ClassSettings, ClassState
from plugin.tracking.detections import Array, Detections, EgoMotion, Estimate, SensorMotion, sensor_motion
from plugin.tracking.filters import FilterName, FilterSettings, make
from sumo_net.batch import select, select_joined
from sumo_net.settings import settings

_LONGEST_HISTORY = 60


@settings
class TrackerSettings:
    """The tracker's rules."""

    filter: FilterName = Field("imm", description="which one, of `plugin.tracking.filters`")
    filters: FilterSettings = Field(default_factory=FilterSettings)
    classes: ClassSettings = Field(default_factory=ClassSettings)
    gate: float = Field(
        25.0, gt=0, description="Mahalanobis distance squared; 16 keeps 99.9 % of 3 components, 25 turns too"
    )
    label_gate: float = Field(
        400.0, gt=0, description="the same where the target is given: beyond it the target has jumped"
    )
    confirm_hits: int = Field(3, ge=1, description="M of the M-of-N rule")
    confirm_scans: int = Field(5, ge=1, le=_LONGEST_HISTORY, description="N of the M-of-N rule")
    coast_s: float = Field(0.8, gt=0, description="how long a confirmed track lives without a detection")
    nearest_m: float = Field(0.3, gt=0, description="a track nearer than this has been passed")
    furthest_m: float = Field(500.0, gt=0, description="a track further than this has run away")
    fastest_mps: float = Field(150.0, gt=0, description="so has one faster than this over ground")

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
    age: Array  # int64, scans since and with the first detection
    history: Array  # int64, bit i set: detected i scans ago
    unseen_s: Array  # since the last detection
    confirmed: Array  # bool
    restarts: Array  # int64, how often the filter's covariance was lost and begun anew


class TrackerState(NamedTuple):
    """Everything the tracker remembers; `filter` is the filter's own batch of T states."""

    tracks: Tracks
    filter: Any
    classes: ClassState
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
        self.options = options
        self._filter = make(options.filter, options.filters)

    def init(self, n: int) -> TrackerState:
        """n vehicles without tracks."""
        nobody = np.zeros(0, np.int64)
        none = Tracks(*(nobody,) * 5, unseen_s=np.zeros(0), confirmed=np.zeros(0, np.bool_), restarts=nobody)
        nothing = Detections(nobody, np.zeros(0), np.zeros(0), np.zeros(0), nobody)
        still = SensorMotion(*(np.zeros(n) for _ in SensorMotion._fields))
        return TrackerState(
            none, self._filter.start(nothing, still), classification.init(0), np.zeros(n, np.int64)
        )

    def reindex(self, state: TrackerState, rows: Array) -> TrackerState:
        """The state for a changed fleet: its vehicle i is the old row rows[i], or a new one where that is -1.

        Tracks of vehicles that are not named are dropped.
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

    def step(
        self, state: TrackerState, detections: Detections, ego: EgoMotion, dt_s: Array | float
    ) -> tuple[TrackerState, TrackList]:
        """One scan of every vehicle.

        Parameters
        ----------
        detections : D of them in any order.
        ego : the n vehicles' motion, at the time of the scan.
        dt_s : (n,) array or one number, time since the vehicle's last scan; after a gap longer than
            `coast_s` all its tracks end.

        Raises ValueError where a detection or a time step is not a number, or a time step is negative.
        """
        options, n = self.options, len(state.next_id)
        dt = np.empty(n)  # of its own: one variant of the kernels
        dt[:] = dt_s
        _check(detections, dt)
        sensor = sensor_motion(ego, options.filters.mount_forward_m)
        order = np.argsort(detections.owner, kind="stable")
        sorted_detections = select(detections, order)

        if n and dt.max() > options.coast_s:
            state = _kept(state, dt[state.tracks.owner] <= options.coast_s)
        state = state._replace(filter=self._filter.predict(state.filter, state.tracks.owner, dt, sensor))
        lost = self._filter.lost(state.filter)
        if lost.any():
            state = self._restart(state, lost)
        chosen, double, z, state = self._associate(state, sorted_detections, sensor)
        seen = chosen >= 0
        given = z[chosen] if len(z) else np.zeros((len(chosen), 3))
        owner = state.tracks.owner
        state = state._replace(filter=self._filter.update(state.filter, given, seen, owner, sensor))
        tracks = self._age(state.tracks, seen, dt)
        estimate = self._filter.estimate(state.filter, owner, sensor)
        alive = self._alive(tracks, estimate)
        free = ~double
        free[chosen[seen]] = False
        if (tracks.label >= 0).any():  # a target may have jumped away from its track
            alive &= seen | ~_named(tracks, sorted_detections, free)
        state, begun = state._replace(tracks=tracks), np.flatnonzero(free)
        if len(begun):  # the dead leave and the new take their places in one go: covariances are large
            state, rows = self._begin(state, alive, select(sorted_detections, begun), sensor)
            chosen = np.concatenate([chosen, begun])[rows]
        else:
            state, chosen = _kept(state, alive), chosen[alive]
        return self._classify(state, chosen, order, ego, sensor)

    def _associate(
        self, state: TrackerState, detections: Detections, sensor: SensorMotion
    ) -> tuple[Array, Array, Array, TrackerState]:
        """Detection of each track or -1, which detections may not begin a track, z, and the state."""
        options, tracks = self.options, state.tracks
        expected, S = self._filter.expect(state.filter, tracks.owner, sensor)
        lost = ~definite(S)
        if lost.any():
            state = self._restart(state, lost)
            expected, S = self._filter.expect(state.filter, tracks.owner, sensor)
        z = self._filter.measure(detections)
        track, detection, distance = gate_pairs(
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
        gate = np.where(tracks.label < 0, options.gate, options.label_gate)
        cost = gate * np.where(tracks.confirmed, 2.0, 1.0)  # a confirmed track has the first choice
        chosen = assign(track, detection, distance, len(z), cost)
        return chosen, suppressed(track, detection, chosen, tracks.confirmed, len(z)), z, state

    def _restart(self, state: TrackerState, lost: Array) -> TrackerState:
        tracks = state.tracks
        return state._replace(
            filter=self._filter.restart(state.filter, lost),
            tracks=tracks._replace(restarts=tracks.restarts + lost),
        )

    def _age(self, tracks: Tracks, seen: Array, dt: Array) -> Tracks:
        window = (1 << self.options.confirm_scans) - 1
        history = ((tracks.history << 1) | seen) & window
        hits = np.bitwise_count(history)
        return tracks._replace(
            age=tracks.age + 1,
            history=history,
            unseen_s=np.where(seen, 0.0, tracks.unseen_s + dt[tracks.owner]),
            confirmed=tracks.confirmed | (hits >= self.options.confirm_hits),
        )

    def _alive(self, tracks: Tracks, estimate: Estimate) -> Array:
        options = self.options
        hits = np.bitwise_count(tracks.history)
        chances = np.maximum(options.confirm_scans - tracks.age, 0)
        hopeful = tracks.confirmed | (hits + chances >= options.confirm_hits)
        speed = np.abs(estimate.vx_mps) + np.abs(estimate.vy_mps)  # NaN fails every test below
        coasting = tracks.unseen_s <= options.coast_s + 1e-9
        near = (estimate.range_m > options.nearest_m) & (estimate.range_m < options.furthest_m)
        return hopeful & coasting & near & (speed < options.fastest_mps)

    def _begin(
        self, state: TrackerState, alive: Array, detections: Detections, sensor: SensorMotion
    ) -> tuple[TrackerState, Array]:
        """The state with the tracks that are `alive` and new ones, and their rows, the new ones' counted on.

        A new track with a given target is confirmed at once, its association being certain.
        """
        count = len(detections.owner)
        owner = detections.owner  # sorted: number the new tracks within each vehicle
        within = np.arange(count) - np.searchsorted(owner, owner)
        ones, zeros = np.ones(count, np.int64), np.zeros(count, np.int64)
        confirmed = (detections.label >= 0) | (self.options.confirm_hits == 1)
        new = Tracks(
            owner,
            state.next_id[owner] + within,
            detections.label,
            ones,
            ones,
            np.zeros(count),
            confirmed,
            zeros,
        )
        rows = np.concatenate([np.flatnonzero(alive), len(alive) + np.arange(count)])
        owners = np.concatenate([state.tracks.owner, owner])
        rows = rows[np.argsort(owners[rows], kind="stable")]
        return TrackerState(
            select_joined(state.tracks, new, rows),
            select_joined(state.filter, self._filter.start(detections, sensor), rows),
            select_joined(state.classes, classification.init(count), rows),
            state.next_id + np.bincount(owner, minlength=len(state.next_id)),
        ), rows

    def _classify(
        self, state: TrackerState, chosen: Array, order: Array, ego: EgoMotion, sensor: SensorMotion
    ) -> tuple[TrackerState, TrackList]:
        tracks = state.tracks
        estimate = self._filter.estimate(state.filter, tracks.owner, sensor)
        threshold = classification.moving_threshold(
            self.options.classes, ego.speed_mps, ego.acceleration_mps2
        )[tracks.owner]
        classes = classification.step(
            state.classes, estimate.vx_mps, chosen >= 0, threshold, self.options.classes
        )
        detection = np.full(len(chosen), NONE, np.int64)
        detection[chosen >= 0] = order[chosen[chosen >= 0]]
        return state._replace(classes=classes), TrackList(
            tracks.owner,
            tracks.track_id,
            tracks.label,
            tracks.confirmed,
            detection,
            classes.state,
            tracks.restarts,
            estimate,
        )


def _select(state: TrackerState, index: Array) -> TrackerState:
    return state._replace(
        tracks=select(state.tracks, index),
        filter=select(state.filter, index),
        classes=select(state.classes, index),
    )


def _kept(state: TrackerState, mask: Array) -> TrackerState:
    return state if mask.all() else _select(state, np.flatnonzero(mask))


def _check(detections: Detections, dt: Array) -> None:
    for name in ("range_m", "range_rate_mps", "azimuth_rad"):
        finite = np.isfinite(getattr(detections, name))
        if not finite.all():
            row = int(np.argmin(finite))
            raise ValueError(f"{name}[{row}] = {getattr(detections, name)[row]}: must be a finite number")
    if not (dt >= 0.0).all():
        raise ValueError(f"dt_s = {dt[~(dt >= 0.0)][0]}: must be 0 or more")


def _named(tracks: Tracks, detections: Detections, free: Array) -> Array:
    """Whether a free detection bears the track's own label (T,)."""
    named = np.zeros(len(tracks.owner), np.bool_)
    labelled = free & (detections.label >= 0)
    if labelled.any():
        given = np.stack([detections.owner[labelled], detections.label[labelled]], axis=1)
        own = np.stack([tracks.owner, tracks.label], axis=1)
        named = (own[:, None] == given[None]).all(axis=2).any(axis=1)
    return named
