"""The camera chain of a fleet: what each vehicle's camera sees, and where it finds the lane.

Frames live only as long as the chunk of vehicles that is worked on.
"""

import threading
from typing import Any, NamedTuple

import numpy as np

from camera_synth.camera import PROCESSED_FROM, projection, vehicle_from_image
from camera_synth.condition import Looks, looks
from camera_synth.pose import Pose
from camera_synth.render import NO_TRUTH, new_frames, render
from camera_synth.truth import BorderColumns, border_columns, new_border_columns
from plugin.configuration import Configuration
from plugin.lane.detector import Glance, LaneDetector, LaneTracker, PublishedSearch
from plugin.lane.estimate import BORDER_Y, Borders, LaneEstimate
from plugin.lane.genetic import SearchState
from plugin.lane.hidden import Bodies, hidden_by, nothing_hidden
from plugin.recognition_kernels import judge
from plugin.tracking.rear_view import RearView, Watched, look, nobody_watched
from plugin.truth import STRADDLING_M
from sumo_net.arrays import Array
from sumo_net.batch import join, select
from sumo_net.randomness import stream_key
from sumo_net.road import OWN_RIGHT, RoadAhead
from sumo_net.surroundings import Objects

CHUNK = 64  # vehicles whose frames are in memory at once, which share the cost of each call
TOLERANCE_PX, SHARE = 5.0, 0.85
_LEAST_REACH_M = 10.0


class Scene(NamedTuple):
    """True surroundings of n vehicles: input of renderer and scoring."""

    ahead: RoadAhead
    objects: Objects
    pose: Pose
    lanes_left: Array  # (n,) lanes from the path's lane to the one the vehicle is in, left positive
    lane_offset_m: Array  # (n,) offset from the centre of that lane
    lane_width_m: Array


class VisionState(NamedTuple):
    """State of n vehicles' cameras and lane detectors between frames."""

    camera_key: Array  # (n,) uint64
    frame: Array  # (n,) int64
    looks: Looks
    hidden: Array  # (n, BODIES, COLUMNS) what vehicles ahead hide, by the radar tracks of the last step
    watched: Watched  # the vehicle in path, by the same tracks
    reach_m: Array  # (n,) how far ahead paint was seen lately
    detector: Any  # its state
    beside: SearchState  # the published search on every frame, for comparison


class Sight(NamedTuple):
    """Results of one frame of each of n vehicles."""

    lane: LaneEstimate
    borders: Borders
    columns: Array  # (n, 2, len(BORDER_Y)) estimated centres of the left and the right marking at BORDER_Y
    recognised: Array  # (n,) int8: 1, 0, or -1 where no marking showed
    beside_recognised: Array  # (n,) int8, -1 where it does not run
    rear: RearView  # of the vehicle in path


class Vision:
    """The camera chain with its settings; `step` once per 0.1 s."""

    def __init__(
        self,
        configuration: Configuration,
        seed: int,
        beside: bool,
        detector: LaneDetector[Any] | None = None,
    ) -> None:
        """`detector`: in place of the one that `configuration.mode` names."""
        self._configuration = configuration
        self._seed = seed
        self._beside = beside
        self._projection = projection(configuration.camera)
        self._row_m = np.array([self._forward_m(y) for y in BORDER_Y])
        self._published = PublishedSearch(
            configuration.search, configuration.camera, configuration.plausibility
        )
        self._detector = detector or self._named(configuration)
        self._of_thread = threading.local()

    def _named(self, configuration: Configuration) -> LaneDetector[Any]:
        if configuration.mode == "paper":
            return self._published
        return LaneTracker(configuration.tracking_lanes, self._published, configuration.camera)

    def _forward_m(self, y: float) -> float:
        forward, _ = vehicle_from_image(self._projection.center_x, float(y), self._projection)
        return float(forward) if np.isfinite(forward) else np.inf

    def init(self, vehicle_ids: list[str]) -> VisionState:
        """State of vehicles before their first frame."""

        def keys(stream: str) -> Array:
            return np.array([stream_key(self._seed, name, stream) for name in vehicle_ids], dtype=np.uint64)

        n = len(vehicle_ids)
        return VisionState(
            keys("camera"),
            np.zeros(n, np.int64),
            looks(self._configuration.condition, n),
            nothing_hidden(n),
            nobody_watched(n),
            np.zeros(n),
            self._detector.init(keys("search")),
            self._published.init(keys("search beside")),
        )

    def step(
        self, state: VisionState, scene: Scene, speed_mps: Array, yaw_rate_rps: Array
    ) -> tuple[VisionState, Sight]:
        """Render and detect, for n > 0 vehicles; yaw_rate_rps is their gyroscopes', NaN without."""
        n = len(speed_mps)
        if n <= CHUNK:
            return self._chunk(state, scene, speed_mps, yaw_rate_rps)
        size = -(-n // -(-n // CHUNK))  # chunks of about equal size
        done = [
            self._chunk(select(state, part), select(scene, part), speed_mps[part], yaw_rate_rps[part])
            for part in (slice(k, k + size) for k in range(0, n, size))
        ]
        return join(*(after for after, _ in done)), join(*(sight for _, sight in done))

    def with_bodies(self, state: VisionState, bodies: Bodies, watched: Watched) -> VisionState:
        """The state for the next frame, in which the bodies (B,), at their places then, hide the road.

        watched : the rears to measure, (n,).
        """
        mount_m = self._configuration.radar.mount_forward_m
        hidden = hidden_by(bodies, len(state.frame), self._projection, mount_m)
        return state._replace(hidden=hidden, watched=watched)

    def seen_to(self, state: VisionState) -> Array:
        """(n, len(BORDER_Y)) bool: rows of BORDER_Y up to where paint was recently seen, if that is known."""
        return np.asarray(self._row_m[None, :] <= np.maximum(state.reach_m, _LEAST_REACH_M)[:, None])

    def _chunk(
        self, state: VisionState, scene: Scene, speed_mps: Array, yaw_rate_rps: Array
    ) -> tuple[VisionState, Sight]:
        frames = self._frames()[: len(speed_mps)]
        truth = new_border_columns(len(speed_mps))
        self.draw(frames, state, scene, PROCESSED_FROM, (_own_slot(scene), truth))
        return self._look(frames, state, scene, speed_mps, yaw_rate_rps, truth)

    def _frames(self) -> Array:
        """Buffer (CHUNK, 240, 320) of this thread."""
        if not hasattr(self._of_thread, "frames"):
            self._of_thread.frames = new_frames(CHUNK)
        frames: Array = self._of_thread.frames
        return frames

    def draw(
        self,
        frames: Array,
        state: VisionState,
        scene: Scene,
        first_row: int = 0,
        truth: tuple[Array, BorderColumns] = NO_TRUTH,
    ) -> None:
        """The frames (n, 240, 320) that the cameras see now; `truth` as `render` fills it."""
        render(
            frames,
            self._projection,
            scene.ahead,
            scene.objects,
            scene.pose,
            state.looks,
            state.camera_key,
            state.frame,
            first_row,
            truth,
        )

    def _look(
        self,
        frames: Array,
        state: VisionState,
        scene: Scene,
        speed_mps: Array,
        yaw_rate_rps: Array,
        truth: BorderColumns,
    ) -> tuple[VisionState, Sight]:
        glance = Glance(frames, speed_mps, yaw_rate_rps, state.hidden)
        detector, found = self._detector.step(glance, state.detector)
        beside, beside_verdict = state.beside, np.full(len(speed_mps), -1, np.int8)
        if self._beside:
            beside, borders = self._published.search(frames, beside)
            columns = self._published.columns(borders)
            beside_verdict = self._judge(scene, state.looks, columns, truth)
        after = state._replace(frame=state.frame + 1, reach_m=found.reach_m, detector=detector, beside=beside)
        verdict = self._judge(scene, state.looks, found.columns, truth)
        rear = look(frames, state.watched, self._projection)
        return after, Sight(found.lane, found.borders, found.columns, verdict, beside_verdict, rear)

    def _judge(self, scene: Scene, looks: Looks, columns: Array, truth: BorderColumns) -> Array:
        verdict = _against(truth, columns)
        straddling = np.abs(scene.lane_offset_m) > 0.5 * scene.lane_width_m - STRADDLING_M
        again = np.flatnonzero(straddling & (verdict == 0))
        if len(again):
            other = _own_slot(scene)[again] + np.sign(scene.lane_offset_m[again]).astype(np.int64)
            beside = select(scene, again)
            meant = border_columns(
                self._projection, beside.ahead, beside.objects, other, select(looks, again), beside.pose
            )
            verdict[again] = np.maximum(_against(meant, columns[again]), 0)
        # outside all lanes there is no own lane to find
        verdict[np.abs(scene.lane_offset_m) > 0.5 * scene.lane_width_m + STRADDLING_M] = -1
        return verdict


def _own_slot(scene: Scene) -> Array:
    return OWN_RIGHT + scene.lanes_left.astype(np.int64)


def _against(truth: BorderColumns, columns: Array) -> Array:
    verdict = np.empty(len(columns), np.int8)
    judge(truth.column, truth.painted, columns, TOLERANCE_PX, SHARE, verdict)
    return verdict
