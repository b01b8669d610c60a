"""Compiling on both cores: a second process compiles half of the kernels while the first compiles its own.

All kernels take more than a minute of one core to compile, once. `compiling` starts a helper where that is
still to be done; both processes keep what they have compiled in the same cache, and neither waits for the
other but at `meet`. What the parts call their kernels with has the types of a run, and no meaning.

    python -m analysis.warm_up lane     # what the helper does
"""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numba.core import event

from sumo_net.compile import is_kept, kept

Meet = Callable[[], None]
Tell = Callable[[int], None]
_TELL_EVERY_S = 0.2


@contextlib.contextmanager
def compiling(tell: Tell = lambda _: None) -> Iterator[Meet]:
    """Have the kernels compiled by two processes, if they are not yet.

    Call what it gives before the first step: that does this process's share, and returns when the helper has
    done the first of its own. `tell` is called with the number of kernels done, first with 0.
    """
    if compiled():
        yield lambda: None
        return
    tell(0)
    with event.install_listener("numba:compile", _Teller(tell)), _with_helper() as meet:
        yield meet


class _Teller(event.Listener):
    """Tells how far both processes are, after a kernel that this one has compiled."""

    def __init__(self, tell: Tell) -> None:
        self._tell, self._told = tell, time.monotonic()

    def on_start(self, event: Any) -> None:
        """Nothing is done yet."""

    def on_end(self, event: Any) -> None:
        """A kernel, or one within another, is compiled."""
        if time.monotonic() - self._told > _TELL_EVERY_S:
            self._told = time.monotonic()
            self._tell(kept())


@contextlib.contextmanager
def _with_helper() -> Iterator[Meet]:
    if (os.cpu_count() or 1) < 2:
        yield lambda: None
        return
    # -P: whatever is called `analysis` where the user stands is not this one
    command = [sys.executable, "-P", "-m", "analysis.warm_up", "lane", "radar"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as helper:

        def meet() -> None:
            picture()
            motion()  # about as long as the helper's lane tracker, together
            assert helper.stdout is not None
            helper.stdout.readline()  # empty at once should the helper have failed: then it is done here

        try:
            yield meet
        finally:
            helper.terminate()


def compiled() -> bool:
    """Whether the largest kernel is in the cache, or there is no cache that a helper could put it into."""
    from plugin.lane.refine_kernels import step_kernel

    kernel: Any = step_kernel  # a Dispatcher
    return kernel.stats.cache_path is None or is_kept(kernel)


def lane() -> None:
    """Compile the lane tracker."""
    from camera_synth.camera import Camera, projection
    from camera_synth.render import new_frames
    from plugin.lane import refine
    from plugin.vision import JUDGED_Y

    p = projection(Camera())
    state, _ = refine.step(new_frames(1), None, None, refine.init(1), p, np.zeros(1), refine.Refine())
    refine.parabolas(state, refine.border_columns(state, JUDGED_Y, p), JUDGED_Y)


def picture() -> None:
    """Compile the renderer and the published search."""
    from camera_synth.camera import PROCESSED_FROM, Camera, projection
    from camera_synth.condition import Condition, looks
    from camera_synth.pose import Pose
    from camera_synth.render import new_frames, render
    from camera_synth.truth import new_border_columns
    from plugin.lane import genetic
    from sumo_net.road import AHEAD_M, MAX_BORDERS, OWN_RIGHT, RoadAhead
    from sumo_net.surroundings import MAX_OBJECTS, Objects

    frames, keys, start = new_frames(1), np.zeros(1, np.uint64), np.zeros(1, np.int64)
    nowhere = np.full((1, len(AHEAD_M)), np.nan)
    borders = np.full((1, len(AHEAD_M), MAX_BORDERS), np.nan)
    road = RoadAhead(*(nowhere,) * 5, borders, np.zeros(borders.shape, np.int8), nowhere, nowhere)
    none = Objects(np.full((1, MAX_OBJECTS), -1), *(np.full((1, MAX_OBJECTS), np.nan),) * 7)
    pose, truth = Pose(*(np.zeros(1),) * 3), (start + OWN_RIGHT, new_border_columns(1))
    p = projection(Camera())
    render(frames, p, road, none, pose, looks(Condition(), 1), keys, start, PROCESSED_FROM, truth)
    genetic.search(frames, genetic.init(keys), genetic.search_numbers(genetic.GeneticSearch()))


def motion() -> None:
    """Compile observer, prediction, lane-departure warning and what judges them, in the default settings."""
    from camera_synth.camera import Camera
    from plugin.ground_truth import Judge
    from plugin.lane.estimate import LaneEstimate
    from plugin.motion import observer, prediction
    from plugin.motion.estimate import OwnReadings
    from plugin.warning import departure
    from plugin.warning.tlc import time_to_lane_crossing
    from sumo_net.ego import EgoTruth
    from sumo_net.road import AHEAD_M
    from sumo_net.vehicle import Vehicle

    vehicle, still, no = Vehicle(), np.zeros(1), np.zeros(1, np.bool_)
    schedule = observer.schedule(vehicle, Camera().preview_m, observer.ObserverSettings())
    lane = LaneEstimate(no, *(still,) * 8, no, no, np.zeros(1, np.int8))
    _, known = observer.step(observer.init(1, schedule), schedule, lane, still, OwnReadings(still, still))
    predictor = prediction.predictor(vehicle, prediction.PredictionSettings())
    path = prediction.predict(known, still, predictor)
    crossing = time_to_lane_crossing(known, path, vehicle, still)
    numbers = departure.numbers(departure.DepartureSettings())
    departure.step(departure.init(1), crossing, known, still, np.zeros(1, np.int8), numbers)
    kinds = {"handle": np.int64, "path": np.int32, "lanes_left": np.int32, "on_marked_road": np.bool_}
    kinds |= dict.fromkeys(("border_kind_right", "border_kind_left", "signal", "cause"), np.int8)
    truth = EgoTruth._make(np.zeros(1, kinds.get(name, np.float64)) for name in EgoTruth._fields)
    judge = Judge(vehicle, Camera().preview_m, predictor)
    judge.reference(truth, np.zeros((1, len(AHEAD_M))), known, still, path, still)


def radar() -> None:
    """Compile radar and tracker, as in the default settings."""
    from plugin.tracking.detections import Detections, at_rest
    from plugin.tracking.tracker import Tracker, TrackerSettings
    from radar_synth.radar import OwnMotion, Radar
    from radar_synth.scan import scan
    from radar_synth.visibility import objects_in_view
    from sumo_net.snapshot import Snapshot
    from sumo_net.surroundings import Objects

    at = Snapshot(np.zeros(1, np.int64), *(np.zeros(1),) * 9)
    at = at._replace(lane=np.zeros(1, np.int32))
    objects_in_view(Radar(), at, at)
    one = np.zeros((1, 1))
    body = Objects(np.zeros((1, 1), np.int64), *(one + value for value in (30.0, 0, 0, 9, 4, 2, 1.5)))
    still, keys = np.zeros(1), np.zeros(1, np.uint64)
    scan(Radar(), body, OwnMotion(still, still, still), keys, np.zeros(1, np.int64))
    tracker, first = Tracker(TrackerSettings()), np.zeros(1, np.int64)
    seen = Detections(first, still + 30.0, still, still, first - 1)
    state = tracker.init(1)
    for _ in range(3):
        state, _ = tracker.step(state, seen, at_rest(1), 0.1)


PARTS = {"lane": lane, "picture": picture, "motion": motion, "radar": radar}


def main(names: list[str]) -> None:
    """Compile these parts, one line of output for each that is done."""
    for name in names:
        PARTS[name]()
        print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
