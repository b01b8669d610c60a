"""Road markings of SUMO's lanes: borders, their kinds, the asphalt, and the phase of the dashes.

SUMO's networks have no markings; they follow from these rules. The outer borders of a carriageway are solid,
borders between lanes of one direction dashed. Only lanes that passenger cars may use count, so a bus, bicycle
or foot lane lies behind a solid line. Junctions have no markings, except where a node merely joins one edge
to the next, lane by lane. The centre line of an undivided road is dashed if each direction has one lane, and
solid otherwise.
"""

from dataclasses import dataclass, replace

import numpy as np

from sumo_net.arrays import Array
from sumo_net.lane_graph import Connection, Edge, Lane, LaneGraph
from sumo_net.polyline import stations
from sumo_net.road_table import DASHED, MAX_BORDERS, NO_MARKING, OWN_RIGHT, SOLID

_JUNCTION_M = 6.0  # asphalt to either side of a path through a junction, at least
_KNOT_M = 20.0
_ENDS = np.array([0.0, 1.0])
_TOUCH_M = 0.6  # opposite directions this close share a centre line


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Markings along one lane; offsets left of the lane's centre, slots as in `road_table`."""

    border_offset_m: Array  # (MAX_BORDERS,)
    border_kind: Array  # (MAX_BORDERS,) int8
    road_right_m: float
    road_left_m: float
    fraction: Array  # (knots,) of the lane's length, 0 to 1
    edge_station_m: Array  # (knots,) edge-anchored: along the rightmost lane, counted through joining nodes

    def turned(self) -> "Section":
        """The same for traffic in the other direction; its stations are below 0."""
        return Section(
            -self.border_offset_m[::-1],
            self.border_kind[::-1],
            -self.road_left_m,
            -self.road_right_m,
            1.0 - self.fraction[::-1],
            -self.edge_station_m[::-1],
        )


class Markings:
    """Sections of all lanes of a network, computed on request."""

    def __init__(self, graph: LaneGraph, shoulder_right_m: float, shoulder_left_m: float) -> None:
        self.graph = graph
        self.shoulder_right_m, self.shoulder_left_m = shoulder_right_m, shoulder_left_m
        self._middle = -1 if graph.left_hand else 1  # side of the opposite direction
        self._sections: dict[str, Section] = {}
        self._anchors: dict[str, float] = {}
        self._by_nodes: dict[tuple[str, str], list[Edge]] = {}
        for edge in graph.edges.values():
            if not edge.internal:
                self._by_nodes.setdefault((edge.source, edge.target), []).append(edge)

    def section(self, lane_id: str) -> Section:
        """The section of a lane."""
        if lane_id not in self._sections:
            lane = self.graph.lanes[lane_id]
            self._sections[lane_id] = self._junction(lane) if lane.internal else self._edge(lane)
        return self._sections[lane_id]

    def joins(self, edge: str) -> str:
        """The edge that continues `edge` lane by lane through a node without other connections, or ''."""
        graph = self.graph
        lanes = graph.edges[edge].lanes
        onward = [c for lane in lanes for c in graph.onward.get(lane, []) if c.direction != "t"]
        targets = {graph.lanes[c.target].edge for c in onward}
        if len(targets) != 1:
            return ""
        after = targets.pop()
        if after == edge or len(graph.edges[after].lanes) != len(lanes):
            return ""
        for lane, other in zip(lanes, graph.edges[after].lanes, strict=True):
            if graph.lanes[lane].drivable != graph.lanes[other].drivable:
                return ""
            ways = {c.target for c in graph.onward.get(lane, []) if c.direction != "t"}
            if ways != {other} and (ways or graph.lanes[lane].drivable):
                return ""
        sources = {
            self._source_edge(c.source) for lane in graph.edges[after].lanes for c in _straight(graph, lane)
        }
        return after if sources == {edge} else ""

    def _source_edge(self, lane: str) -> str:
        for _ in range(4):  # through internal lanes to the edge before the junction
            if not self.graph.lanes[lane].internal:
                break
            before = self.graph.inward.get(lane, [])
            if not before:
                break
            lane = before[0].source
        return self.graph.lanes[lane].edge

    def _via_length(self, edge: str) -> float:
        first = self.graph.edges[edge].lanes[0]
        for connection in self.graph.onward.get(first, []):
            if connection.direction != "t" and connection.via:
                # Not SUMO's length, which is never below 0.1 m.
                return float(np.hypot(*np.diff(self.graph.lanes[connection.via].shape, axis=0).T).sum())
        return 0.0

    def _anchor(self, edge: str) -> float:
        # Edge-anchored station of an edge's start: counted on through joining nodes.
        chain: list[str] = []
        at = edge
        while at not in self._anchors:
            if at in chain:  # a ring: any edge may be its start
                self._anchors[at] = 0.0
                break
            chain.append(at)
            before = {
                self._source_edge(c.source)
                for lane in self.graph.edges[at].lanes
                for c in _straight(self.graph, lane)
            }
            source = before.pop() if len(before) == 1 else ""
            if not source or self.joins(source) != at:
                self._anchors[at] = 0.0
                break
            at = source
        for name in reversed(chain):
            if name in self._anchors:
                at = name
                continue
            length = self.graph.lanes[self.graph.edges[at].lanes[0]].length_m
            self._anchors[name] = self._anchors[at] + length + self._via_length(at)
            at = name
        return self._anchors[edge]

    def _junction(self, lane: Lane) -> Section:
        source = self._source_edge(lane.id)
        inward = self.graph.inward.get(lane.id, [])
        if inward and not self.graph.edges[source].internal and self.joins(source):
            before = self.section(inward[0].source)
            length = self._via_length(source)
            return replace(before, fraction=_ENDS, edge_station_m=before.edge_station_m[-1] + _ENDS * length)
        offset = np.full(MAX_BORDERS, np.nan)
        offset[OWN_RIGHT], offset[OWN_RIGHT + 1] = -lane.width_m / 2.0, lane.width_m / 2.0
        kind = np.full(MAX_BORDERS, NO_MARKING, np.int8)
        reach = max(_JUNCTION_M, lane.width_m)
        return Section(offset, kind, -reach, reach, _ENDS, _ENDS * lane.length_m)

    def _edge(self, lane: Lane) -> Section:
        graph, edge = self.graph, self.graph.edges[lane.edge]
        lanes = [graph.lanes[name] for name in edge.lanes]
        at = edge.lanes.index(lane.id)
        offset = np.full(MAX_BORDERS, np.nan)
        kind = np.full(MAX_BORDERS, NO_MARKING, np.int8)
        half = lane.width_m / 2.0

        slot, edge_of_asphalt = OWN_RIGHT, -half
        _put(offset, kind, slot, -half, SOLID)
        for other in reversed(lanes[:at]):
            touching = abs(edge_of_asphalt - offset[slot]) < 1e-9
            if other.drivable and touching:
                kind[slot] = DASHED
                if slot > 0:
                    slot -= 1
                    _put(offset, kind, slot, edge_of_asphalt - other.width_m, SOLID)
            if not other.walkable_only:
                edge_of_asphalt -= other.width_m
        if graph.left_hand and abs(edge_of_asphalt - offset[slot]) < 1e-9:
            edge_of_asphalt = self._add_opposite(edge, offset, kind, slot, edge_of_asphalt)
        right = edge_of_asphalt - self.shoulder_right_m

        slot, edge_of_asphalt = OWN_RIGHT + 1, half
        _put(offset, kind, slot, half, SOLID)
        for other in lanes[at + 1 :]:
            touching = abs(edge_of_asphalt - offset[slot]) < 1e-9
            if other.drivable and touching:
                kind[slot] = DASHED
                if slot + 1 < MAX_BORDERS:
                    slot += 1
                    _put(offset, kind, slot, edge_of_asphalt + other.width_m, SOLID)
            if not other.walkable_only:
                edge_of_asphalt += other.width_m
        if not graph.left_hand and abs(edge_of_asphalt - offset[slot]) < 1e-9:
            edge_of_asphalt = self._add_opposite(edge, offset, kind, slot, edge_of_asphalt)
        left = edge_of_asphalt + self.shoulder_left_m
        fraction, station = _along_reference(lane, lanes[0])
        return Section(offset, kind, right, left, fraction, self._anchor(edge.id) + station)

    def _add_opposite(self, edge: Edge, offset: Array, kind: Array, slot: int, reach: float) -> float:
        # Lanes of the opposite direction beyond the centre line; returns the offset of the asphalt's edge.
        side = self._middle
        opposite = self._opposite(edge)
        if opposite is None:
            return reach
        theirs = [self.graph.lanes[name] for name in opposite.lanes[::-side]]
        ours = sum(self.graph.lanes[name].drivable for name in edge.lanes)
        single = ours == 1 and sum(lane.drivable for lane in theirs) == 1
        kind[slot] = DASHED if single else SOLID
        driving = True
        for lane in theirs:
            driving = driving and lane.drivable
            if driving and 0 <= slot + side < MAX_BORDERS:
                if kind[slot] == SOLID and lane is not theirs[0]:
                    kind[slot] = DASHED
                slot += side
                _put(offset, kind, slot, reach + side * lane.width_m, SOLID)
            if not lane.walkable_only:
                reach += side * lane.width_m
        return reach

    def _opposite(self, edge: Edge) -> Edge | None:
        innermost = -1 if self._middle > 0 else 0
        ours = self.graph.lanes[edge.lanes[innermost]]
        middle = len(ours.shape) // 2
        a, b = ours.shape[middle - 1], ours.shape[middle]
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        point = (a + b) / 2.0 + self._middle * ours.width_m / 2.0 * np.array([-along[1], along[0]])
        for other in self._by_nodes.get((edge.target, edge.source), []):
            theirs = self.graph.lanes[other.lanes[innermost]]
            if abs(_distance(point, theirs.shape) - theirs.width_m / 2.0) < _TOUCH_M:
                return other
        return None


def _straight(graph: LaneGraph, lane: str) -> list[Connection]:
    return [c for c in graph.inward.get(lane, []) if c.direction != "t"]


def _along_reference(lane: Lane, reference: Lane) -> tuple[Array, Array]:
    # Stations on the edge's rightmost lane abreast of points about every 20 m of a lane: in a curve the
    # lanes differ in length, but the dashes between them are the same.
    at = stations(lane.shape)
    fraction = np.linspace(0.0, 1.0, max(int(at[-1] / _KNOT_M), 1) + 1)
    points = np.column_stack([np.interp(fraction * at[-1], at, lane.shape[:, k]) for k in (0, 1)])
    a, d = reference.shape[:-1], np.diff(reference.shape, axis=0)
    length = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-9)
    start = np.concatenate([[0.0], np.cumsum(length)])
    away = points[:, None] - a
    t = (away * d).sum(2) / length**2
    low, high = np.zeros(len(a)), np.ones(len(a))
    low[0], high[-1] = -np.inf, np.inf  # an edge's ends may be cut obliquely
    t = np.clip(t, low, high)
    nearest = np.argmin(np.hypot(*(away - t[:, :, None] * d).transpose(2, 0, 1)), axis=1)
    rows = np.arange(len(points))
    station = np.maximum.accumulate(start[nearest] + t[rows, nearest] * length[nearest])
    return fraction, station * (reference.length_m / start[-1])


def _put(offset: Array, kind: Array, slot: int, at_m: float, what: int) -> None:
    offset[slot], kind[slot] = at_m, what


def _distance(point: Array, shape: Array) -> float:
    a, d = shape[:-1], np.diff(shape, axis=0)
    t = np.clip(((point - a) * d).sum(1) / np.maximum((d * d).sum(1), 1e-12), 0.0, 1.0)
    return float(np.min(np.hypot(*(a + t[:, None] * d - point).T)))
