"""Evidence for a lane in one frame: the image's noise, rows with paint, plausibility of the state."""

import math

from plugin.lane.refine_fit import odds_of_paint, tally
from plugin.lane.ridge import road_noise
from plugin.lane.road_model import HEADING, KNOT, LEFT, NEXT_LEFT, OFFSET, PITCH, RIGHT, WIDTH
from sumo_net.compile import kernel

LEAST_JUDGED = 6  # least rows in view for the share of found ones to be meaningful
NEIGHBOUR_DIFFERENCE = 2.0 / math.sqrt(math.pi)  # mean |a - b| of two standard normal draws


@kernel
def pixel_noise(frame, rows, work):  # type: ignore[no-untyped-def]
    """Standard deviation of a pixel on the road between the borders, from differences of neighbours."""
    total, count = 0.0, 0
    for r in range(0, rows.shape[0], 4):
        left, right = work.border[LEFT, r, 0], work.border[RIGHT, r, 0]
        if math.isnan(left) or math.isnan(right):
            continue
        inset = 0.12 * (right - left)
        grain = road_noise(frame, frame.shape[0] - 1 - int(rows[r]), left + inset, right - inset)
        if not math.isnan(grain):
            total += grain
            count += 1
    return total / count / NEIGHBOUR_DIFFERENCE if count > 0 else 0.0


@kernel
def plausible(x, speed, t):  # type: ignore[no-untyped-def]
    """Whether a state can be that of a car in a lane, on a road that can be driven at `speed`."""
    if not (t.min_width_m <= x[WIDTH] <= t.max_width_m):
        return False
    if not abs(x[HEADING]) < 0.3 or not abs(x[OFFSET]) < 0.5 * x[WIDTH] + t.outside_m:
        return False
    most = min(t.bend_most_mps2 / max(speed * speed, 1.0), 0.02)
    for j in range(KNOT, KNOT + 6):
        if not abs(x[j]) < most:
            return False
    return abs(x[PITCH]) < 6.0 * t.pitch_std_rad + 1e-6


@kernel
def width_odds(width, t):  # type: ignore[no-untyped-def]
    """Probability of a lane width relative to the likeliest one; heavy tails, for arbitrary networks."""
    off = (width - t.lane_width_m) / t.lane_width_std_m
    return max(math.exp(-0.125 * off * off), t.odd_width)


@kernel
def over(side, x, t):  # type: ignore[no-untyped-def]
    """Whether a car that is beyond x's border on a side is in the lane there.

    A strip of a less usual width than this lane may be a shoulder or a median: then all of the car must be
    beyond the border.
    """
    odder = width_odds(x[NEXT_LEFT + side], t) < min(width_odds(x[WIDTH], t), t.usual_width)
    return abs(x[OFFSET]) - 0.5 * x[WIDTH] > (t.odd_beyond_m if odder else 0.0)


@kernel
def of_usual_width(x, t):  # type: ignore[no-untyped-def]
    """Whether x has a usual lane width."""
    return width_odds(x[WIDTH], t) >= t.usual_width


@kernel
def side_seen(found, expected, t):  # type: ignore[no-untyped-def]
    """Whether a border counts as measured in this frame."""
    return found >= t.least_rows and found >= t.least_share * expected


@kernel
def _both(left, right):  # type: ignore[no-untyped-def]
    """Rows found of both borders as one number, dominated by the weaker one."""
    return min(left, 3 * right) + min(right, 3 * left)


@kernel
def support_of(x, t, work):  # type: ignore[no-untyped-def]
    """Number of rows that support the lane x, reduced at unusual widths."""
    left, _ = tally(work, LEFT)
    right, _ = tally(work, RIGHT)
    return int(_both(left, right) * min(1.0, width_odds(x[WIDTH], t) / t.usual_width))


@kernel
def most_support(work):  # type: ignore[no-untyped-def]
    """Upper bound of support_of after a fit to the gathered ridges."""
    return _both(_rows_of_paint(LEFT, work), _rows_of_paint(RIGHT, work))


@kernel
def _rows_of_paint(side, work):  # type: ignore[no-untyped-def]
    """Rows where a fit may find a border: those whose ridges together are more likely paint than not."""
    count = 0
    for r in range(work.expected.shape[1]):
        odds = 0.0
        for c in range(work.ridges[side, r]):
            odds += odds_of_paint(work.ridge[side, r, c, 1])
        count += work.expected[side, r] and odds > 1.0
    return count


@kernel
def share_of_paint(side, work):  # type: ignore[no-untyped-def]
    """Share of the rows with paint near a line; -1 where too few rows of it are in view."""
    found, expected = 0, 0
    for r in range(work.expected.shape[1]):
        if work.expected[side, r]:
            expected += 1
            if work.ridges[side, r] > 0 and odds_of_paint(work.ridge[side, r, 0, 1]) > 1.0:
                found += 1
    return found / expected if expected >= LEAST_JUDGED else -1.0
