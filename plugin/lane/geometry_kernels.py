"""Kernels between borders in the image and the road model in the ground plane."""

import math

import numpy as np

from camera_synth.camera import vehicle_from_image
from plugin.lane.cholesky import cholesky, solve
from plugin.lane.estimate import ROW_STEP, ROWS
from sumo_net.compile import kernel

_SINGULAR = 1e-12  # points at one distance determine no curvature


@kernel
def road_of_borders(left, right, camera, farthest, columns, spacing, A, road):  # type: ignore[no-untyped-def]
    """Fit both borders at once by left = X₀ + e·X + K·X²/2; road = (X₀ left, X₀ right, e, K).

    left, right (3,) a, b, c. Every third of the processed rows gives a point where the border is inside the
    image and not farther than `farthest`, weighted by (focal/depth)² up to a factor, for equal errors in
    pixels. A (4, 4) is scratch. Lengths are scaled by `spacing`, which keeps the equations well conditioned.
    Returns False where a border is not seen.
    """
    A[:] = 0.0
    road[:] = 0.0
    row = np.empty(4)
    for side in range(2):
        border = left if side == 0 else right
        seen = 0
        for i in range(ROWS):
            y = 1.0 + ROW_STEP * i
            x = (border[0] * y + border[1]) * y + border[2]
            if not 0.0 <= x <= columns - 1.0:
                continue
            forward, aside = vehicle_from_image(x, y, camera)
            if not 0.0 < forward <= farthest:  # also where NaN: above the horizon
                continue
            weight = (spacing / (forward - camera.forward)) ** 2
            reach = forward / spacing
            row[0], row[1], row[2], row[3] = 1.0 - side, 1.0 * side, reach, reach * reach / 2.0
            for j in range(4):
                road[j] += weight * row[j] * aside
                for k in range(j + 1):
                    A[j, k] += weight * row[j] * row[k]
            seen += 1
        if seen < 3:
            return False
    if not cholesky(A, A, _SINGULAR):
        return False
    solve(A, road)
    road[2] /= spacing
    road[3] /= spacing * spacing
    return True


@kernel
def lane_estimate_kernel(left, right, score, camera, preview, columns, n, out):  # type: ignore[no-untyped-def]
    """Fill the LaneEstimate `out` from borders, see lane_estimate_from_borders; n: PlausibilityNumbers."""
    A = np.empty((4, 4))
    road = np.empty(4)
    for v in range(left.shape[0]):
        out.left_border_seen[v] = score[v, 0] >= n.least_score
        out.right_border_seen[v] = score[v, 1] >= n.least_score
        quality = 0.5 * (_share(score[v, 0], n.full_score) + _share(score[v, 1], n.full_score))
        out.score[v] = quality
        out.locked[v] = False
        out.lateral_offset_m[v] = math.nan
        out.heading_error_rad[v] = math.nan
        out.curvature_1pm[v] = math.nan
        out.curvature_rate_1pm2[v] = math.nan
        out.lane_width_m[v] = math.nan
        out.preview_offset_m[v] = math.nan
        out.preview_heading_rad[v] = math.nan
        if not (out.left_border_seen[v] and out.right_border_seen[v]):
            continue
        if not road_of_borders(left[v], right[v], camera, n.farthest_m, columns, 10.0, A, road):
            continue
        slope, bend = road[2], road[3]
        along = 1.0 / math.sqrt(1.0 + slope * slope)  # cosine of the lane's heading
        width = (road[0] - road[1]) * along + 2.0 * n.inset_m
        if not n.least_width_m <= width <= n.greatest_width_m:
            continue
        if abs(slope) > n.greatest_heading or abs(bend) > n.greatest_curvature_1pm:
            continue
        middle = 0.5 * (road[0] + road[1])
        slope_there = slope + bend * preview
        out.locked[v] = True
        out.lateral_offset_m[v] = -middle * along
        out.heading_error_rad[v] = -math.atan(slope)
        out.curvature_1pm[v] = bend / (1.0 + slope_there * slope_there) ** 1.5
        out.curvature_rate_1pm2[v] = 0.0
        out.lane_width_m[v] = width
        out.preview_offset_m[v] = middle + (slope + 0.5 * bend * preview) * preview
        out.preview_heading_rad[v] = math.atan(slope_there)


@kernel
def _share(score, full):  # type: ignore[no-untyped-def]
    return min(1.0, max(0.0, score / full))
