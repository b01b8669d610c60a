"""Cars ahead of one vehicle, for the tests of the path and the rear-end warning."""

import math
from typing import Any

import numpy as np

from plugin.motion.estimate import MotionEstimate
from plugin.warning import collision
from plugin.warning.collision import (
    Collision,
    CollisionWarning,
    Targets,
)

V = 30.0


def motion(n: int = 1, **fields: Any) -> MotionEstimate:
    values = dict.fromkeys(MotionEstimate._fields[:-1], 0.0) | {"lane_width_m": 3.75} | fields
    parts = [np.broadcast_to(np.asarray(value, float), n).copy() for value in values.values()]
    return MotionEstimate._make([*parts, np.zeros(n, np.int8)])


LOST = dict.fromkeys(("lateral_offset_m", "heading_error_rad", "curvature_1pm", "lane_width_m"), math.nan)


def targets(*rows: dict[str, float]) -> Targets:
    """Cars at the same speed by default; gap instead of x."""
    blank = {
        "owner": 0,
        "y_m": 0.0,
        "vx_mps": V,
        "vy_mps": 0.0,
        "ax_mps2": 0.0,
        "detected": 1,
        "usable": 1,
        "standing": 0,
        "sighted": 0,
    }
    full = [blank | {"track_id": k} | row for k, row in enumerate(rows)]
    for row in full:
        row["x_m"] = row.pop("gap") + 1.6 if "gap" in row else row["x_m"]
    kinds = {"owner": np.int64, "track_id": np.int64}
    kinds |= dict.fromkeys(("detected", "usable", "standing", "sighted"), bool)
    return Targets(
        *(np.array([row[name] for row in full], kinds.get(name, float)) for name in Targets._fields)
    )


class Driver:
    """One vehicle, step by step."""

    def __init__(self, **options: Any) -> None:
        self.options, self.state = Collision(**options), collision.init(1)

    def step(
        self, *rows: dict[str, float], v: float = V, a: float = 0.0, yaw_rate: float = 0.0, **lane: float
    ) -> tuple[CollisionWarning, collision.InPath]:
        given_ = (targets(*rows), motion(**lane), np.array([v]), np.array([a]), np.array([yaw_rate]))
        self.state, warning, path = collision.step(self.state, *given_, self.options)
        return warning, path

    def warn(self, *rows: dict[str, float], steps: int = 3, **more: float) -> CollisionWarning:
        for _ in range(steps):
            warning, _ = self.step(*rows, **more)
        return warning
