"""Lanes and connections of a SUMO network file (`.net.xml`, plain or gzip)."""

import gzip
import math
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

import numpy as np

from sumo_net.arrays import Array
from sumo_net.settings import InputError
from sumo_net.xml_input import Bounded

MOST_LENGTH_M = 200_000.0  # of a lane's shape: it is sampled every half metre
_MOST_STRETCH = 100.0  # length of a shape over the lane's stated length, for shapes above 1 km
DEFAULT_WIDTH_M = 3.2  # SUMO's, where a lane gives none
AGAINST = " against"  # ends the names of lanes driven against their direction; no SUMO id has a space
_STRAIGHT_FIRST = {"s": 0, "l": 1, "r": 1, "L": 1, "R": 1, "t": 9}  # rank of a connection's direction


class NetworkError(InputError):
    """A network file that cannot be used; the message names the file."""


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """One SUMO lane."""

    id: str
    edge: str
    index: int  # 0 rightmost, also in left-hand networks, where SUMO counts from the left
    length_m: float  # SUMO's, which may differ from the shape's
    width_m: float
    speed_limit_mps: float
    drivable: bool  # passenger cars may use it in its direction
    walkable_only: bool  # sidewalk or crossing
    internal: bool
    shape: Array  # (points, 2)


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection between two lanes; `via` is the internal lane between them, or ''."""

    source: str
    target: str
    via: str
    direction: str


@dataclass(slots=True)
class Edge:
    """One SUMO edge; lanes from right to left."""

    id: str
    source: str  # node, '' for internal edges
    target: str
    internal: bool
    lanes: list[str] = field(default_factory=list)


@dataclass(slots=True)
class LaneGraph:
    """Edges, lanes and connections of a network."""

    file: Path
    edges: dict[str, Edge] = field(default_factory=dict)
    lanes: dict[str, Lane] = field(default_factory=dict)
    onward: dict[str, list[Connection]] = field(default_factory=dict)  # by source lane
    inward: dict[str, list[Connection]] = field(default_factory=dict)  # by target lane, and by internal lane
    # by lane that traffic of the opposite direction may overtake on: the lane of `lanes` that it is to them
    against: dict[str, str] = field(default_factory=dict)
    decimals: int = 2  # of the shapes' coordinates
    left_hand: bool = False  # traffic keeps left

    def drivable_edges(self) -> list[str]:
        """Edges (not internal) with a lane for passenger cars, in the file's order."""
        return [
            edge.id
            for edge in self.edges.values()
            if not edge.internal and any(self.lanes[lane].drivable for lane in edge.lanes)
        ]


def read(file: Path) -> LaneGraph:
    """Read a network. Raises NetworkError: no such file, not XML, XML entities, no lane for cars."""
    reader = _Reader(LaneGraph(file))
    parser = expat.ParserCreate()
    parser.StartElementHandler = reader.start
    parser.EntityDeclHandler = reader.refuse_entity
    try:
        with file.open("rb") as raw:
            zipped = raw.read(2) == b"\x1f\x8b"
        with gzip.open(file) if zipped else file.open("rb") as text:
            parser.ParseFile(Bounded(text, file))
    except FileNotFoundError:
        raise NetworkError(f"{file}: no such file") from None
    except (OSError, EOFError, zlib.error) as error:
        raise NetworkError(f"{file}: cannot be read ({error})") from None
    except expat.ExpatError as error:
        raise NetworkError(f"{file}: is not well-formed XML: {error}") from None
    except (KeyError, ValueError) as error:
        if isinstance(error, NetworkError):
            raise
        what = f"attribute {error} is missing" if isinstance(error, KeyError) else str(error)
        raise NetworkError(f"{file}: line {parser.CurrentLineNumber}: {what}") from None
    return reader.finished()


class _Reader:
    def __init__(self, graph: LaneGraph) -> None:
        self.graph = graph
        self.edge: Edge | None = None
        self.root = ""
        self.connections: list[dict[str, str]] = []
        self.neighbours: list[tuple[str, str]] = []  # lane, and the opposite lane that it may overtake on
        self.decimals = 0

    def refuse_entity(self, name: str, *_: object) -> None:
        raise NetworkError(f"{self.graph.file}: declares the XML entity '{name}': not accepted")

    def start(self, tag: str, given: dict[str, str]) -> None:
        if not self.root:
            self.root = tag
            if tag != "net":
                raise NetworkError(
                    f"{self.graph.file}: is not a SUMO network: its root is <{tag}>, not <net>"
                )
            self.graph.left_hand = given.get("lefthand", "") in ("true", "1")
        elif tag == "edge":
            internal = given.get("function", "") != "" and given["id"].startswith(":")
            self.edge = Edge(given["id"], given.get("from", ""), given.get("to", ""), internal)
            self.graph.edges[self.edge.id] = self.edge
        elif tag == "lane" and self.edge is not None:
            self._lane(self.edge, given)
        elif tag == "neigh" and self.edge is not None and self.edge.lanes:
            self.neighbours.append((self.edge.lanes[-1], given["lane"]))
        elif tag == "connection":
            self.connections.append(given)

    def _lane(self, edge: Edge, given: dict[str, str]) -> None:
        points = [point.split(",")[:2] for point in given["shape"].split()]
        shape = np.array(points, dtype=float).reshape(-1, 2)
        if len(shape) < 2 or not np.isfinite(shape).all():
            raise ValueError(f"lane '{given['id']}' has a shape of fewer than two points, or not finite")
        length = float(given["length"])
        width = float(given.get("width", DEFAULT_WIDTH_M))
        if not (length > 0 and math.isfinite(length)):
            raise ValueError(f"lane '{given['id']}': length = {length}: must be above 0")
        drawn = float(np.hypot(*np.diff(shape, axis=0).T).sum())
        if not drawn <= min(MOST_LENGTH_M, max(1000.0, _MOST_STRETCH * length)):
            raise ValueError(f"lane '{given['id']}' has a shape of {drawn:.0f} m, a length of {length:g} m")
        if not (width >= 0 and math.isfinite(width)):
            raise ValueError(f"lane '{given['id']}': width = {width}: must not be below 0")
        if len(self.graph.lanes) < 1000:
            self.decimals = max(
                [self.decimals, *(len(c.partition(".")[2]) for point in points[:20] for c in point)]
            )
        lane = Lane(
            id=given["id"],
            edge=edge.id,
            index=int(given["index"]),
            length_m=length,
            width_m=width,
            speed_limit_mps=float(given.get("speed", 13.89)),
            drivable=_allows("passenger", given) and width > 0,
            walkable_only=given.get("allow", "").split() == ["pedestrian"],
            internal=edge.internal,
            shape=shape,
        )
        self.graph.lanes[lane.id] = lane
        edge.lanes.append(lane.id)

    def _against(self, own: str, other: str) -> None:
        graph = self.graph
        if other not in graph.lanes:
            raise NetworkError(f"{graph.file}: lane '{own}' has an unknown opposite lane, '{other}'")
        if not graph.lanes[other].drivable:
            return
        name, beside = other + AGAINST, graph.lanes[own]
        graph.against[other] = name
        graph.lanes[name] = replace(
            graph.lanes[other],
            id=name,
            edge=beside.edge,
            index=beside.index + (-1 if graph.left_hand else 1),
            drivable=False,  # of itself: no route leads there
            shape=graph.lanes[other].shape[::-1],
        )

    def finished(self) -> LaneGraph:
        graph = self.graph
        for edge in graph.edges.values():
            edge.lanes.sort(key=lambda lane: graph.lanes[lane].index, reverse=graph.left_hand)
            for index, lane in enumerate(edge.lanes if graph.left_hand else ()):
                graph.lanes[lane] = replace(graph.lanes[lane], index=index)
        for own, other in self.neighbours:
            self._against(own, other)
        for given in self.connections:
            source = f"{given.get('from')}_{given.get('fromLane')}"
            target = f"{given.get('to')}_{given.get('toLane')}"
            via = given.get("via", "")
            if source not in graph.lanes or target not in graph.lanes or (via and via not in graph.lanes):
                raise NetworkError(f"{graph.file}: a connection names unknown lanes: {source} to {target}")
            connection = Connection(source, target, via, given.get("dir", "s"))
            graph.onward.setdefault(source, []).append(connection)
            # The predecessor of a lane is the internal lane before it; of an internal lane, the lane before.
            graph.inward.setdefault(via or target, []).append(connection)
        for connections in graph.onward.values():
            connections.sort(key=lambda c: (_STRAIGHT_FIRST.get(c.direction, 1), c.target))
        for connections in graph.inward.values():
            connections.sort(key=lambda c: (_STRAIGHT_FIRST.get(c.direction, 1), c.source))
        graph.decimals = self.decimals
        if not graph.drivable_edges():
            raise NetworkError(f"{graph.file}: has no lane that passenger cars may use")
        return graph


def _allows(vehicle_class: str, given: dict[str, str]) -> bool:
    if "allow" in given:
        allowed = given["allow"].split()
        return vehicle_class in allowed or "all" in allowed
    refused = given.get("disallow", "").split()
    return vehicle_class not in refused and "all" not in refused
