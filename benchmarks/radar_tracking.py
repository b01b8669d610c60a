"""Time of the tracker's step per vehicle, with 20 objects in view and clutter, for each filter.

    python benchmarks/radar_tracking.py [--vehicles 100] [--steps 40]

Objects keep their mean position relative to the vehicle (a queue of traffic), so that all stay in view. The
target for the whole radar chain is 0.15 ms per vehicle and step on one core. "closing" is the additional cost
of two leaders in path of each vehicle, "rear view" that of measuring one of them in a frame.
"""

import argparse
import time

import numpy as np

from camera_synth.camera import Camera, image_from_vehicle, projection
from plugin.tracking.closing import Closing, ClosingFilter
from plugin.tracking.detections import Detections, EgoMotion, sensor_motion
from plugin.tracking.filters import FILTERS
from plugin.tracking.models import RadarNoise
from plugin.tracking.rear_view import Watched, look, nothing_seen
from plugin.tracking.tracker import Tracker, TrackerSettings

OBJECTS, CLUTTER, SPEED = 20, 1.0, 25.0


def scans(n: int, steps: int, rng: np.random.Generator) -> list[Detections]:
    """Noisy detections (95 % of them) of objects spread over range and azimuth."""
    r = rng.uniform(15.0, 180.0, (n, OBJECTS))
    azimuth = rng.uniform(-0.17, 0.17, (n, OBJECTS))
    rate = rng.uniform(-3.0, 3.0, (n, OBJECTS))
    out = []
    for k in range(steps):
        owner, body = np.nonzero(rng.random((n, OBJECTS)) < 0.95)
        swing = 0.1 * k - 0.05 * steps
        z = np.stack([r + rate * swing, rate, azimuth], axis=-1)[owner, body]
        z += rng.standard_normal(z.shape) * [1.0, 0.5, np.radians(0.2)]
        false = np.repeat(np.arange(n), rng.poisson(CLUTTER, n))
        low, high = [5.0, -40.0, -0.17], [200.0, 10.0, 0.17]
        z = np.concatenate([z, rng.uniform(low, high, (len(false), 3))])
        columns = np.ascontiguousarray(z.T)
        owners = np.concatenate([owner, false])
        out.append(Detections(owners, columns[0], columns[1], columns[2], np.full(len(owners), -1)))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--steps", type=int, default=40)
    options = parser.parse_args()
    n = options.vehicles
    ego = EgoMotion(np.full(n, SPEED), np.zeros(n), np.full(n, 0.01), np.zeros(n))
    drive = scans(n, options.steps, np.random.default_rng(1))
    for name in FILTERS:
        tracker = Tracker(TrackerSettings(filter=name))
        state, spent, tracks = tracker.init(n), [], 0
        for k, detections in enumerate(drive):
            begin = time.process_time()
            state, listed = tracker.step(state, detections, ego, 0.1)
            if k >= 10:  # by now compiled, and all tracks confirmed
                spent.append(time.process_time() - begin)
                tracks += len(listed.owner)
        micro = 1e6 * np.array(spent) / n
        each = tracks / len(spent) / n
        print(
            f"{name:9} {np.median(micro):6.1f} us per vehicle-step (best {micro.min():.1f}), "
            f"{each:.1f} tracks per vehicle, {micro.min() / each:.2f} us per track"
        )
    closing(n, drive, ego)
    rear_view(n)


def closing(n: int, drive: list[Detections], ego: EgoMotion) -> None:
    """Time of following two leaders per vehicle."""
    tracker, spent = Tracker(TrackerSettings()), []
    follower = ClosingFilter(Closing(), RadarNoise(), 0.0, projection(Camera()))
    state, leaders = tracker.init(n), follower.init()
    in_path = np.tile([0, 1], (n, 1))
    for k, detections in enumerate(drive):
        state, listed = tracker.step(state, detections, ego, 0.1)
        begin = time.process_time()
        sensor = sensor_motion(ego, 0.0)
        leaders, _ = follower.step(leaders, listed, detections, sensor, nothing_seen(n), in_path, 0.1)
        if k >= 10:
            spent.append(time.process_time() - begin)
    micro = 1e6 * np.array(spent) / n
    print(
        f"closing   {np.median(micro):6.1f} us per vehicle-step (best {micro.min():.1f}), "
        f"{len(leaders.owner) / n:.1f} leaders per vehicle"
    )


def rear_view(n: int) -> None:
    """Time of measuring a dark strip, 1.8 m wide, on a grey road."""
    p, x, spent = projection(Camera()), np.linspace(9.0, 40.0, n), []
    frames = np.random.default_rng(2).integers(95, 105, (n, 240, 320)).astype(np.uint8)
    for frame, one in zip(frames, x.tolist(), strict=True):
        (left, foot, _), (right, top, _) = (
            image_from_vehicle(one, aside, height, p) for aside, height in ((0.9, 0.0), (-0.9, 0.21))
        )
        frame[239 - round(top) : 240 - round(foot), max(round(left), 0) : round(right) + 1] = 20
    watched = Watched(np.arange(n), x, np.zeros(n), np.full(n, np.nan), np.full(n, np.nan))
    for _ in range(20):
        begin = time.process_time()
        seen = look(frames, watched, p)
        spent.append(time.process_time() - begin)
    micro = 1e6 * np.array(spent[2:]) / n
    print(
        f"rear view {np.median(micro):6.1f} us per vehicle-step (best {micro.min():.1f}), "
        f"{np.mean(seen.track_id >= 0):.0%} seen"
    )


if __name__ == "__main__":
    main()
