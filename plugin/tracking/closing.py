"""Range and closing speed of the vehicles in path, more accurate than their tracks'.

A track's filter must suit all objects. More is known of a vehicle in path: it is ahead, it accelerates and
brakes as road vehicles do, and the camera sees the apparent width of its rear. This filter follows it along
the line of sight, with the state (range, speed over ground, acceleration, width of the rear). Its models are
Singer's, each with its own correlation time: one for steady driving, one for continued braking, one for its
beginning and end, mixed as in an IMM. The own motion is compensated as it was driven. The width is unknown at
first and learned from the radar's range; its error scales range and closing speed alike, so that it cancels
in the time to collision.
"""

from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import Projection
from plugin.tracking import closing_kernels as kernels
from plugin.tracking.detections import Detections, SensorMotion
from plugin.tracking.imm import markov_of
from plugin.tracking.models import RadarNoise
from plugin.tracking.rear_view import RearView
from plugin.tracking.tracker import TrackList
from sumo_net.arrays import Array
from sumo_net.batch import select
from sumo_net.settings import kernel_view, settings

_STATES = 4


@settings
class Closing:
    """The filter for range and closing speed of vehicles in path."""

    enabled: bool = Field(
        True, description="use this filter; false: the warning takes range and speed of the tracks"
    )
    camera: bool = Field(True, description="use the apparent width of the rear in the camera's frames")
    acceleration_mps2: tuple[float, ...] = Field(
        (0.5, 8.0, 8.0), min_length=1, max_length=5, description="σ of the acceleration of each model"
    )
    time_s: tuple[float, ...] = Field(
        (2.0, 200.0, 2.0),
        min_length=1,
        max_length=5,
        description="correlation time of that acceleration: steady driving, sustained braking, beginning and "
        "end of braking",
    )
    stay: float = Field(0.95, gt=0, lt=1, description="probability that a model still applies 0.1 s later")
    width_m: float = Field(2.0, gt=0, description="width of a rear before it has been seen")
    width_std_m: float = Field(0.4, gt=0, description="standard deviation of that width")
    width_walk_m: float = Field(
        0.01, ge=0, description="random walk of the width in 1 s, as sides come into view"
    )
    edge_px: float = Field(
        0.05, gt=0, description="σ of the apparent width in the image, besides that of its two sides"
    )
    edge_share: float = Field(0.0002, ge=0, description="further noise in proportion to the apparent width")
    gate: float = Field(
        9.0,
        gt=0,
        description="gate, as innovation squared over its variance; measurements beyond it are dropped",
    )

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

    markov: Array  # (r, r) for 0.1 s
    acceleration_mps2: Array  # (r,)
    time_s: Array  # (r,)
    range_std_m: float  # of a detection
    rate_std_mps: float
    width_m: float
    width_std_m: float
    width_walk_m: float  # in a second
    edge_px: float
    edge_share: float
    gate: float
    ahead_m: float  # of the camera: the radar
    focal_px: float


class ClosingState(NamedTuple):
    """L leaders of the whole fleet, (L, …) each, in the order of their tracks."""

    owner: Array  # int64, row of the vehicle
    track_id: Array  # int64
    x: Array  # (L, r, 4): range, speed over ground along the line of sight, acceleration, width
    P: Array  # (L, r, 4, 4)
    mu: Array  # (L, r)
    own_mps: Array  # the radar's own speed along the line of sight
    misfits: Array  # int64, consecutive widths outside the gate


class ClosingFilter:
    """The step with its settings; holds no state."""

    def __init__(
        self, options: Closing, noise: RadarNoise, mount_forward_m: float, projection: Projection
    ) -> None:
        self.options = options
        self._numbers = kernel_view(
            ClosingNumbers,
            options,
            markov=markov_of(options.stay, len(options.acceleration_mps2)),
            acceleration_mps2=np.array(options.acceleration_mps2),
            time_s=np.array(options.time_s),
            range_std_m=noise.range_m,
            rate_std_mps=noise.range_rate_mps,
            ahead_m=mount_forward_m - projection.forward,
            focal_px=projection.focal,
        )

    def init(self) -> ClosingState:
        """State without leaders."""
        r = len(self._numbers.acceleration_mps2)
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
        """One scan of n vehicles: the state, and the tracks with the leaders' improved range and speed.

        tracks : after the tracker's step, which took `detections`; sensor, view : (n,) each. in_path (n, K)
        int64 : ids of the tracks in path one step ago, which are followed from now on; else -1.
        """
        parts, better = kernels.follow(
            state, tracks, detections, sensor, view, in_path, dt_s, self.options.camera, self._numbers
        )
        range_m, rate, x, y, vx, vy, ax, ay = better
        estimate = tracks.estimate._replace(
            range_m=range_m, range_rate_mps=rate, x_m=x, y_m=y, vx_mps=vx, vy_mps=vy, ax_mps2=ax, ay_mps2=ay
        )
        return ClosingState(*parts), tracks._replace(estimate=estimate)
