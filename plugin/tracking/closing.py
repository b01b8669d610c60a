"""Range and closing speed of the vehicles in path, better than their tracks have them.

A track's filter has to serve for all objects. Of what is in path more is known: it is ahead, it accelerates
and brakes as road vehicles do, and the camera sees how wide its rear looks. This filter follows it along the
line of sight, with the state (range, speed over ground, acceleration, width of the rear). Its models are
Singer's, each with its own correlation time: one for steady driving, one for a braking that goes on, one for
its beginning and end, mixed as in an IMM. The own way is taken out as it was driven. The width is unknown
at first and learned from the radar's range; an error of it scales range and closing speed alike, so that
the time to collision does not feel it.
"""

from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import Projection
from plugin.tracking import closing_kernels as kernels
from plugin.tracking.closing_kernels import SPEED, WIDTH
from plugin.tracking.detections import Detections, SensorMotion
from plugin.tracking.models import RadarNoise
from plugin.tracking.rear_view import RearView
from plugin.tracking.tracker import TrackList
from sumo_net.batch import join, select
from sumo_net.settings import settings

Array = np.ndarray[Any, Any]

_STATES = 4


@settings
class Closing:
    """How the vehicles in path are followed along the line of sight."""

    enabled: bool = Field(
        True, description="else the warning takes range and speed of the tracks as they are"
    )
    camera: bool = Field(True, description="with how wide the rear looks in the camera's frames")
    acceleration_mps2: tuple[float, ...] = Field(
        (0.5, 8.0, 8.0), min_length=1, max_length=5, description="σ of each model's acceleration"
    )
    time_s: tuple[float, ...] = Field(
        (2.0, 200.0, 2.0),
        min_length=1,
        max_length=5,
        description="for how long it is correlated: steady driving, a braking that goes on, its beginning",
    )
    stay: float = Field(0.95, gt=0, lt=1, description="probability that a model still holds 0.1 s later")
    width_m: float = Field(2.0, gt=0, description="of a rear, before it has been seen")
    width_std_m: float = Field(0.4, gt=0, description="standard deviation of that")
    width_walk_m: float = Field(0.003, ge=0, description="how far it wanders in 1 s: sides come into view")
    edge_px: float = Field(0.1, gt=0, description="σ of the width in the image")
    edge_share: float = Field(0.0002, ge=0, description="and, in proportion to it")
    gate: float = Field(9.0, gt=0, description="innovation squared over its variance; beyond it is dropped")

    @model_validator(mode="after")
    def _accelerations(self) -> Self:
        if min(self.acceleration_mps2) <= 0.0:
            raise ValueError(f"acceleration_mps2 = {self.acceleration_mps2}: each must be above 0")
        if min(self.time_s) <= 0.0 or len(self.time_s) != len(self.acceleration_mps2):
            raise ValueError(
                f"time_s = {self.time_s}: must be {len(self.acceleration_mps2)} numbers above 0, "
                "one for each of acceleration_mps2"
            )
        return self


class ClosingNumbers(NamedTuple):
    """Closing as kernels take it."""

    markov: Array  # (r, r) of 0.1 s
    sigma: Array  # (r,) m/s²
    time: Array  # (r,) s
    range_noise: float
    rate_noise: float
    width: float
    width_std: float
    width_walk: float  # m per root second
    edge_px: float
    edge_share: float
    gate: float
    ahead: float  # m, radar ahead of the camera
    focal: float


class ClosingState(NamedTuple):
    """L leaders of the whole fleet, (L, …) each, in the order of their tracks."""

    owner: Array  # int64, row of the vehicle
    track_id: Array  # int64
    x: Array  # (L, r, 4): range, speed over ground along the line of sight, acceleration, width
    P: Array  # (L, r, 4, 4)
    mu: Array  # (L, r)
    own_mps: Array  # the radar's own speed along the line of sight
    misfits: Array  # int64, widths in a row that did not fit


class ClosingFilter:
    """The step with its settings; holds no state."""

    def __init__(
        self, options: Closing, noise: RadarNoise, mount_forward_m: float, projection: Projection
    ) -> None:
        self.options = options
        r = len(options.acceleration_mps2)
        markov = np.full((r, r), (1.0 - options.stay) / max(r - 1, 1))
        np.fill_diagonal(markov, options.stay if r > 1 else 1.0)
        self._numbers = ClosingNumbers(
            markov,
            np.array(options.acceleration_mps2),
            np.array(options.time_s),
            noise.range_m,
            noise.range_rate_mps,
            options.width_m,
            options.width_std_m,
            options.width_walk_m,
            options.edge_px,
            options.edge_share,
            options.gate,
            mount_forward_m - projection.forward,
            projection.focal,
        )

    def init(self) -> ClosingState:
        """Nobody in any path."""
        r = len(self._numbers.sigma)
        nobody = np.zeros(0, np.int64)
        return ClosingState(
            nobody,
            nobody,
            np.zeros((0, r, _STATES)),
            np.zeros((0, r, _STATES, _STATES)),
            np.zeros((0, r)),
            np.zeros(0),
            nobody,
        )

    def reindex(self, state: ClosingState, rows: Array) -> ClosingState:
        """The state for a changed fleet: its vehicle i is the old row rows[i], or new where that is -1."""
        if not len(state.owner):
            return state
        new_row = np.full(max(int(state.owner.max()), int(rows.max(initial=0))) + 1, -1, np.int64)
        new_row[rows[rows >= 0]] = np.flatnonzero(rows >= 0)
        owner = new_row[state.owner]
        kept = np.flatnonzero(owner >= 0)
        kept = kept[np.argsort(owner[kept], kind="stable")]
        return select(state, kept)._replace(owner=owner[kept])

    def step(
        self,
        state: ClosingState,
        tracks: TrackList,
        detections: Detections,
        sensor: SensorMotion,
        view: RearView,
        in_path: Array,
        dt_s: float,
    ) -> tuple[ClosingState, TrackList]:
        """One scan of n vehicles: the state, and the tracks with the leaders' range and speed made better.

        tracks : after the tracker's step, which took `detections`; sensor, view : (n,) each. in_path (n, K)
        int64 : ids of the tracks that were in path a step before, and are followed from now on; else -1.
        """
        key = tracks.owner << 32 | tracks.track_id
        known = state.owner << 32 | state.track_id
        row = np.searchsorted(key, known)  # both in ascending order
        alive = np.append(key, -1)[row] == known
        row, state = row[alive], select(state, alive)
        along = self._step(state, row, tracks, detections, sensor, view, dt_s)
        entered = (in_path[tracks.owner] == tracks.track_id[:, None]).any(axis=1)
        entered[row] = False
        if entered.any():
            state, row, along = self._begin(state, row, along, np.flatnonzero(entered), tracks, sensor)
        return state, tracks._replace(estimate=self._refined(tracks, row, along, sensor))

    def _step(
        self,
        state: ClosingState,
        row: Array,
        tracks: TrackList,
        detections: Detections,
        sensor: SensorMotion,
        view: RearView,
        dt_s: float,
    ) -> Array:
        """Move the state on in place; the mixture's mean (L, 4)."""
        owner, detection = state.owner, tracks.detection[row]
        measured = detection >= 0
        z = np.full((2, len(row)), np.nan)
        z[0, measured] = detections.range_m[detection[measured]]
        z[1, measured] = detections.range_rate_mps[detection[measured]]
        width = np.full(len(row), np.nan)
        if self.options.camera:
            looked = view.track_id[owner] == state.track_id
            width[looked] = (view.right_px - view.left_px)[owner[looked]]
        own = _own_speed(tracks, row, sensor)
        mean = np.empty((len(row), _STATES))
        kernels.step(
            state.x, state.P, state.mu, state.own_mps, state.misfits,
            own, z[0], z[1], width, dt_s, self._numbers, mean,
        )  # fmt: skip
        return mean

    def _begin(
        self,
        state: ClosingState,
        row: Array,
        along: Array,
        new: Array,
        tracks: TrackList,
        sensor: SensorMotion,
    ) -> tuple[ClosingState, Array, Array]:
        r, e, count = len(self._numbers.sigma), select(tracks.estimate, new), len(new)
        own = _own_speed(tracks, new, sensor)
        x = np.zeros((count, _STATES))
        x[:, 0], x[:, SPEED], x[:, WIDTH] = e.range_m, e.range_rate_mps + own, self.options.width_m
        P = np.diag([0.5**2, 0.5**2, 2.0**2, self.options.width_std_m**2])
        begun = ClosingState(
            tracks.owner[new],
            tracks.track_id[new],
            np.repeat(x[:, None], r, axis=1),
            np.tile(P, (count, r, 1, 1)),
            np.full((count, r), 1.0 / r),
            own,
            np.zeros(count, np.int64),
        )
        row = np.concatenate([row, new])
        order = np.argsort(row)
        return select(join(state, begun), order), row[order], np.concatenate([along, x])[order]

    def _refined(self, tracks: TrackList, row: Array, along: Array, sensor: SensorMotion) -> Any:
        e = tracks.estimate
        c, s = np.cos(e.azimuth_rad[row]), np.sin(e.azimuth_rad[row])
        further = along[:, 0] - e.range_m[row]
        rate = along[:, SPEED] - _own_speed(tracks, row, sensor)
        faster = rate - e.range_rate_mps[row]
        harder = along[:, 2] - (e.ax_mps2[row] * c + e.ay_mps2[row] * s)

        def changed(part: Array, by: Array) -> Array:
            out = part.copy()
            out[row] += by
            return out

        return e._replace(
            range_m=changed(e.range_m, further),
            range_rate_mps=changed(e.range_rate_mps, faster),
            x_m=changed(e.x_m, further * c),
            y_m=changed(e.y_m, further * s),
            vx_mps=changed(e.vx_mps, faster * c),
            vy_mps=changed(e.vy_mps, faster * s),
            ax_mps2=changed(e.ax_mps2, harder * c),
            ay_mps2=changed(e.ay_mps2, harder * s),
        )


def _own_speed(tracks: TrackList, row: Array, sensor: SensorMotion) -> Array:
    """The radar's speed along the line of sight to the tracks `row`."""
    azimuth, owner = tracks.estimate.azimuth_rad[row], tracks.owner[row]
    return np.cos(azimuth) * sensor.vx[owner] + np.sin(azimuth) * sensor.vy[owner]
