"""Builds the highway's SUMO network with netconvert.

Each direction is a chain of edges (split where the speed limit changes and where they would get too long),
connected lane by lane, so a vehicle can stay in its lane from end to end. SUMO gets polylines whose chords
deviate from the exact lane by at most `CHORD_ERROR_M`; finer ones would be slow, since SUMO searches a lane's
points one by one. Equipped vehicles drive on the exact line.
"""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from sumo_net.arrays import Array
from sumo_net.highway import Alignment, Highway, alignment
from sumo_net.netconvert import netconvert

CHORD_ERROR_M = 0.005
LONGEST_CHORD_M = 100.0
DIRECTIONS = ("forward", "backward")


@dataclass(frozen=True, slots=True, eq=False)
class Carriageway:
    """One direction of the built highway."""

    direction: str  # 'forward' or 'backward'
    alignment: Alignment  # driven in this direction
    edges: tuple[str, ...]  # in driving order
    start_m: Array  # (edges + 1,) stations of the nodes on this alignment
    speed_limit_mps: Array  # (edges,)


@dataclass(frozen=True, slots=True, eq=False)
class BuiltNetwork:
    """The highway, its network file, and both directions."""

    highway: Highway
    net_file: Path
    carriageways: tuple[Carriageway, Carriageway]


def build(highway: Highway, directory: Path, precision: int = 4) -> BuiltNetwork:
    """Write the plain XML of the highway and run netconvert; `precision`: decimals of the network's shapes.

    `directory` is created if missing; files of the same names in it are replaced. Raises BuildError with
    netconvert's message when it fails.
    """
    directory.mkdir(parents=True, exist_ok=True)
    both = tuple(carriageway(highway, direction) for direction in DIRECTIONS)
    plain = {"nod": "nodes", "edg": "edges", "con": "connections"}
    for suffix, root in plain.items():
        lines = [line for way in both for line in _WRITERS[suffix](highway, way)]
        text = "\n".join(["<?xml version='1.0' encoding='UTF-8'?>", f"<{root}>", *lines, f"</{root}>", ""])
        (directory / f"highway.{suffix}.xml").write_text(text, encoding="utf-8")
    net_file = directory / "highway.net.xml"
    files = [f"--{kind}-files={directory / f'highway.{suffix}.xml'}" for kind, suffix in _FILES.items()]
    netconvert(
        net_file,
        *files,
        f"--precision={precision}",
        "--no-turnarounds=true",
        "--offset.disable-normalization=true",
        "--junctions.limit-turn-speed=-1",
    )
    return BuiltNetwork(highway, net_file, (both[0], both[1]))


def carriageway(highway: Highway, direction: str) -> Carriageway:
    """Edges and stations of one direction ('forward' or 'backward')."""
    forward = alignment(highway.elements)
    elements, line = highway.elements, forward
    if direction == "backward":
        elements, line = highway.elements[::-1], forward.reversed()
    ends: list[float] = [0.0]
    limits: list[float] = []
    station = 0.0
    for kmh, group in itertools.groupby(elements, key=lambda element: element.speed_limit_kmh):
        length = sum(element.length_m for element in group)
        pieces = math.ceil(length / highway.longest_edge_m)
        ends += [station + length * (k + 1) / pieces for k in range(pieces)]
        limits += [kmh / 3.6] * pieces
        station += length
    ends[-1] = line.length_m
    edges = tuple(f"{direction}_{k}" for k in range(len(limits)))
    return Carriageway(direction, line, edges, np.array(ends), np.array(limits))


def chord_stations(line: Alignment, start_m: float, end_m: float, reach_m: float) -> Array:
    """Stations (points,) of the polyline between two stations, for lanes up to reach_m from the line."""
    inner = line.start_m[(line.start_m > start_m + 0.5) & (line.start_m < end_m - 0.5)]
    stations = [np.array([start_m])]
    for a, b in itertools.pairwise([start_m, *inner, end_m]):
        bend = np.max(np.abs(line.pose_at(np.linspace(a + 1e-9, b - 1e-9, 9))[3]))
        radius = 1.0 / max(float(bend), 1e-6) - reach_m  # of the innermost lane
        chord = min(math.sqrt(8.0 * max(radius, 1.0) * CHORD_ERROR_M), LONGEST_CHORD_M)
        stations.append(np.linspace(a, b, math.ceil((b - a) / chord) + 1)[1:])
    return np.concatenate(stations)


def _center_offset(highway: Highway) -> float:
    return -(highway.median_m + highway.lanes * highway.lane_width_m) / 2.0


def _nodes(highway: Highway, way: Carriageway) -> list[str]:
    x, y, _, _ = way.alignment.offset_pose_at(way.start_m, _center_offset(highway))
    return [
        f'<node id="{way.direction}_n{k}" x="{x[k]:.6f}" y="{y[k]:.6f}" type="priority"/>'
        for k in range(len(x))
    ]


def _edges(highway: Highway, way: Carriageway) -> list[str]:
    center = _center_offset(highway)
    lines = []
    for k, edge in enumerate(way.edges):
        reach = highway.median_m / 2.0 + highway.lanes * highway.lane_width_m
        stations = chord_stations(way.alignment, way.start_m[k], way.start_m[k + 1], reach)
        x, y, _, _ = way.alignment.offset_pose_at(stations, center)
        shape = " ".join(f"{a:.6f},{b:.6f}" for a, b in zip(x, y, strict=True))
        lines.append(
            f'<edge id="{edge}" from="{way.direction}_n{k}" to="{way.direction}_n{k + 1}"'
            f' numLanes="{highway.lanes}" width="{highway.lane_width_m}" speed="{way.speed_limit_mps[k]:.6f}"'
            f' spreadType="center" disallow="pedestrian bicycle tram rail" shape={quoteattr(shape)}/>'
        )
    return lines


def _connections(highway: Highway, way: Carriageway) -> list[str]:
    return [
        f'<connection from="{a}" to="{b}" fromLane="{lane}" toLane="{lane}"/>'
        for a, b in itertools.pairwise(way.edges)
        for lane in range(highway.lanes)
    ]


_WRITERS = {"nod": _nodes, "edg": _edges, "con": _connections}
_FILES = {"node": "nod", "edge": "edg", "connection": "con"}  # netconvert's option: file suffix
