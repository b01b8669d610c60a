"""Which lanes a path runs through: behind a lane, and ahead of it along a route."""

from typing import NamedTuple

from sumo_net.lane_graph import Connection, LaneGraph

BEHIND_M = 100.0  # the fit's end effects have faded 60 m behind the lane
AHEAD_M = 260.0  # and 220 m beyond it
_MOST_LANES = 1000
_STANDS_M = 10.0  # so long may a vehicle be that begins at the end of a lane


class Piece(NamedTuple):
    """The part of a lane that a path uses, as fractions of the lane."""

    lane: str
    begin: float
    end: float

    def turned(self) -> "Piece":
        """The same for traffic in the other direction."""
        return Piece(self.lane, 1.0 - self.end, 1.0 - self.begin)


def chain(
    graph: LaneGraph,
    lane: str,
    route_ahead: tuple[str, ...],
    came_from: str,
    behind_m: float = BEHIND_M,
    ahead_m: float = AHEAD_M,
) -> tuple[tuple[Piece, ...], int]:
    """All pieces of the path of `lane` in driving order, and which of them is the lane's own.

    The outermost lanes are cut to `behind_m` and `ahead_m`.
    """
    behind = lanes_behind(graph, lane, came_from, behind_m)
    ahead = lanes_ahead(graph, lane, route_ahead, ahead_m)
    pieces = [Piece(name, 0.0, 1.0) for name in (*behind, lane, *ahead)]
    length = {name: graph.lanes[name].length_m for name in (*behind, *ahead)}
    if behind:
        over = sum(length[name] for name in behind) - behind_m
        pieces[0] = pieces[0]._replace(begin=max(0.0, over / length[behind[0]]))
    if ahead:
        over = sum(length[name] for name in ahead) - ahead_m
        pieces[-1] = pieces[-1]._replace(end=min(1.0, 1.0 - over / length[ahead[-1]]))
    return tuple(pieces), len(behind)


def lanes_behind(graph: LaneGraph, lane: str, came_from: str = "", reach_m: float = BEHIND_M) -> list[str]:
    """Lanes that lead to `lane`, in driving order, over `reach_m` or more where the road is long enough.

    `came_from`: the lane the vehicle was on before. Without it, the vehicle begins here and has turned round
    no corner: only ways that lead straight on, but for those that it stands on itself.
    """
    found: list[str] = []
    length, at, own_m = 0.0, lane, graph.lanes[lane].length_m
    while length < reach_m and len(found) < _MOST_LANES:
        inward = [c for c in graph.inward.get(at, []) if c.direction != "t" or c.source == came_from]
        if not came_from and not graph.lanes[at].internal and own_m + length > _STANDS_M:
            inward = [c for c in inward if c.direction == "s"]
        if not inward:
            break
        at = min(inward, key=lambda c: _strangeness(graph, c, came_from)).source
        found.append(at)
        length += graph.lanes[at].length_m
    return found[::-1]


def _strangeness(graph: LaneGraph, connection: Connection, came_from: str) -> tuple[bool, bool]:
    # Ties go to the straightest connection: the graph sorts them so.
    source = connection.source
    before = [source, *(c.source for c in graph.inward.get(source, []))]
    return came_from not in before, not graph.lanes[source].drivable


def lanes_ahead(
    graph: LaneGraph, lane: str, route_ahead: tuple[str, ...], reach_m: float = AHEAD_M
) -> list[str]:
    """Lanes that follow `lane` along the route's edges, over `reach_m` or more where the road goes on.

    After the route's end, or where the lane does not lead to its next edge, the straightest way on is taken.
    """
    found: list[str] = []
    length, at = 0.0, lane
    edges = list(route_ahead)
    edge = graph.lanes[lane].edge
    if edge in edges:
        edges = edges[edges.index(edge) + 1 :]
    elif not graph.lanes[lane].internal:
        edges = []  # the vehicle is off its route
    while length < reach_m and len(found) < _MOST_LANES:
        onward = [c for c in graph.onward.get(at, []) if graph.lanes[c.target].drivable]
        if not onward:
            break
        # On a junction the route may still begin with the edge before it.
        targets = {graph.lanes[c.target].edge for c in onward}
        if graph.lanes[at].internal and len(edges) > 1 and edges[0] not in targets and edges[1] in targets:
            edges = edges[1:]
        wanted = edges[0] if edges else ""
        if wanted not in targets:
            edges, wanted = [], ""
        after = edges[1] if len(edges) > 1 else ""
        best = min(onward, key=lambda c: _detour(graph, c, wanted, after))
        at = best.via or best.target
        found.append(at)
        if not graph.lanes[at].internal:
            edges = edges[1:]
        length += graph.lanes[at].length_m
    return found


def _detour(graph: LaneGraph, connection: Connection, wanted: str, after: str) -> tuple[bool, bool, bool]:
    target = graph.lanes[connection.target]
    leads_on = not after or any(
        graph.lanes[c.target].edge == after for c in graph.onward.get(connection.target, [])
    )
    return wanted not in ("", target.edge), not leads_on, connection.direction == "t"
