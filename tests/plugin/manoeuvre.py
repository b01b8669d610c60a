"""True drives for the tests of motion and warning, and lane estimates of them."""

import numpy as np

from analysis.published.manoeuvre import PREVIEW_M, Drive, Steer, drive, looks
from plugin.lane.estimate import LaneEstimate
from plugin.motion import observer
from plugin.motion.estimate import MotionEstimate, OwnReadings
from plugin.motion.observer import Schedule, State
from sumo_net.vehicle import Vehicle

__all__ = ["PREVIEW_M", "Drive", "column", "drive", "lane_change_steer", "looks", "observed", "unseen"]


def lane_change_steer(
    vehicle: Vehicle, speed_mps: float, width_m: float = 3.75, start_s: float = 2.0, over_s: float = 5.0
) -> Steer:
    """Open-loop steer angle of a sinusoidal lateral acceleration that moves the car one lane to the left."""
    peak = 2 * np.pi * width_m / over_s**2
    per_g = (vehicle.wheelbase_m + vehicle.understeer * speed_mps**2) / speed_mps**2

    def steer(t: float, x: np.ndarray, v: float) -> float:
        inside = start_s <= t <= start_s + over_s
        return float(per_g * peak * np.sin(2 * np.pi * (t - start_s) / over_s)) if inside else 0.0

    return steer


def observed(
    schedule: Schedule, truth: Drive, seen: list[LaneEstimate], own: list[OwnReadings] | None = None
) -> tuple[State, list[MotionEstimate]]:
    """The observer's last state and its estimates, step by step, of the looks `seen` on one drive."""
    n = len(seen[0].score)
    state, rows = observer.init(n, schedule), []
    for k, look in enumerate(seen):
        speed = np.full(n, truth.speed_mps[k])
        state, motion = observer.step(state, schedule, look, speed, None if own is None else own[k])
        rows.append(motion)
    return state, rows


def column(rows: list[MotionEstimate], name: str) -> np.ndarray:
    """One field of estimates, (steps, n)."""
    return np.array([getattr(row, name) for row in rows])


def unseen(look: LaneEstimate) -> LaneEstimate:
    """The same lane estimate, not locked."""
    values = {
        name: np.full_like(part, np.nan) for name, part in look._asdict().items() if part.dtype == np.float64
    }
    return look._replace(**values, locked=np.zeros_like(look.locked))
