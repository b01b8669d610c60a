"""Roads given by formula, without a network: RoadAhead on a road of piecewise linear curvature.

For experiments, benchmarks and tests that need an exactly known road: straights, circles, clothoids and any
chain of them.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array
from sumo_net.road import AHEAD_M, DASHED, MAX_BORDERS, OWN_RIGHT, SOLID, RoadAhead
from sumo_net.surroundings import Objects

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
Number = float | Sequence[float] | Array


class PlainRoad(NamedTuple):
    """A lane's centre line: curvature linear between stations, constant before and beyond them."""

    station_m: Array  # (m,) ascending
    curvature_1pm: Array  # (m,) left positive

    def curvature(self, station_m: Array | float) -> Array:
        """Curvature in 1/m at stations of any shape."""
        return np.asarray(np.interp(station_m, self.station_m, self.curvature_1pm))

    def heading(self, station_m: Array | float) -> Array:
        """Heading in rad relative to that at the first station: the exact integral of the curvature."""
        s, k = self.station_m, self.curvature_1pm
        at_knots = np.concatenate([[0.0], np.cumsum(0.5 * (k[1:] + k[:-1]) * np.diff(s))])
        at = np.asarray(station_m, float)
        j = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 1)
        from_knot = at - s[j]
        return np.asarray(at_knots[j] + 0.5 * (k[j] + self.curvature(at)) * from_knot)

    def ahead(
        self,
        station_m: Number,
        offset_m: Number,
        heading_error_rad: Number,
        lane_width_m: float = 3.75,
        lanes_right: int = 1,
        lanes_left: int = 1,
        kinds: Sequence[int] | None = None,
        shoulder_m: float = 2.5,
    ) -> RoadAhead:
        """The road ahead of n vehicles abreast of station_m; the other arguments as in `road_ahead`."""
        foot, d, e = _vectors(station_m, offset_m, heading_error_rad)
        start = self.heading(foot)

        def turned(t: Array) -> Array:
            column = foot.reshape(-1, *[1] * (t.ndim - 1))
            return self.heading(column + t) - start.reshape(column.shape)

        curvature = self.curvature(foot[:, None] + AHEAD_M)
        return _laid_out(
            turned, curvature, foot, d, e, AHEAD_M, lane_width_m, lanes_right, lanes_left, kinds, shoulder_m
        )


def road_ahead(
    curvature_1pm: Number = 0.0,
    curvature_rate_1pm2: Number = 0.0,
    offset_m: Number = 0.0,
    heading_error_rad: Number = 0.0,
    station_m: Number = 1000.0,
    lane_width_m: float = 3.75,
    lanes_right: int = 1,
    lanes_left: int = 1,
    kinds: Sequence[int] | None = None,
    shoulder_m: float = 2.5,
    ahead_m: Array = AHEAD_M,
) -> RoadAhead:
    """The road ahead of n vehicles, each on a straight, a circle or a clothoid; numbers broadcast to (n,).

    curvature_1pm: abreast of the vehicle; offset_m: centre of gravity left of the lane centre;
    heading_error_rad: vehicle heading minus lane heading. `lanes_right`, `lanes_left`: lanes beside the own
    one; `kinds` of the borders from right to left, by default solid at both ends and dashed between. Raises
    ValueError for more borders than a RoadAhead holds, or another number of kinds than of borders.
    """
    k0, k1, d, e, s0 = _vectors(curvature_1pm, curvature_rate_1pm2, offset_m, heading_error_rad, station_m)

    def turned(t: Array) -> Array:
        shape = (-1, *[1] * (t.ndim - 1))
        return k0.reshape(shape) * t + 0.5 * k1.reshape(shape) * t**2

    curvature = k0[:, None] + k1[:, None] * ahead_m[None, :]
    return _laid_out(
        turned, curvature, s0, d, e, ahead_m, lane_width_m, lanes_right, lanes_left, kinds, shoulder_m
    )


def no_objects(n: int, bodies: int = 4) -> Objects:
    """Empty Objects: all `bodies` slots of n vehicles unused."""
    blank = np.full((n, bodies), np.nan)
    return Objects(np.full((n, bodies), -1, np.int64), *(blank.copy() for _ in Objects._fields[1:]))


def _vectors(*numbers: Number) -> tuple[Array, ...]:
    return np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, float)) for value in numbers))


def _laid_out(
    turned: Callable[[Array], Array],
    curvature: Array,
    foot: Array,
    d: Array,
    e: Array,
    ahead_m: Array,
    lane_width_m: float,
    lanes_right: int,
    lanes_left: int,
    kinds: Sequence[int] | None,
    shoulder_m: float,
) -> RoadAhead:
    """`turned(t)`: the centre line's heading t metres beyond `foot`, minus that at `foot`."""
    n, J = len(foot), len(ahead_m)
    s = ahead_m[None, :]
    # position on the path by Gauss quadrature of (cos, sin) of its heading: exact to rounding
    direction = turned(0.5 * s[:, :, None] * (_NODES + 1.0))
    x = 0.5 * s * np.sum(_WEIGHTS * np.cos(direction), axis=2)
    y = 0.5 * s * np.sum(_WEIGHTS * np.sin(direction), axis=2)
    y = y - d[:, None]
    cos, sin = np.cos(e)[:, None], np.sin(e)[:, None]
    count = lanes_right + lanes_left + 2
    first = OWN_RIGHT - lanes_right
    if first < 0 or first + count > MAX_BORDERS:
        raise ValueError(f"lanes_right = {lanes_right}, lanes_left = {lanes_left}: too many lanes")
    chosen = [SOLID] + [DASHED] * (count - 2) + [SOLID] if kinds is None else list(kinds)
    if len(chosen) != count:
        raise ValueError(f"kinds = {chosen}: must have {count} entries, one per border")
    offset = np.full((n, J, MAX_BORDERS), np.nan)
    kind = np.zeros((n, J, MAX_BORDERS), np.int8)
    for b in range(count):
        offset[:, :, first + b] = (b - lanes_right - 0.5) * lane_width_m
        kind[:, :, first + b] = chosen[b]
    return RoadAhead(
        station_m=foot[:, None] + s,
        forward_m=cos * x + sin * y,
        left_m=-sin * x + cos * y,
        heading_rad=turned(s + np.zeros((n, 1))) - e[:, None],
        curvature_1pm=curvature,
        border_offset_m=offset,
        border_kind=kind,
        road_right_m=np.full((n, J), -(lanes_right + 0.5) * lane_width_m - shoulder_m),
        road_left_m=np.full((n, J), (lanes_left + 0.5) * lane_width_m + 0.5),
    )
