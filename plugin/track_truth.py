"""The true body behind each radar track, and the rows of the table `tracks`. For scoring only."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from plugin import track_truth_kernels as kernels
from plugin.ranging import Echo
from plugin.track_truth_kernels import NOTHING
from plugin.tracking import classification
from plugin.tracking.classification import ClassSettings
from plugin.tracking.detections import Estimate
from plugin.tracking.tracker import TrackList
from plugin.truth import labelled, named
from sumo_net.arrays import Array
from sumo_net.batch import join
from sumo_net.ego import EgoTruth

NUMBERS = (
    *Estimate._fields,
    "true_range_m",
    "true_range_rate_mps",
    "true_azimuth_rad",
    "true_vx_mps",
    "true_vy_mps",
    "ttc_s",
)
CODES = (
    "handle",
    "target",
    "track_id",
    "restarts",
    "measured",
    "in_path",
    "motion_state",
    "true_motion_state",
)


class Rows(NamedTuple):
    """K rows of the table `tracks`, without time; text as codes."""

    numbers: Array  # (16, K), NUMBERS
    codes: Array  # (8, K) int64, CODES


class Followed(NamedTuple):
    """T tracks after the last step, (T,) each, sorted by key."""

    key: Array  # int64, vehicle and track
    target: Array  # int64, handle of the body that was detected last
    true_class: Array  # int8, index into classification.NAMES


class Step(NamedTuple):
    """One scan's tracks with their truth, (T,) each."""

    handle: Array  # (n,) of the vehicles
    tracks: TrackList
    inside: Array  # bool: in path
    target: Array  # int64, handle of the body that was detected last
    shown: Array  # int8, the true class, -1 where unknown
    floats: Array  # (6, T), as `track_truth_kernels.follow` gives them

    def of(self, chosen: Array) -> Rows:
        """The rows of the table `tracks` of the chosen tracks (T,)."""
        return Rows(*kernels.rows(*self, chosen))


class TrackTruth:
    """Follows which body each track of the fleet belongs to, and its true class.

    The class follows the published rules, without their waiting cycles, on the true velocities since the
    track was first assigned to the body.
    """

    def __init__(self, options: ClassSettings) -> None:
        self._options = options
        self._before = Followed(*(np.zeros(0, np.int64),) * 2, true_class=np.zeros(0, np.int8))

    def follow(self, truth: EgoTruth, echo: Echo) -> tuple[Followed, Step]:
        """Truth of the tracks of a part of the fleet after a scan; pass the first to `keep`."""
        tracks, o = echo.tracks, self._options
        threshold = classification.moving_threshold(o, truth.speed_mps, truth.acceleration_mps2)
        key, target, true_class, shown, floats = kernels.follow(
            truth.handle, tracks, echo.place, echo.behind, echo.objects, self._before, threshold,
            o.oncoming_speed_mps, o.near_zero_mps,
        )  # fmt: skip
        step = Step(truth.handle, tracks, echo.in_path.inside, target, shown, floats)
        return Followed(key, target, true_class), step

    def keep(self, parts: Iterable[Followed]) -> None:
        """Store what the whole fleet's tracks follow, for the next scan; parts in the order of handles."""
        self._before = join(*parts)


def table(time_s: Sequence[float], steps: Sequence[Rows], names: Mapping[int, str]) -> dict[str, Any]:
    """Columns of the table `tracks` of some steps' rows; `names`: ids of vehicles by handle."""
    out: dict[str, Any] = {}
    for name, *parts in zip(NUMBERS, *(rows.numbers for rows in steps), strict=True):
        out[name] = np.concatenate(parts)
    for name, *parts in zip(CODES, *(rows.codes for rows in steps), strict=True):
        out[name] = np.concatenate(parts)
    out["time_s"] = np.repeat(time_s, [rows.codes.shape[1] for rows in steps])
    out["vehicle_id"] = named(out.pop("handle"), names.__getitem__)
    out["target_id"] = named(out.pop("target"), lambda handle: _target(handle, names))
    for name in ("measured", "in_path"):
        out[name] = out[name] != 0
    for name in ("motion_state", "true_motion_state"):
        out[name] = labelled(out[name], classification.NAMES)
    return out


def _target(handle: int, names: Mapping[int, str]) -> str | None:
    if handle < NOTHING:
        return f"roadside:{-handle - 2}"
    return names.get(handle)  # None: clutter, or a vehicle that left long ago and whose track took clutter
