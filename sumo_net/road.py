"""Smooth lane paths from SUMO lane shapes: pose, curvature and borders at a station.

`RoadNetwork.path` gives the path of a lane and the route ahead, fitted at the first request and kept in
`RoadNetwork.table`, on which the kernels of `road_kernels` work.
"""

from pathlib import Path

import numpy as np

from sumo_net import lane_chain, lane_graph, road_fit
from sumo_net.arrays import Array
from sumo_net.lane_chain import Piece
from sumo_net.lane_graph import AGAINST, LaneGraph, NetworkError
from sumo_net.network import BuiltNetwork, Carriageway
from sumo_net.road_fit import SmoothPath, cut
from sumo_net.road_marking import Markings
from sumo_net.road_store import RoadStore
from sumo_net.road_table import (
    AHEAD_M,
    DASHED,
    MAX_BORDERS,
    NO_MARKING,
    OWN_RIGHT,
    SOLID,
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
    "NetworkError",
    "RoadAhead",
    "RoadNetwork",
    "RoadTable",
]

_REMEMBERED_ROUTES = 50_000  # bounds the cache of routes; paths themselves are kept
_SHOULDER_M = 0.5  # asphalt outside the outer borders of a user's network


class RoadNetwork:
    """The smooth roads of one SUMO network."""

    def __init__(
        self,
        graph: LaneGraph,
        shoulder_right_m: float = _SHOULDER_M,
        shoulder_left_m: float = _SHOULDER_M,
        built: BuiltNetwork | None = None,
    ) -> None:
        self.graph = graph
        self.shoulder_right_m, self.shoulder_left_m = shoulder_right_m, shoulder_left_m
        self._markings = Markings(graph, shoulder_right_m, shoulder_left_m)
        self._store = RoadStore()
        self._errors: list[float] = []
        self._by_lanes: dict[tuple[tuple[Piece, ...], int, bool], int] = {}
        self._by_route: dict[tuple[str, tuple[str, ...], str], int] = {}
        self._ways: dict[str, Carriageway] = {}
        self._built = built
        if built is not None:
            self._ways = {edge: way for way in built.carriageways for edge in way.edges}

    @classmethod
    def from_net_file(cls, path: Path) -> "RoadNetwork":
        """Roads fitted to the lane shapes of a `.net.xml` (or `.net.xml.gz`).

        Raises NetworkError (a ValueError) that names the file: missing, malformed, no lane for cars.
        """
        return cls(lane_graph.read(path))

    @classmethod
    def from_highway(cls, built: BuiltNetwork) -> "RoadNetwork":
        """The built-in highway: paths are taken from its exact alignment, not fitted."""
        highway = built.highway
        graph = lane_graph.read(built.net_file)
        return cls(graph, highway.shoulder_right_m, highway.shoulder_left_m, built)

    @property
    def table(self) -> RoadTable:
        """All paths so far. Read it again after each call of `path`."""
        return self._store.table

    def drivable_edges(self) -> list[str]:
        """Edges with a lane for passenger cars."""
        return self.graph.drivable_edges()

    def path(self, lane_id: str, route_ahead: tuple[str, ...] = (), came_from: str = "") -> int:
        """Number of the path of a lane: the lane, the lanes behind it and those ahead along the route.

        route_ahead: edges from the present one on. came_from: the lane the vehicle was on before, where
        known; it selects the lanes behind. A lane of `LaneGraph.against` is driven against its direction,
        and so are the lanes before and after it, straight on. Raises KeyError for an unknown lane,
        NetworkError for one shorter than 1 cm.
        """
        asked = (lane_id, route_ahead, came_from)
        if asked not in self._by_route:
            if len(self._by_route) >= _REMEMBERED_ROUTES:
                self._by_route.clear()
            against = lane_id.endswith(AGAINST)
            if against:
                lane = lane_id.removesuffix(AGAINST)
                pieces, own = lane_chain.chain(
                    self.graph, lane, (), "", lane_chain.AHEAD_M, lane_chain.BEHIND_M
                )
            else:
                pieces, own = lane_chain.chain(self.graph, lane_id, route_ahead, came_from)
            key = pieces, own, against
            if key not in self._by_lanes:
                self._by_lanes[key] = self._add(*key)
            self._by_route[asked] = self._by_lanes[key]
        return self._by_route[asked]

    def shape_fit_error(self, path: int) -> float:
        """Largest lateral distance between the path and SUMO's lane shapes, m (0 for the exact highway)."""
        return self._errors[path]

    def _add(self, pieces: tuple[Piece, ...], own: int, against: bool) -> int:
        lanes = [self.graph.lanes[piece.lane] for piece in pieces]
        smooth = self._exact(pieces) if self._ways else None
        if smooth is None:
            parts = zip(lanes, pieces, strict=True)
            shapes = [cut(lane.shape, piece.begin, piece.end) for lane, piece in parts]
            try:
                smooth = road_fit.fit(shapes, min(0.5 * 10.0**-self.graph.decimals, 0.05))
            except ValueError as error:
                raise NetworkError(f"{self.graph.file}: lane '{lanes[own].id}': {error}") from None
        self._errors.append(smooth.error_m)
        sections = [self._markings.section(lane.id) for lane in lanes]
        length_m = lanes[own].length_m
        if against:
            smooth, own = smooth.turned(), len(lanes) - 1 - own
            pieces = tuple(piece.turned() for piece in reversed(pieces))
            sections = [section.turned() for section in reversed(sections)]
        return self._store.append(smooth, pieces, sections, own, length_m)

    def _exact(self, pieces: tuple[Piece, ...]) -> SmoothPath | None:
        # From the highway's alignment; None for pieces that are not of one lane in one direction.
        assert self._built is not None
        lanes = [self.graph.lanes[piece.lane] for piece in pieces]
        on_edges = [lane for lane in lanes if not lane.internal]
        if len({lane.index for lane in on_edges}) != 1 or on_edges[0].edge not in self._ways:
            return None
        way = self._ways[on_edges[0].edge]
        offset = self._built.highway.lane_offset_m(on_edges[0].index)
        nodes = way.alignment.offset_length(way.start_m, offset)
        starts, ends = np.empty(len(lanes)), np.empty(len(lanes))
        at = way.edges.index(on_edges[0].edge)
        for k, (lane, piece) in enumerate(zip(lanes, pieces, strict=True)):
            start = nodes[at]
            if not lane.internal:  # SUMO's lanes inside the nodes have no length here
                at += 1
            starts[k] = start + piece.begin * (nodes[at] - start)
            ends[k] = start + piece.end * (nodes[at] - start)
        length = float(ends[-1] - starts[0])
        count = max(round(length / road_fit.SPACING_M), 2)
        s = way.alignment.station_of_offset_length(starts[0] + np.linspace(0.0, length, count + 1), offset)
        x, y, heading, curvature = way.alignment.offset_pose_at(s, offset)
        return SmoothPath(length / count, x, y, heading, curvature, starts - starts[0], ends - starts[0], 0.0)
