"""Data structures of the road: the packed table of all paths, and the road ahead of each vehicle.

A *path* is the smooth centre line of one SUMO lane, with the lanes behind it and the lanes ahead of it on a
route. Its station is arc length in metres from its start. Offsets are left of it.

Borders are held in slots: `OWN_RIGHT` and `OWN_RIGHT + 1` are the borders of the path's own lane, lower slots
those further right, higher slots those further left. An unused slot is NaN. A border keeps its slot along a
path where lanes begin or end beside it.
"""

from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array

MAX_BORDERS = 8  # slots of borders across a carriageway
OWN_RIGHT = 3  # slot of the right border of the path's own lane; its left border is the next slot
NO_MARKING, SOLID, DASHED = 0, 1, 2  # border kinds


def _ahead_stations() -> Array:
    # A chord of length Δ deviates from an arc of radius R by Δ²/(8R), in the image at distance Z by
    # f Δ²/(8 R Z) px. Δ = 0.4 sqrt(Z) keeps it below 0.1 px for f = 925 px and R = 250 m, also where the road
    # has turned by 40°.
    near = np.arange(-2.0, 6.0)
    root = np.linspace(np.sqrt(6.0), np.sqrt(180.0), 60)
    return np.concatenate([near, root**2])


AHEAD_M: Array = _ahead_stations()  # (J,) where RoadAhead samples the path, from the centre of gravity


class RoadAhead(NamedTuple):
    """The road in front of n vehicles, sampled at J stations along the lane path, in the vehicle frame.

    The path is the centre line of the vehicle's SUMO lane and of the lanes that follow on its route. Column j
    is the path `AHEAD_M[j]` metres beyond the projection of the centre of gravity onto it. Linear
    interpolation between columns is within 0.1 px for a focal length of 925 px and R >= 250 m. From where the
    path ends or has turned away from the vehicle, values are NaN.
    """

    station_m: Array  # (n, J) edge-anchored, the same for all vehicles at one place (dash phase)
    forward_m: Array  # (n, J) of the path
    left_m: Array  # (n, J)
    heading_rad: Array  # (n, J) of the path minus the vehicle's
    curvature_1pm: Array  # (n, J) of the path
    border_offset_m: Array  # (n, J, MAX_BORDERS) left of the path, from right to left; NaN for unused slots
    border_kind: Array  # (n, J, MAX_BORDERS) int8
    road_right_m: Array  # (n, J) right edge of the asphalt, left of the path (negative), and left edge
    road_left_m: Array  # (n, J)


class RoadTable(NamedTuple):
    """All paths: samples at a uniform spacing, and segments of about 20 m or less with the markings.

    Arrays may have unused rows at the end. A table stays valid for its paths when more are appended.
    """

    # per path
    first_sample: Array  # int64
    samples: Array  # int64, number of samples
    spacing_m: Array  # between samples, about 1 m
    own_start_m: Array  # station where the path's own lane starts
    own_end_m: Array
    own_length_m: Array  # SUMO's length of that lane
    first_segment: Array  # int64
    segments: Array  # int64, number of segments
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
