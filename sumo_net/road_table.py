"""What the road is to the rest: the packed table of all paths, and the road ahead of each vehicle.

A *path* is the smooth centre line of one SUMO lane, with the lanes behind it and the lanes ahead of it on a
route. Its station runs from 0 at its start, in metres of arc length. Offsets are left of it.

Borders stand in slots: `OWN_RIGHT` and `OWN_RIGHT + 1` are the borders of the path's own lane, lower slots
those further right, higher slots those further left. A slot that is not used is NaN. Slots keep their place
along a path when lanes come and go at its sides, so that a border never jumps to its neighbour.
"""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]

MAX_BORDERS = 8  # marking lines across a carriageway that are described
OWN_RIGHT = 3  # slot of the right border of the path's own lane; its left border is the next slot
NO_MARKING, SOLID, DASHED = 0, 1, 2  # border kinds


def _ahead_stations() -> Array:
    # A chord of length Δ misses an arc of radius R by Δ²/(8R); seen at distance Z that is f Δ²/(8 R Z) px.
    # Δ = 0.4 sqrt(Z) keeps it under 0.1 px for f = 925 px and R = 250 m, a road turned by 40° included.
    near = np.arange(-2.0, 6.0)
    root = np.linspace(np.sqrt(6.0), np.sqrt(180.0), 60)
    return np.concatenate([near, root**2])


AHEAD_M: Array = _ahead_stations()  # (J,) where RoadAhead samples the path, from the centre of gravity


class RoadAhead(NamedTuple):
    """The road in front of n vehicles, sampled at J stations along the lane path, in the vehicle frame.

    The path is the centre line of SUMO's lane that the vehicle is in (and of the lanes that follow it on the
    vehicle's route). Column j is the path `AHEAD_M[j]` metres ahead of the vehicle's foot on it. Linear
    interpolation between the columns costs under 0.1 px of a 925 px camera at R >= 250 m. Where the path ends
    or has turned away from the vehicle, `forward_m` and what follows are NaN.
    """

    station_m: Array  # (n, J) along the edge, the same for every vehicle that sees the place (dash phase)
    forward_m: Array  # (n, J) path centre line
    left_m: Array  # (n, J)
    heading_rad: Array  # (n, J) of the path minus the vehicle's
    curvature_1pm: Array  # (n, J) of the path
    border_offset_m: Array  # (n, J, MAX_BORDERS) left of the path, from right to left; NaN for unused slots
    border_kind: Array  # (n, J, MAX_BORDERS) int8
    road_right_m: Array  # (n, J) edges of the asphalt, left of the path (the right one is negative)
    road_left_m: Array  # (n, J)


class RoadTable(NamedTuple):
    """All paths: samples at a uniform spacing, and segments (20 m or less) that say how the road is marked.

    Arrays may be longer than what is used. A table that was taken stays valid for the paths it knew.
    """

    # per path
    first_sample: Array  # int64
    samples: Array  # int64, how many
    spacing_m: Array  # between samples, about 1 m
    own_start_m: Array  # station where the path's own lane starts
    own_end_m: Array
    own_length_m: Array  # SUMO's length of that lane
    first_segment: Array  # int64
    segments: Array  # int64, how many
    # per sample
    x_m: Array
    y_m: Array
    heading_rad: Array  # unwrapped
    curvature_1pm: Array
    # per segment
    segment_start_m: Array  # station
    anchor_m: Array  # edge-anchored station at the segment's start
    stretch: Array  # edge-anchored metres per metre of station
    border_offset_m: Array  # (segments, MAX_BORDERS)
    border_kind: Array  # (segments, MAX_BORDERS) int8
    road_right_m: Array
    road_left_m: Array
