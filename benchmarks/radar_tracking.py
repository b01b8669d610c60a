"""Time of the tracker's step per vehicle, with 20 objects in view and clutter, filter by filter.

    python benchmarks/radar_tracking.py [--vehicles 100] [--steps 40]

Objects keep their place relative to the vehicle on average (a queue of traffic), so that all stay in view.
The target of the whole radar chain is 0.15 ms a vehicle and step on one core.
"""

import argparse
import time

import numpy as np

from plugin.tracking.detections import Detections, EgoMotion
from plugin.tracking.filters import FILTERS
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
            begin = time.perf_counter()
            state, listed = tracker.step(state, detections, ego, 0.1)
            if k >= 10:  # compiled, and all tracks confirmed
                spent.append(time.perf_counter() - begin)
                tracks += len(listed.owner)
        micro = 1e6 * np.array(spent) / n
        each = tracks / len(spent) / n
        print(
            f"{name:9} {np.median(micro):6.1f} us a vehicle-step (best {micro.min():.1f}), "
            f"{each:.1f} tracks a vehicle, {micro.min() / each:.2f} us a track"
        )


if __name__ == "__main__":
    main()
