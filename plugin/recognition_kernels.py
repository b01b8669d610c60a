"""Whether the borders that a detector found lie on the true ones, row by row of the image."""

import math

from plugin.lane.estimate import ROW_STEP, ROWS
from sumo_net.compile import kernel

_LEAST_ROWS = 3  # with the marking in view; fewer give no verdict


@kernel
def judge(column, painted, found, tolerance_px, share, verdict):  # type: ignore[no-untyped-def]
    """verdict (n,) int8: 1 recognised, 0 not, -1 too few rows to judge.

    column, painted (n, 2, rows): true borders at y = 0, 1, 2, … (camera_synth.truth). found (n, 2, ROWS): the
    columns found at the judged rows, NaN for none. Recognised: both borders within tolerance_px / cosθ, θ the
    border's angle from the vertical, on at least `share` of the judged rows where the marking shows.
    """
    for i in range(verdict.shape[0]):
        judged, good = 0, True
        for side in range(2):
            shown, hit = 0, 0
            for k in range(ROWS):
                y = 1 + ROW_STEP * k
                x = column[i, side, y]
                slope = 0.5 * (column[i, side, y + 1] - column[i, side, y - 1])
                if not (painted[i, side, y] and math.isfinite(x + slope)):
                    continue
                shown += 1
                if abs(found[i, side, k] - x) <= tolerance_px * math.sqrt(1.0 + slope * slope):
                    hit += 1
            if shown >= _LEAST_ROWS:
                judged += 1
                good = good and hit >= share * shown
        verdict[i] = -1 if judged == 0 else (1 if good else 0)
