"""The smooth road of lane paths, from any SUMO lane shapes: pose, curvature, borders at a station."""

from sumo_net.road_table import (
    AHEAD_M,
    DASHED,
    MAX_BORDERS,
    NO_MARKING,
    OWN_RIGHT,
    SOLID,
    Array,
    RoadAhead,
    RoadTable,
)

__all__ = [
    "AHEAD_M",
    "DASHED",
    "MAX_BORDERS",
    "NO_MARKING",
    "OWN_RIGHT",
    "SOLID",
    "Array",
    "RoadAhead",
    "RoadTable",
]
