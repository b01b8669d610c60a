"""What finds the lane in a fleet's frames: the published search, the default tracker, or a user's own."""

from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from camera_synth.camera import Camera, projection
from plugin.lane import genetic, refine
from plugin.lane.estimate import BORDER_Y, Borders, LaneEstimate
from plugin.lane.follow import LOCKED
from plugin.lane.genetic import GeneticSearch, SearchState, fitted_to, search_numbers
from plugin.lane.geometry import Plausibility, lane_estimate_from_borders, marking_centres
from plugin.lane.refine import LaneState, Refine
from plugin.lane.road_model import HEADING, KNOT, KNOTS, OFFSET, WIDTH
from sumo_net.arrays import Array
from sumo_net.batch import select

S = TypeVar("S")


class Glance(NamedTuple):
    """One frame of each of n vehicles, and what the vehicles know besides."""

    frames: Array  # (n, 240, 320) uint8, of which the lowest 150 rows are drawn; only valid during the call
    speed_mps: Array  # (n,)
    yaw_rate_rps: Array  # (n,) the vehicle's own, NaN without
    hidden: Array  # (n, BODIES, COLUMNS) what vehicles ahead hide, see `plugin.lane.hidden`


class Found(NamedTuple):
    """What a detector finds in one frame of each of n vehicles."""

    lane: LaneEstimate
    columns: Array  # (n, 2, len(BORDER_Y)) centres of the left, right marking; NaN: not in view, or no lane
    borders: Borders  # the same as parabolas
    reach_m: Array  # (n,) how far ahead paint was seen lately; inf if unknown


class LaneDetector(Protocol[S]):
    """Finds the lane in the frames of a fleet.

    The detector itself only has settings. What it remembers of n vehicles is its state, a NamedTuple of
    arrays (n, …), since vehicles come and go. Several threads call `step` at once, each for some of them.
    """

    def init(self, keys: Array) -> S:
        """State of n vehicles before their first frame. keys (n,) uint64: for random draws."""
        ...

    def step(self, glance: Glance, state: S) -> tuple[S, Found]:
        """One frame of each of n > 0 vehicles."""
        ...


class PublishedSearch:
    """The genetic search of Zhang et al. 2011 on every frame: `paper` mode."""

    def __init__(self, search: GeneticSearch, camera: Camera, plausibility: Plausibility) -> None:
        self._camera, self._plausibility = camera, plausibility
        self._numbers = search_numbers(fitted_to(search, camera))

    def init(self, keys: Array) -> SearchState:
        """State of n vehicles before their first frame."""
        return genetic.init(keys)

    def search(self, frames: Array, state: SearchState) -> tuple[SearchState, Borders]:
        """Borders of n vehicles as the search finds them: at the markings' inner edges."""
        return genetic.search(frames, state, self._numbers)

    def columns(self, borders: Borders) -> Array:
        """(n, 2, len(BORDER_Y)) columns of the markings' centres."""
        return parabola_columns(marking_centres(borders, self._camera, self._plausibility))

    def step(self, glance: Glance, state: SearchState) -> tuple[SearchState, Found]:
        """Search the frames of n vehicles."""
        state, borders = self.search(glance.frames, state)
        lane = lane_estimate_from_borders(borders, state.shifted, self._camera, self._plausibility)
        reach_m = np.full(len(glance.frames), np.inf)
        return state, Found(lane, self.columns(borders), borders, reach_m)


class TrackedLane(NamedTuple):
    """State of n vehicles in `refined` mode."""

    lane: LaneState
    search: SearchState  # of those that have no lane


class LaneTracker:
    """The default tracker, which starts from the published search: `refined` mode."""

    def __init__(self, settings: Refine, start: PublishedSearch, camera: Camera) -> None:
        self._settings, self._start = settings, start
        self._projection = projection(camera)

    def init(self, keys: Array) -> TrackedLane:
        """State of n vehicles before their first frame."""
        return TrackedLane(refine.init(len(keys)), self._start.init(keys))

    def step(self, glance: Glance, state: TrackedLane) -> tuple[TrackedLane, Found]:
        """Track the lanes of n vehicles by one frame."""
        search, start, wanted = self._search(glance.frames, state)
        lane_state, lane = refine.step(
            glance.frames,
            start,
            wanted,
            state.lane,
            self._projection,
            glance.speed_mps,
            self._settings,
            glance.hidden,
            glance.yaw_rate_rps,
        )
        columns = refine.border_columns(lane_state, BORDER_Y, self._projection)
        borders = refine.parabolas(lane_state, columns, BORDER_Y)
        return TrackedLane(lane_state, search), Found(lane, columns, borders, lane_state.reach_m)

    def _search(self, frames: Array, state: TrackedLane) -> tuple[SearchState, Borders | None, Array | None]:
        """The published search for the vehicles that have no lane; the others' searches are reset."""
        search, wanted = state.search, refine.needs_search(state.lane)
        if not wanted.any():
            return search, None, None
        index = np.flatnonzero(wanted)
        fresh = genetic.init(search.key)._replace(frame=search.frame)
        after, found = self._start.search(frames[index], select(search, index))
        for part, new in zip(fresh, after, strict=True):
            part[index] = new
        n = len(wanted)
        start = Borders(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 2)))
        for part, new in zip(start, found, strict=True):
            part[index] = new
        return fresh, start, wanted


def found_lane(
    camera: Camera,
    locked: Array,
    lateral_offset_m: Array,
    heading_error_rad: Array,
    curvature_1pm: Array,
    lane_width_m: Array,
    lane_shift: Array | None = None,
) -> Found:
    """What an own detector has found, from the shape of the lane on the ground; all (n,).

    locked: bool, whether there is a lane at all; the rest is ignored where not. lateral_offset_m: the
    vehicle's centre of gravity, left of the lane's centre. heading_error_rad: the vehicle's heading minus the
    lane's. curvature_1pm: the lane's, taken as constant. lane_shift: +1 where the result has moved to the
    lane on the left since the last frame, -1 to the right.
    """
    locked = np.asarray(locked, np.bool_)

    def known(values: Array) -> Array:
        return np.where(locked, np.asarray(values, np.float64), np.nan)

    offset, heading, width = known(lateral_offset_m), known(heading_error_rad), known(lane_width_m)
    curvature, d = known(curvature_1pm), camera.preview_m
    unseen_m = np.where(locked, 0.0, np.inf)
    lane = LaneEstimate(
        locked=locked,
        score=locked.astype(np.float64),
        lateral_offset_m=offset,
        heading_error_rad=heading,
        curvature_1pm=curvature,
        curvature_rate_1pm2=0.0 * curvature,
        lane_width_m=width,
        preview_offset_m=-offset - heading * d + 0.5 * curvature * d * d,
        preview_heading_rad=curvature * d - heading,
        left_border_seen=locked,
        right_border_seen=locked,
        left_unseen_m=unseen_m,
        right_unseen_m=unseen_m,
        lane_shift=np.zeros(len(locked), np.int8) if lane_shift is None else np.asarray(lane_shift, np.int8),
    )
    columns, borders = _as_seen(lane, camera)
    return Found(lane, columns, borders, np.full(len(locked), np.inf))


def _as_seen(lane: LaneEstimate, camera: Camera) -> tuple[Array, Borders]:
    """Columns and parabolas of a lane of constant curvature, as the tracker's road model gives them."""
    seen = lane.locked
    road = refine.init(len(seen))
    road.status[seen] = LOCKED
    road.found[seen] = 1.0
    for k, values in ((OFFSET, lane.lateral_offset_m), (HEADING, lane.heading_error_rad)):
        road.x[seen, k] = values[seen]
    road.x[seen, WIDTH] = lane.lane_width_m[seen]
    road.x[seen, KNOT : KNOT + KNOTS] = lane.curvature_1pm[seen, None]
    columns = refine.border_columns(road, BORDER_Y, projection(camera))
    return columns, refine.parabolas(road, columns, BORDER_Y)


def parabola_columns(borders: Borders) -> Array:
    """(n, 2, len(BORDER_Y)) columns of the left and the right border at BORDER_Y."""
    both = np.stack([borders.left, borders.right], axis=1)[:, :, None, :]
    return np.ascontiguousarray((both[..., 0] * BORDER_Y + both[..., 1]) * BORDER_Y + both[..., 2])
