"""What truly is behind each radar track: the rows of the table `tracks`. Scoring, not for the driver."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from plugin import step_columns
from plugin.ranging import Echo
from plugin.track_truth_kernels import NOTHING, follow
from plugin.tracking import classification
from plugin.tracking.classification import ClassSettings
from plugin.truth import labelled
from sumo_net import batch
from sumo_net.ego import EgoTruth

Array = np.ndarray[Any, Any]


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

    def step(self, parts: Sequence[tuple[EgoTruth, Echo]]) -> dict[str, Array]:
        """All tracks' columns of the table `tracks`, without time; `texts` makes the last ones.

        The fleet comes in parts, one vehicle's handle after the other. In place of text there are codes:
        `handle` of the vehicle, `target` and the classes.
        """
        followed, columns = zip(*(self._follow(truth, echo) for truth, echo in parts), strict=True)
        self._before = batch.join(*followed)
        return step_columns.join(*columns)

    def _follow(self, truth: EgoTruth, echo: Echo) -> tuple[Followed, dict[str, Array]]:
        tracks, o = echo.tracks, self._options
        threshold = classification.moving_threshold(o, truth.speed_mps, truth.acceleration_mps2)
        key, target, true_class, shown, floats = follow(
            truth.handle, tracks, echo.place, echo.behind, echo.objects, self._before, threshold,
            o.oncoming_speed_mps, o.near_zero_mps,
        )  # fmt: skip
        true_range, true_rate, true_azimuth, vx, vy, ttc = floats
        return Followed(key, target, true_class), tracks.estimate._asdict() | {
            "handle": truth.handle[tracks.owner],
            "target": target,
            "track_id": tracks.track_id,
            "measured": tracks.detection >= 0,
            "motion_state": tracks.motion_state,
            "in_path": echo.in_path.inside,
            "ttc_s": ttc,
            "restarts": tracks.restarts,
            "true_range_m": true_range,
            "true_range_rate_mps": true_rate,
            "true_azimuth_rad": true_azimuth,
            "true_vx_mps": vx,
            "true_vy_mps": vy,
            "true_motion_state": shown,
        }

    def texts(self, columns: dict[str, Array]) -> dict[str, Any]:
        """Columns of any number of steps as the table has them."""
        out: dict[str, Any] = dict(columns)
        out["vehicle_id"] = self._ids(out.pop("handle"))
        out["target_id"] = self._ids(out.pop("target"))
        for name in ("motion_state", "true_motion_state"):
            out[name] = labelled(columns[name], classification.NAMES)
        return out

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
