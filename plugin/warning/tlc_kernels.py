"""Kernel of the time to lane crossing over the fleet."""

import math

from sumo_net.compile import kernel


@kernel
def crossing(motion, path, ahead, half_span, step, out):  # type: ignore[no-untyped-def]
    """First border crossing of n vehicles on `path` (Trajectory), into `out` (Crossing); half_span (n,)."""
    for i in range(motion.lateral_offset_m.size):
        half_lane = 0.5 * motion.lane_width_m[i]
        d, psi = motion.lateral_offset_m[i], motion.heading_error_rad[i]
        out.left_s[i] = out.right_s[i] = out.tlc_s[i] = math.nan
        out.gap_left_m[i] = out.gap_right_m[i] = math.nan
        out.side[i] = 0
        if not math.isfinite(d + psi + half_lane + path.lane_offset_m[i, 0]):
            continue
        axle, wheel = d + ahead * math.sin(psi), half_span[i] * math.cos(psi)
        left, right = half_lane - axle - wheel, half_lane + axle - wheel  # gaps of the outer wheels
        out.gap_left_m[i], out.gap_right_m[i] = left, right
        out.left_s[i] = 0.0 if left <= 0.0 else math.inf
        out.right_s[i] = 0.0 if right <= 0.0 else math.inf
        for j in range(path.lane_offset_m.shape[1]):
            d, psi = path.lane_offset_m[i, j], path.lane_heading_rad[i, j]
            axle, wheel = d + ahead * math.sin(psi), half_span[i] * math.cos(psi)
            left1, right1 = half_lane - axle - wheel, half_lane + axle - wheel
            if left1 <= 0.0 and out.left_s[i] == math.inf:
                out.left_s[i] = step * (j + left / (left - left1))
            if right1 <= 0.0 and out.right_s[i] == math.inf:
                out.right_s[i] = step * (j + right / (right - right1))
            left, right = left1, right1
        out.tlc_s[i] = min(out.left_s[i], out.right_s[i])
        if out.tlc_s[i] < math.inf:
            out.side[i] = 1 if out.left_s[i] <= out.right_s[i] else -1
