"""A smooth road fitted to SUMO's lane shapes.

SUMO's shapes are polylines whose points are taken as samples of a smooth road. A segment at whose two ends
the polyline turns the same way is taken as the chord of an arc, of the smaller of the curvatures at its ends;
otherwise it stays straight. The arcs are sampled every half metre. A corner that remains is rounded by a
parabola, up to `CORNER_DEPTH_M` deep. Of the samples q, the curve p that minimises

    Σ |p − q|² + Σ λ |Δ³p|²,    λ = (ℓ/h)⁶

is taken (Whittaker 1923): the penalty on the third derivative leaves straights and arcs as they are and lets
waves longer than about 2πℓ pass. ℓ starts at `SCALE_M` and shrinks where the curve deviates from the samples
by more than `TOLERANCE_M`, or by more than `KINK_TOLERANCE_M` around kinks and tight corners, so that a kink
of the shape does not become a bend that no car can drive. Where even that tolerance would need a bend tighter
than `TIGHTEST_1PM`, it is exceeded; the fit error reports by how much.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d

from sumo_net.arrays import Array
from sumo_net.polyline import stations

SCALE_M = 12.0  # ℓ at first
SHORTEST_SCALE_M = 0.4
TOLERANCE_M = 0.012
TIGHT_1PM = 1.0 / 40.0  # a tighter curve is taken as a kink of the shape,
KINK_TOLERANCE_M = 0.08  # with this tolerance
TIGHTEST_1PM = 1.0 / 4.0  # tighter than a car can turn: there the tolerance does not hold
CORNER_RAD = math.radians(2.0)  # least turn at a point, beyond that of the arcs, that is rounded as a corner
CORNER_DEPTH_M = 0.25  # that rounding cuts off a corner, or more
CORNER_LEAST_RADIUS_M = 6.0  # for a radius that a car can drive,
CORNER_MOST_M = 1.0  # but not more than this,
CORNER_RADIUS_M = 80.0  # and not for a radius above this
DEEPEST_BULGE_M = (
    0.4  # of an arc above its chord; deeper arcs fade, at twice this depth to the straight chord
)
_KINK_REACH_M = 10.0
_LOCK_REACH_M = 3.0
STEP_M = 0.5  # h
SPACING_M = 1.0  # of the resulting samples
_SHORT_CHORD_M = 1.0  # points closer than this say little about curvature
_ROUNDS = 14
_MOST_STEPS = 30.0  # ℓ/h; beyond it the matrix is singular to rounding
_THIRD = np.array([-1.0, 3.0, -3.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath:
    """A path sampled at a uniform spacing of arc length."""

    spacing_m: float
    x_m: Array  # (samples,)
    y_m: Array
    heading_rad: Array  # unwrapped
    curvature_1pm: Array
    lane_start_m: Array  # (lanes,) stations
    lane_end_m: Array
    error_m: float  # largest lateral distance from the lane shapes with their arcs

    def turned(self) -> "SmoothPath":
        """The same path in the other direction."""
        length = self.spacing_m * (len(self.x_m) - 1)
        return SmoothPath(
            self.spacing_m,
            self.x_m[::-1],
            self.y_m[::-1],
            self.heading_rad[::-1] + math.pi,
            -self.curvature_1pm[::-1],
            length - self.lane_end_m[::-1],
            length - self.lane_start_m[::-1],
            self.error_m,
        )


def fit(shapes: list[Array], rounding_m: float = 0.005) -> SmoothPath:
    """Fit one smooth path to the shapes (points, 2) of consecutive lanes, whose rounding error is rounding_m.

    Shapes shorter than 2 m together are extended straight to 2 m; below 1 cm, ValueError is raised.
    """
    points, starts, ends = _concatenate(shapes)
    way = points[-1] - points[0]
    if len(points) < 50 and np.hypot(*np.diff(points, axis=0).T).sum() < 2.0 * SPACING_M:
        if np.hypot(*way) < 0.01:
            raise ValueError(f"a road of {np.hypot(*way):.3f} m is too short to be fitted")
        points = points.copy()
        points[-1] = points[0] + way / np.hypot(*way) * 2.0 * SPACING_M
    q, along, at_points, corners = _sample(points, rounding_m)
    h = float(along[1])
    p = _smooth(q + corners, h, max(TOLERANCE_M, 1.6 * rounding_m))
    return _resample(p, q, at_points[starts] / h, at_points[ends] / h)


def cut(shape: Array, begin: float, end: float) -> Array:
    """The part of a polyline (points, 2) between two fractions of its length; at least two points."""
    if begin <= 0.0 and end >= 1.0:
        return shape
    at = stations(shape)
    at = at / max(float(at[-1]), 1e-9)
    inside = at[(at > begin) & (at < end)]
    wanted = np.concatenate([[begin], inside, [end]])
    return np.column_stack([np.interp(wanted, at, shape[:, 0]), np.interp(wanted, at, shape[:, 1])])


def _concatenate(shapes: list[Array]) -> tuple[Array, Array, Array]:
    # One polyline; a gap (networks without internal lanes) is bridged by a Hermite cubic.
    parts: list[Array] = []
    starts, ends, count = [], [], 0
    for shape in shapes:
        if parts:
            before = parts[-1]
            gap = float(np.hypot(*(shape[0] - before[-1])))
            if gap > 1.0:
                bridge = _bridge(before, shape, gap)
                parts.append(bridge)
                count += len(bridge)
        starts.append(count)
        parts.append(shape)
        count += len(shape)
        ends.append(count - 1)
    return np.concatenate(parts), np.array(starts), np.array(ends)


def _bridge(before: Array, after: Array, gap: float) -> Array:
    out, into = before[-1] - before[-2], after[1] - after[0]
    out, into = out / max(np.hypot(*out), 1e-9) * gap, into / max(np.hypot(*into), 1e-9) * gap
    t = np.linspace(0.0, 1.0, max(int(gap), 2) + 1)[1:-1, None]
    w = t * t * (3.0 - 2.0 * t)
    bend = t * (1.0 - t) ** 2 * out + t * t * (t - 1.0) * into
    return np.asarray(before[-1] + w * (after[0] - before[-1]) + bend)


def _sample(points: Array, rounding_m: float) -> tuple[Array, Array, Array, Array]:
    # Half-metre samples of the polyline with its arcs, their parameter, the parameter of every given point,
    # and the displacements that round the corners, to be added to the samples.
    kept = [0]
    parameter = np.zeros(len(points))
    last = len(points) - 1
    for k in range(1, len(points)):
        gone = float(np.hypot(*(points[k] - points[kept[-1]])))
        parameter[k] = parameter[kept[-1]] + gone
        if gone >= _SHORT_CHORD_M:
            kept.append(k)
    if kept[-1] != last:  # the end point replaces a neighbour that is too close
        if len(kept) > 1:
            kept.pop()
        gone = float(np.hypot(*(points[last] - points[kept[-1]])))
        parameter[last] = parameter[kept[-1]] + gone
        kept.append(last)
        parameter = np.minimum(parameter, parameter[last])
    parameter = np.maximum.accumulate(parameter)
    knots = points[kept]
    chord = np.diff(knots, axis=0)
    length = np.hypot(chord[:, 0], chord[:, 1])
    total = float(length.sum())
    if total < 0.01:
        raise ValueError(f"a road of {total:.3f} m is too short to be fitted")
    direction = np.arctan2(chord[:, 1], chord[:, 0])
    turn = np.diff(direction)
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    # Turns within the rounding error are not evidence; beside a long chord they would bend it by centimetres.
    chance = 2.0 * rounding_m * (1.0 / length[1:] + 1.0 / length[:-1])
    turn = np.sign(turn) * np.maximum(np.abs(turn) - chance, 0.0)
    bend = np.concatenate([[0.0], 2.0 * turn / (length[1:] + length[:-1]), [0.0]])
    if len(turn):
        bend[0], bend[-1] = bend[1], bend[-2]  # curvature is taken as constant at the ends
    a, b = bend[:-1], bend[1:]
    curvature = np.where(a * b > 0.0, np.sign(a) * np.minimum(np.abs(a), np.abs(b)), 0.0)
    # A long straight between two kinks is not an arc: an arc that would be too deep is flattened.
    depth = np.abs(curvature) * length**2 / 8.0
    curvature *= np.clip(2.0 - depth / DEEPEST_BULGE_M, 0.0, 1.0)

    t = np.linspace(0.0, total, max(int(np.ceil(total / STEP_M)), 8) + 1)
    station = np.concatenate([[0.0], np.cumsum(length)])
    i = np.clip(np.searchsorted(station, t, side="right") - 1, 0, len(length) - 1)
    u = t - station[i]
    aside = -0.5 * curvature[i] * u * (length[i] - u)
    unit = chord[i] / length[i, None]
    normal = np.column_stack([-unit[:, 1], unit[:, 0]])
    half = 0.5 * curvature * length  # half of an arc's turn, at either end
    left_over = np.zeros(len(bend))
    left_over[1:-1] = turn - half[:-1] - half[1:]
    rounded = _round_corners(t, station, direction, left_over)
    return knots[i] + unit * u[:, None] + normal * aside[:, None], t, parameter, rounded


def _round_corners(t: Array, station: Array, direction: Array, corner: Array) -> Array:
    # Displacements (samples, 2): parabolas of half length T, θ/4T (T − |u|)² deep, of radius 2T/θ.
    added = np.zeros((len(t), 2))
    for k in np.flatnonzero(np.abs(corner) > CORNER_RAD):
        angle = abs(float(corner[k]))
        depth = max(CORNER_DEPTH_M, CORNER_LEAST_RADIUS_M * angle**2 / 8.0)
        reach = min(4.0 * min(depth, CORNER_MOST_M) / angle, 0.5 * CORNER_RADIUS_M * angle)
        reach = min(reach, 0.5 * float(station[k] - station[k - 1]), 0.5 * float(station[k + 1] - station[k]))
        u = np.abs(t - station[k])
        near = u < reach
        middle = direction[k - 1] + 0.5 * corner[k]
        inward = np.sign(corner[k]) * np.array([-math.sin(middle), math.cos(middle)])
        added[near] += (angle / (4.0 * reach) * (reach - u[near]) ** 2)[:, None] * inward
    return added


def _smooth(q: Array, h: float, tolerance_m: float) -> Array:
    scale = np.full(len(q), min(SCALE_M, _MOST_STEPS * h))
    for _ in range(_ROUNDS):
        p = _whittaker(q, scale, h)
        away = np.abs(_lateral(p, q))
        bend = np.zeros(len(q))
        bend[1:-1] = np.hypot(*(p[2:] - 2.0 * p[1:-1] + p[:-2]).T) / h**2
        kink = maximum_filter1d(bend, 2 * round(_KINK_REACH_M / h) + 1) > TIGHT_1PM
        full_lock = maximum_filter1d(bend, 2 * round(_LOCK_REACH_M / h) + 1) > TIGHTEST_1PM
        tolerance = np.where(kink, max(KINK_TOLERANCE_M, tolerance_m), tolerance_m)
        bad = (away > tolerance) & (scale > SHORTEST_SCALE_M) & ~full_lock
        if not bad.any():
            break
        # The deviation grows with the scale: linearly at a kink, with its cube where a bend begins. The
        # reduction is continuous in the deviation, so that paths through the same lanes get the same scale.
        less = (0.85 * tolerance / np.maximum(away, 1e-9)) ** np.where(kink, 0.8, 0.4)
        wanted = np.where(full_lock, np.inf, scale * np.clip(less, 0.3, 1.0))
        scale = np.minimum(scale, _spread(np.maximum(wanted, SHORTEST_SCALE_M), h))
    return p


def _spread(wanted: Array, h: float) -> Array:
    # The largest scale not above `wanted` that changes by at most 0.4 m per metre.
    ramp = 0.4 * h * np.arange(len(wanted))
    forward = np.minimum.accumulate(wanted - ramp) + ramp
    backward = (np.minimum.accumulate((wanted + ramp)[::-1])[::-1]) - ramp
    return np.minimum(forward, backward)


def _whittaker(q: Array, scale: Array, h: float) -> Array:
    # Solved for the correction p − q: exact to rounding although the matrix is ill-conditioned.
    middle = (scale[1:-2] + scale[2:-1]) / 2.0
    weight = (middle / h) ** 6
    size = len(q)
    bands = np.zeros((4, size))
    bands[3] = 1.0
    rhs = np.zeros_like(q)
    third = -(q[3:] - 3.0 * q[2:-1] + 3.0 * q[1:-2] - q[:-3]) * weight[:, None]
    for a in range(4):
        rhs[a : size - 3 + a] += _THIRD[a] * third
        for d in range(4 - a):
            bands[3 - d, a + d : size - 3 + a + d] += weight * (_THIRD[a] * _THIRD[a + d])
    return np.asarray(q + solveh_banded(bands, rhs, overwrite_ab=True, overwrite_b=True, check_finite=False))


def _lateral(p: Array, q: Array) -> Array:
    along = np.gradient(q, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    away = p - q
    return np.asarray(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])


def _resample(p: Array, q: Array, starts: Array, ends: Array) -> SmoothPath:
    t = np.arange(len(p), dtype=float)
    curve = CubicSpline(t, p)
    speed = np.hypot(*curve(t, 1).T)
    halfway = np.hypot(*curve(t[:-1] + 0.5, 1).T)
    station = np.concatenate([[0.0], np.cumsum((speed[:-1] + 4.0 * halfway + speed[1:]) / 6.0)])  # Simpson
    total = float(station[-1])
    count = max(round(total / SPACING_M), 2)
    s = np.linspace(0.0, total, count + 1)
    u = CubicSpline(station, t)(s)
    x, y = curve(u).T
    dx, dy = curve(u, 1).T
    ddx, ddy = curve(u, 2).T
    heading = np.unwrap(np.arctan2(dy, dx))
    curvature = (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3
    return SmoothPath(
        total / count,
        x,
        y,
        heading,
        curvature,
        np.interp(starts, t, station),
        np.interp(ends, t, station),
        float(np.abs(_lateral(p, q)).max()),
    )
