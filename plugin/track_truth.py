"""What truly is behind each radar track: the rows of the table `tracks`. Scoring, not for the driver."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from plugin.ranging import Echo
from plugin.track_truth_kernels import places
from plugin.tracking import classification
from plugin.tracking.classification import (
    ONCOMING,
    SAME_DIRECTION,
    STATIONARY,
    STOPPED_ONCOMING,
    STOPPED_SAME,
    ClassSettings,
)
from plugin.truth import labelled
from sumo_net.ego import EgoTruth

Array = np.ndarray[Any, Any]

NOTHING = -1  # target of a track that began from clutter


class Followed(NamedTuple):
    """T tracks as they were after the last step, (T,) each, by key."""

    key: Array  # int64, vehicle and track
    target: Array  # int64, handle of the body that was detected last
    true_class: Array  # int8, index into classification.NAMES


class TrackTruth:
    """Follows which body each track of the fleet belongs to, and what its class should be.

    The class is that of the published rules, without their waiting cycles, on the true velocities since the
    track took up the body.
    """

    def __init__(self, options: ClassSettings, name: Callable[[int], str]) -> None:
        """`name`: id of a vehicle by handle."""
        self._options, self._name = options, name
        self._before = Followed(*(np.zeros(0, np.int64),) * 2, true_class=np.zeros(0, np.int8))

    def step(self, truth: EgoTruth, echo: Echo) -> dict[str, Array]:
        """The confirmed tracks' columns of the table `tracks`, without time; `texts` makes the last ones.

        In place of text there are codes: `handle` of the vehicle, `target` and the classes.
        """
        tracks, behind = echo.tracks, echo.behind
        measured = tracks.detection >= 0
        row, column = (part[tracks.detection[measured]] for part in echo.place)

        def detected(part: Array) -> Array:
            values = np.full(len(measured), np.nan)
            values[measured] = part[row, column]
            return values

        key = (truth.handle[tracks.owner] << 32) | tracks.track_id
        target, true_class = self._recall(key)
        taken = behind.handle[row, column]
        body = taken != NOTHING  # a track that takes clutter still follows its body
        index = np.flatnonzero(measured)[body]
        true_class[index[target[index] != taken[body]]] = STATIONARY
        target[index] = taken[body]
        vx, vy = _velocity(echo, tracks.owner, target)
        threshold = classification.moving_threshold(self._options, truth.speed_mps, truth.acceleration_mps2)
        true_class = _advanced(true_class, vx, threshold[tracks.owner], self._options)
        self._before = Followed(key, target, true_class)

        shown = np.flatnonzero(tracks.confirmed)
        closing = -tracks.estimate.range_rate_mps
        with np.errstate(divide="ignore"):
            ttc = np.where(closing > 0.0, tracks.estimate.range_m / np.maximum(closing, 1e-9), np.nan)
        known = target != NOTHING
        columns = tracks.estimate._asdict() | {
            "handle": truth.handle[tracks.owner],
            "target": target,
            "track_id": tracks.track_id,
            "measured": measured,
            "motion_state": tracks.motion_state,
            "in_path": echo.in_path.inside,
            "ttc_s": ttc,
            "restarts": tracks.restarts,
            "true_range_m": detected(behind.range_m),
            "true_range_rate_mps": detected(behind.range_rate_mps),
            "true_azimuth_rad": detected(behind.azimuth_rad),
            "true_vx_mps": vx,
            "true_vy_mps": vy,
            "true_motion_state": np.where(known & np.isfinite(vx), true_class, -1),
        }
        return {name: part[shown] for name, part in columns.items()}

    def texts(self, columns: dict[str, Array]) -> dict[str, Any]:
        """Columns of any number of steps as the table has them."""
        out: dict[str, Any] = dict(columns)
        out["vehicle_id"] = self._ids(out.pop("handle"))
        out["target_id"] = self._ids(out.pop("target"))
        for name in ("motion_state", "true_motion_state"):
            out[name] = labelled(columns[name], classification.NAMES)
        return out

    def _recall(self, key: Array) -> tuple[Array, Array]:
        """Target and class of the tracks `key` as they were; new ones have none."""
        target, true_class = np.full(len(key), NOTHING, np.int64), np.full(len(key), STATIONARY, np.int8)
        before = self._before
        if len(before.key):
            at = np.minimum(np.searchsorted(before.key, key), len(before.key) - 1)
            same = before.key[at] == key
            target[same], true_class[same] = before.target[at[same]], before.true_class[at[same]]
        return target, true_class

    def _ids(self, handles: Array) -> pa.Array:
        unique, index = np.unique(handles, return_inverse=True)
        names = [self._id(handle) for handle in unique.tolist()]
        return pa.DictionaryArray.from_arrays(
            pa.array(index.astype(np.int32)), pa.array(names, type=pa.string())
        ).dictionary_decode()

    def _id(self, handle: int) -> str | None:
        if handle == NOTHING:
            return None
        if handle < NOTHING:
            return f"roadside:{-handle - 2}"
        try:
            return self._name(handle)
        except KeyError:  # left long ago; clutter has kept its track alive
            return None


def _velocity(echo: Echo, owner: Array, target: Array) -> tuple[Array, Array]:
    """True velocity over ground in the vehicle's axes of each track's body; NaN out of the field of view."""
    objects = echo.objects
    place = places(owner, target, objects.handle)
    known = (place >= 0) & (target != NOTHING)  # NOTHING would find the first unused place
    speed, heading = objects.speed_mps[owner, place], objects.heading_rad[owner, place]
    return np.where(known, speed * np.cos(heading), np.nan), np.where(known, speed * np.sin(heading), np.nan)


def _advanced(true_class: Array, vx: Array, threshold: Array, options: ClassSettings) -> Array:
    near = np.abs(vx) < options.near_zero_mps
    return np.select(
        [
            vx > threshold,
            vx < options.oncoming_speed_mps,
            near & (true_class == SAME_DIRECTION),
            near & (true_class == ONCOMING),
        ],
        [SAME_DIRECTION, ONCOMING, STOPPED_SAME, STOPPED_ONCOMING],
        true_class,
    ).astype(np.int8)
