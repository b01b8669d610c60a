"""A small world for tracker tests: objects on straight lines, sensor vehicles on arcs, a noisy radar."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from plugin.tracking.detections import Detections, EgoMotion

SIGMA = np.array([1.0, 0.5, np.radians(0.2)])


class Scan(NamedTuple):
    """One step: what the tracker gets and what is true."""

    dt: float
    detections: Detections
    ego: EgoMotion
    source: np.ndarray  # (D,) object of each detection, -1 for clutter
    polar: np.ndarray  # (n, M, 3) true range, range rate, azimuth
    velocity: np.ndarray  # (n, M, 2) true velocity over ground in the vehicle's axes


class Scene(NamedTuple):
    """n vehicles with M objects each; positions relative to the start, vehicle axes at the start."""

    position: np.ndarray  # (n, M, 2)
    velocity: np.ndarray  # (n, M, 2)
    acceleration: float = 0.0  # of all objects that move, along x
    speed: float = 25.0  # of the sensor vehicles
    ego_acceleration: float = 0.0
    yaw_rate: float = 0.0
    noise: float = 1.0
    detection: float = 1.0
    clutter: float = 0.0
    view_rad: float = np.radians(60.0)

    def scans(self, rng: np.random.Generator, dts: list[float]) -> Iterator[Scan]:
        """One scan after each of the time steps; truth is integrated finely between them."""
        p, v = self.position.copy(), self.velocity.copy()
        n, m = p.shape[:2]
        ego, heading, speed = np.zeros(2), 0.0, self.speed
        moving = np.abs(v).sum(axis=2) > 0
        for dt in dts:
            for _ in range(20):
                h = dt / 20
                a = np.where(moving, self.acceleration, 0.0)
                p = p + v * h
                p[..., 0] += 0.5 * a * h * h
                v = v.copy()
                v[..., 0] += a * h
                middle = heading + 0.5 * self.yaw_rate * h
                step = speed + 0.5 * self.ego_acceleration * h
                ego = ego + step * h * np.array([np.cos(middle), np.sin(middle)])
                heading += self.yaw_rate * h
                speed += self.ego_acceleration * h
            c, s = np.cos(heading), np.sin(heading)
            turn = np.array([[c, s], [-s, c]])
            q, w = (p - ego) @ turn.T, v @ turn.T
            r, azimuth = np.hypot(q[..., 0], q[..., 1]), np.arctan2(q[..., 1], q[..., 0])
            rate = ((w[..., 0] - speed) * q[..., 0] + w[..., 1] * q[..., 1]) / r
            polar = np.stack([r, rate, azimuth], axis=-1)
            seen = (np.abs(azimuth) < self.view_rad) & (r > 1.0) & (rng.random((n, m)) < self.detection)
            owner, body = np.nonzero(seen)
            z = polar[owner, body] + self.noise * SIGMA * rng.standard_normal((len(owner), 3))
            false = rng.poisson(self.clutter, n)
            fake = np.stack(
                [
                    rng.uniform(2, 200, false.sum()),
                    rng.uniform(-60, 10, false.sum()),
                    rng.uniform(-0.7, 0.7, false.sum()),
                ],
                axis=1,
            )
            owner = np.concatenate([owner, np.repeat(np.arange(n), false)])
            source = np.concatenate([body, np.full(len(fake), -1)])
            columns = np.ascontiguousarray(np.concatenate([z, fake]).T)
            ego_motion = EgoMotion(
                *(np.full(n, value) for value in (speed, self.ego_acceleration, self.yaw_rate, 0.0))
            )
            detections = Detections(owner, *columns, np.full(len(owner), -1))
            yield Scan(dt, detections, ego_motion, source, polar, w)
