"""True drives for the tests of motion and warning, and lane estimates of them."""

import numpy as np

from analysis.published.manoeuvre import PREVIEW_M, Drive, drive, lane_change_steer, looks
from plugin.lane.estimate import LaneEstimate

__all__ = ["PREVIEW_M", "Drive", "drive", "lane_change_steer", "looks", "unseen"]


def unseen(look: LaneEstimate) -> LaneEstimate:
    """The same lane estimate, not locked."""
    values = {
        name: np.full_like(part, np.nan) for name, part in look._asdict().items() if part.dtype == np.float64
    }
    return look._replace(**values, locked=np.zeros_like(look.locked))
