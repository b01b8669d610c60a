"""Roads in closed form for tests: RoadAhead of a straight, a circle or a clothoid, and empty Objects."""

from collections.abc import Sequence

import numpy as np

from sumo_net.road import AHEAD_M, DASHED, MAX_BORDERS, OWN_RIGHT, SOLID, Array, RoadAhead
from sumo_net.surroundings import Objects

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def road_ahead(
    curvature_1pm: float | Sequence[float] | Array = 0.0,
    curvature_rate_1pm2: float | Sequence[float] | Array = 0.0,
    offset_m: float | Sequence[float] | Array = 0.0,
    heading_error_rad: float | Sequence[float] | Array = 0.0,
    station_m: float | Sequence[float] | Array = 1000.0,
    lane_width_m: float = 3.75,
    lanes_right: int = 1,
    lanes_left: int = 1,
    kinds: Sequence[int] | None = None,
    shoulder_m: float = 2.5,
    ahead_m: Array = AHEAD_M,
) -> RoadAhead:
    """The road ahead of n vehicles, n from the longest argument.

    curvature at the vehicle's foot and its change per metre; offset_m: centre of gravity left of the lane
    centre; heading_error_rad: vehicle heading minus lane heading. Borders: `lanes_right` lanes right of the
    own one, `lanes_left` left; `kinds` of the borders from right to left, by default solid at both ends and
    dashed between.
    """
    k0, k1, d, e, s0 = np.broadcast_arrays(
        *(
            np.atleast_1d(np.asarray(value, float))
            for value in (curvature_1pm, curvature_rate_1pm2, offset_m, heading_error_rad, station_m)
        )
    )
    n, J = len(k0), len(ahead_m)
    s = ahead_m[None, :]
    # position on the path by Gauss quadrature of (cos, sin) of its heading: exact to rounding
    t = 0.5 * s[:, :, None] * (_NODES + 1.0)
    direction = k0[:, None, None] * t + 0.5 * k1[:, None, None] * t**2
    x = 0.5 * s * np.sum(_WEIGHTS * np.cos(direction), axis=2)
    y = 0.5 * s * np.sum(_WEIGHTS * np.sin(direction), axis=2)
    y = y - d[:, None]
    cos, sin = np.cos(e)[:, None], np.sin(e)[:, None]
    count = lanes_right + lanes_left + 2
    first = OWN_RIGHT - lanes_right
    if first < 0 or first + count > MAX_BORDERS:
        raise ValueError(f"lanes_right = {lanes_right}, lanes_left = {lanes_left}: too many borders")
    chosen = [SOLID] + [DASHED] * (count - 2) + [SOLID] if kinds is None else list(kinds)
    if len(chosen) != count:
        raise ValueError(f"kinds = {chosen}: {count} are needed")
    offset = np.full((n, J, MAX_BORDERS), np.nan)
    kind = np.zeros((n, J, MAX_BORDERS), np.int8)
    for b in range(count):
        offset[:, :, first + b] = (b - lanes_right - 0.5) * lane_width_m
        kind[:, :, first + b] = chosen[b]
    return RoadAhead(
        station_m=s0[:, None] + s,
        forward_m=cos * x + sin * y,
        left_m=-sin * x + cos * y,
        heading_rad=k0[:, None] * s + 0.5 * k1[:, None] * s**2 - e[:, None],
        curvature_1pm=k0[:, None] + k1[:, None] * s,
        border_offset_m=offset,
        border_kind=kind,
        road_right_m=np.full((n, J), -(lanes_right + 0.5) * lane_width_m - shoulder_m),
        road_left_m=np.full((n, J), (lanes_left + 0.5) * lane_width_m + 0.5),
    )


def no_objects(n: int, bodies: int = 4) -> Objects:
    """Objects of which none is used."""
    blank = np.full((n, bodies), np.nan)
    return Objects(np.full((n, bodies), -1, np.int64), *(blank.copy() for _ in range(8)))


def objects_at(rows: Sequence[Sequence[dict[str, float]]], bodies: int = 8) -> Objects:
    """Objects from dictionaries, one list a vehicle; keys as Objects' fields; a car by default."""
    objects = no_objects(len(rows), bodies)
    for i, row in enumerate(rows):
        for m, body in enumerate(row):
            full = {
                "handle": m + 1,
                "heading_rad": 0.0,
                "speed_mps": 25.0,
                "acceleration_mps2": 0.0,
                "length_m": 4.6,
                "width_m": 1.8,
                "height_m": 1.5,
                **body,
            }
            for name, value in full.items():
                getattr(objects, name)[i, m] = value
    return objects
