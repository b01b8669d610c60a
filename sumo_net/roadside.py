"""Roadside objects: delineator posts, guard-rail posts that reflect radar, parked cars.

They are placed once along the outer borders of a network's edges, fixed in the world, with handles below -1:
every vehicle that passes meets the same objects.
"""

from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from sumo_net import polyline
from sumo_net.arrays import Array
from sumo_net.lane_graph import Lane, LaneGraph
from sumo_net.randomness import generator
from sumo_net.settings import settings

FIRST_HANDLE = -2
_SAMPLE_M = 2.0  # spacing at which lanes are sampled to find objects on them
_FREE_M = 0.15  # least clearance from any lane's border

POST = (0.12, 0.12, 1.0)  # length, width, height
RAIL_POST = (0.15, 0.12, 0.75)
PARKED = (4.4, 1.8, 1.5)


@settings
class Roadside:
    """Roadside objects; a spacing or number of 0 leaves a kind out."""

    post_spacing_m: float = Field(
        50.0, ge=0, description="spacing of delineator posts on both sides, along each edge"
    )
    post_clearance_m: float = Field(
        0.5, ge=0, le=10, description="distance from the asphalt's edge to the posts"
    )
    rail_side: Literal["left", "right", "both", "none"] = Field("left", description="sides with guard rails")
    rail_spacing_m: float = Field(20.0, ge=0, description="spacing of the reflecting points of a rail")
    rail_clearance_m: float = Field(
        0.4, ge=0, le=10, description="distance from the asphalt's edge to the rail"
    )
    parked_per_km: float = Field(
        0.3,
        ge=0,
        le=100,
        description="parked cars per km at the roadside, on the side where traffic keeps, mean",
    )
    parked_clearance_m: float = Field(
        0.35, ge=0.2, le=5, description="distance from the outer lane's border to a parked car"
    )
    seed: int = Field(1, ge=0, lt=2**31, description="random seed of the positions of parked cars")


class RoadsideTable(NamedTuple):
    """All S roadside objects of a network as boxes, sorted by x; all arrays (S,)."""

    handle: Array  # int64, below -1
    x_m: Array  # centre, world
    y_m: Array
    heading_rad: Array  # of the road there
    length_m: Array
    width_m: Array
    height_m: Array


def nothing() -> RoadsideTable:
    """A table without objects."""
    return RoadsideTable(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(6)))


def place(
    roadside: Roadside, graph: LaneGraph, shoulder_right_m: float = 0.5, shoulder_left_m: float = 0.5
) -> RoadsideTable:
    """Place the objects along all drivable edges; the shoulders are asphalt outside the outer borders.

    Objects that would stand on a lane, such as posts in the middle of an undivided road, are left out.
    """
    rows: list[Array] = []
    for name in graph.drivable_edges():
        lanes = [graph.lanes[lane] for lane in graph.edges[name].lanes]
        for side, lane, shoulder in ((-1.0, lanes[0], shoulder_right_m), (1.0, lanes[-1], shoulder_left_m)):
            border = side * 0.5 * lane.width_m
            edge = border + side * shoulder
            if roadside.post_spacing_m > 0:
                stations = _stations(_length(lane), roadside.post_spacing_m)
                rows.append(_row(lane, stations, edge + side * roadside.post_clearance_m, POST))
            wanted = ("both", "right" if side < 0 else "left")
            if roadside.rail_spacing_m > 0 and roadside.rail_side in wanted:
                stations = _stations(_length(lane), roadside.rail_spacing_m)
                rows.append(_row(lane, stations, edge + side * roadside.rail_clearance_m, RAIL_POST))
        if roadside.parked_per_km > 0:
            draw = generator(roadside.seed, name, "parked")
            count = draw.poisson(roadside.parked_per_km * _length(lanes[0]) / 1000.0)
            stations = np.sort(draw.uniform(0.0, _length(lanes[0]), count))
            side, lane = (1.0, lanes[-1]) if graph.left_hand else (-1.0, lanes[0])
            away = 0.5 * lane.width_m + roadside.parked_clearance_m + 0.5 * PARKED[1]
            rows.append(_row(lane, stations, side * away, PARKED))
    if not rows:
        return nothing()
    table = np.concatenate(rows)
    table = table[_beside_all_lanes(table, graph)]
    handle = FIRST_HANDLE - np.arange(len(table))
    order = np.argsort(table[:, 0], kind="stable")
    x, y, heading, length, width, height = np.ascontiguousarray(table[order].T)
    return RoadsideTable(handle[order], x, y, heading, length, width, height)


def _length(lane: Lane) -> float:
    return float(np.hypot(*np.diff(lane.shape, axis=0).T).sum())


def _stations(length: float, spacing: float) -> Array:
    """Stations a `spacing` apart, the first half a spacing from the edge's start."""
    return np.arange(0.5 * spacing, length, spacing)


def _row(lane: Lane, stations: Array, offset: float, size: tuple[float, float, float]) -> Array:
    """(k, 6) x, y, heading, length, width, height at stations (k,), `offset` left of the lane's centre."""
    steps = np.diff(lane.shape, axis=0)
    along = polyline.stations(lane.shape)
    piece = np.clip(np.searchsorted(along, stations, side="right") - 1, 0, len(steps) - 1)
    heading = np.arctan2(steps[piece, 1], steps[piece, 0])
    part = stations - along[piece]
    x = lane.shape[piece, 0] + part * np.cos(heading) - offset * np.sin(heading)
    y = lane.shape[piece, 1] + part * np.sin(heading) + offset * np.cos(heading)
    return np.column_stack([x, y, heading, *(np.full(len(stations), value) for value in size)])


def _beside_all_lanes(table: Array, graph: LaneGraph) -> Array:
    """Mask (S,) of the objects (S, 6) that are clear of every lane for vehicles."""
    points, reach = [], []
    for lane in graph.lanes.values():
        if lane.walkable_only:
            continue
        stations = np.linspace(0.0, _length(lane), max(int(_length(lane) / _SAMPLE_M), 1) + 1)
        points.append(_row(lane, stations, 0.0, POST)[:, :2])
        reach.append(np.full(len(stations), 0.5 * lane.width_m + _FREE_M))
    tree, half = cKDTree(np.concatenate(points)), np.concatenate(reach)
    neighbours = min(12, len(half))
    distance, index = tree.query(table[:, :2], k=[*range(1, neighbours + 1)])
    # Samples are up to half a spacing away along the lane: the distance across it is at least this.
    needed = half[index] + 0.5 * table[:, 4:5]
    across = np.sqrt(np.maximum(distance**2 - (0.5 * _SAMPLE_M) ** 2, 0.0))
    return np.asarray((across > needed).all(axis=1))
