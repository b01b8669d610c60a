"""The camera in the loop: rendered frames, lane tracker and observer on a lane change at 90 km/h.

The truth is the single-track model under a defined steer, integrated by an independent Runge-Kutta.
"""

import numpy as np
import pytest
from manoeuvre import column, drive, lane_change_steer

from camera_synth.camera import PROCESSED_FROM, Camera, projection
from camera_synth.condition import looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from plugin.lane import genetic, refine
from plugin.lane.genetic import fitted_to, search_numbers
from plugin.motion import observer
from plugin.motion.observer import ObserverSettings
from sumo_net.randomness import stream_key
from sumo_net.vehicle import Vehicle
from tests.roads import no_objects, road_ahead

HALF, CAMERA, SPEED, LANE_M = Vehicle(), Camera(), 25.0, 3.75
KEYS = 6  # vehicles on the same drive, each with a camera's noise and a stretch of road of its own
START_S, OVER_S = 3.0, 5.0


@pytest.fixture(scope="module")
def truth():
    steer = lane_change_steer(HALF, SPEED, LANE_M, START_S, OVER_S)
    return drive(HALF, steer, lambda t: SPEED, duration_s=START_S + OVER_S + 2.0)


def observed(truth, condition):
    """Lane estimates and motion estimates, step by step, of KEYS vehicles that drive on a straight road."""
    p, n = projection(CAMERA), KEYS
    keys = np.array([stream_key(1, f"car {i}", "camera") for i in range(n)], np.uint64)
    frames, appearance = new_frames(n), looks(preset(condition), n)
    lane_state, search = refine.init(n), genetic.init(keys)
    schedule = observer.schedule(HALF, CAMERA.preview_m, ObserverSettings())
    state, lanes, motions = observer.init(n, schedule), [], []
    start_m = 1000.0 + 137.0 * np.arange(n)
    for k, offset in enumerate(truth.offset_m):
        lane = round(offset / LANE_M)  # the vehicle's own lane becomes the one on the left
        heading = np.full(n, truth.heading_rad[k])
        station = start_m + truth.station_m[k]
        d = np.full(n, offset - lane * LANE_M)
        ahead = road_ahead(0.0, 0.0, d, heading, station, lanes_right=1 + lane, lanes_left=2 - lane)
        pose = Pose(station, np.full(n, offset), heading)
        render(
            frames,
            p,
            ahead,
            no_objects(n),
            pose,
            appearance,
            keys,
            np.full(n, k, np.int64),
            PROCESSED_FROM,
        )
        start, wanted = None, refine.needs_search(lane_state)
        if wanted.any():
            search, start = genetic.search(
                frames, search, search_numbers(fitted_to(genetic.GeneticSearch(), CAMERA))
            )
        speed = np.full(n, SPEED)
        lane_state, look = refine.step(frames, start, wanted, lane_state, p, speed, refine.Refine())
        state, motion = observer.step(state, schedule, look, speed)
        lanes.append(look)
        motions.append(motion)
    return lanes, motions


def of_the_peak(estimate, truth, during):
    error = estimate[during] - truth[during, None]
    return np.sqrt(np.mean(error**2)) / np.abs(truth).max()


@pytest.mark.parametrize("condition", ["clear", "complex"])
def test_lane_change_at_90_kmh_within_a_tenth_of_the_peak(truth, condition):
    assert truth.offset_m[-1] == pytest.approx(LANE_M, abs=0.02)
    lanes, motions = observed(truth, condition)
    during = slice(round(10 * START_S) - 5, round(10 * (START_S + OVER_S)) + 5)
    yaw = of_the_peak(column(motions, "yaw_rate_rps"), truth.yaw_rate_rps, during)
    slip = of_the_peak(column(motions, "lateral_speed_mps"), truth.lateral_speed_mps, during)
    assert column(lanes, "locked")[during].all()
    assert yaw < 0.10
    assert slip < 0.10
    assert column(motions, "lane_shift").sum(axis=0) == pytest.approx(1)  # one lane to the left
    assert column(motions, "lateral_offset_m")[-1] == pytest.approx(0.0, abs=0.05)
