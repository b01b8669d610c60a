"""Networks of many shapes, made with netgenerate and netconvert, with traffic of all classes on them.

Features that a user's network may have and the built-in highway does not: junctions, roundabouts, ramps,
lanes that end, unusual widths, left-hand traffic, geographic projection, tracks, pavements, hairpins, lanes
of a few centimetres.
"""

import math
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from sumo_net import lane_graph

CLASSES = {  # share of trips by SUMO's vehicle class
    "passenger": 0.5,
    "truck": 0.08,
    "bus": 0.08,
    "motorcycle": 0.08,
    "bicycle": 0.08,
    "emergency": 0.04,
    "taxi": 0.05,
    "tram": 0.05,
    "moped": 0.04,
}
ASKING = ("bus", "truck", "motorcycle", "bicycle", "tram")  # types other than cars that request equipment


def netgenerate(*words: str) -> Callable[[Path], None]:
    """A function that makes a network with netgenerate."""

    def make(file: Path) -> None:
        _run("netgenerate", *words, "--seed", "7", "-o", str(file))

    return make


def netconvert(nodes: Sequence[str], edges: Sequence[str], *words: str) -> Callable[[Path], None]:
    """A function that makes a network from plain nodes and edges."""

    def make(file: Path) -> None:
        for kind, lines in (("node", nodes), ("edge", edges)):
            text = "\n".join([f"<{kind}s>", *lines, f"</{kind}s>"])
            file.with_suffix(f".{kind}.xml").write_text(text, encoding="utf-8")
        plain = ["-n", str(file.with_suffix(".node.xml")), "-e", str(file.with_suffix(".edge.xml"))]
        _run("netconvert", *plain, *words, "-o", str(file))

    return make


def _run(program: str, *words: str) -> None:
    import sumo

    command = [str(Path(sumo.SUMO_HOME) / "bin" / program), *words, "--xml-validation", "never"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")


def _node(name: str, x: float, y: float, more: str = "") -> str:
    return f'<node id="{name}" x="{x:.6f}" y="{y:.6f}" {more}/>'


def _edge(name: str, source: str, target: str, lanes: int = 1, more: str = "", inside: str = "") -> str:
    return (
        f'<edge id="{name}" from="{source}" to="{target}" numLanes="{lanes}" speed="13.9" {more}>'
        f"{inside}</edge>"
    )


def _both(name: str, source: str, target: str, lanes: int = 1, more: str = "") -> list[str]:
    return [_edge(name, source, target, lanes, more), _edge(f"{name}_back", target, source, lanes, more)]


def _roundabout(*words: str) -> Callable[[Path], None]:
    angle = [math.tau * k / 4 for k in range(4)]
    nodes = [_node(f"r{k}", 20 * math.cos(a), 20 * math.sin(a)) for k, a in enumerate(angle)]
    nodes += [_node(f"o{k}", 180 * math.cos(a), 180 * math.sin(a)) for k, a in enumerate(angle)]
    clockwise = "--lefthand" in words
    edges = []
    for k, a in enumerate(angle):
        ends = (f"r{(k + 1) % 4}", f"r{k}") if clockwise else (f"r{k}", f"r{(k + 1) % 4}")
        fractions = np.linspace(0, math.tau / 4, 9)
        line = [(20 * math.cos(a + f), 20 * math.sin(a + f)) for f in fractions]
        shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in (line[::-1] if clockwise else line))
        edges.append(_edge(f"ring{k}", *ends, 2, f'priority="9" shape="{shape}"'))
        edges += _both(f"arm{k}", f"o{k}", f"r{k}")
    return netconvert(nodes, edges, "--roundabouts.guess", *words)


def _odd_widths() -> Callable[[Path], None]:
    nodes = [_node("a", 0, 0), _node("b", 250, 0), _node("c", 500, 30), _node("d", 750, 30)]
    widths = {"ab": (2.4, 5.5, 3.0), "bc": (1.9, 3.2), "cd": (8.0,)}
    edges = []
    for name, lanes in widths.items():
        inside = "".join(f'<lane index="{k}" width="{w}"/>' for k, w in enumerate(lanes))
        edges.append(_edge(name, name[0], name[1], len(lanes), inside=inside))
        edges.append(_edge(f"{name}_back", name[1], name[0], len(lanes), inside=inside))
    return netconvert(nodes, edges)


def _ramps() -> Callable[[Path], None]:
    nodes = [_node("a", 0, 0), _node("b", 400, 0), _node("c", 700, 0), _node("d", 1000, 0, 'type="zipper"')]
    nodes += [_node("e", 1300, 0), _node("on", 150, -120), _node("off", 1000, -120), _node("f", 1400, -60)]
    edges = [_edge("ab", "a", "b", 2), _edge("bc", "b", "c", 3), _edge("cd", "c", "d", 3)]
    edges += [
        _edge("de", "d", "e", 1),
        _edge("on", "on", "b"),
        _edge("off", "c", "off"),
        _edge("ef", "e", "f"),
    ]
    return netconvert(nodes, edges, "--ramps.guess", "--default.speed", "36")


def _hairpins() -> Callable[[Path], None]:
    points = [(0.0, 0.0)]
    for k in range(6):  # serpentines with radii from 12 m down to 2 m, then a kink that turns back
        radius, y, side = 12.0 - 2 * k, points[-1][1], 1 if k % 2 == 0 else -1
        x = 100.0 if side > 0 else 0.0
        turn = np.linspace(-math.pi / 2, math.pi / 2, 7)
        points += [(x + side * radius * math.cos(t), y + radius + radius * math.sin(t)) for t in turn]
    points += [(60.0, points[-1][1] + 1.0), (0.0, points[-1][1] + 2.0)]
    shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    nodes = [_node("a", *points[0]), _node("b", *points[-1]), _node("c", -150, points[-1][1])]
    edges = [_edge("up", "a", "b", 1, f'shape="{shape}"'), *_both("out", "b", "c")]
    return netconvert(nodes, edges)


def _short() -> Callable[[Path], None]:
    at = [0.0, 120.0, 120.4, 121.0, 123.0, 180.0, 180.2, 300.0]
    nodes = [_node(f"n{k}", x, (k % 2) * 0.3) for k, x in enumerate(at)]
    edges = [line for k in range(len(at) - 1) for line in _both(f"e{k}", f"n{k}", f"n{k + 1}", 2)]
    return netconvert(nodes, edges)


def _geographic() -> Callable[[Path], None]:
    nodes = [_node("a", 11.35, 44.49), _node("b", 11.354, 44.491), _node("c", 11.357, 44.489)]
    edges = [*_both("ab", "a", "b", 2), *_both("bc", "b", "c", 1)]
    return netconvert(nodes, edges, "--proj.utm", "--offset.disable-normalization")


def _tracks() -> Callable[[Path], None]:
    nodes = [_node(name, x, y) for name, x, y in (("a", 0, 0), ("b", 200, 0), ("c", 400, 0), ("d", 200, 150))]
    rails = (
        '<lane index="0" allow="pedestrian" width="2"/><lane index="1" allow="bicycle" width="1.2"/>'
        '<lane index="2" disallow="pedestrian"/><lane index="3" allow="tram" width="3"/>'
    )
    edges = [_edge(f"{a}{b}", a, b, 4, inside=rails) for a, b in ("ab", "ba", "bc", "cb")]
    edges += [*_both("bd", "b", "d", 1, 'allow="bus bicycle"')]
    return netconvert(nodes, edges, "--crossings.guess", "--walkingareas")


def _wide_junction() -> Callable[[Path], None]:
    ends = {"w": (-250, 0), "e": (250, 0), "s": (0, -250), "n": (0, 250)}
    nodes = [_node(name, *at) for name, at in ends.items()]
    nodes.append(_node("m", 0, 0, 'radius="110" type="traffic_light_unregulated"'))
    return netconvert(nodes, [line for name in ends for line in _both(f"{name}m", name, "m")])


_CITY = ("--grid", "--grid.number", "3", "--grid.length", "110")
NETWORKS: dict[str, Callable[[Path], None]] = {
    "grid": netgenerate(*_CITY, "-L", "2", "-j", "traffic_light"),
    "spider": netgenerate("--spider", "--spider.arm-number", "5", "--spider.circle-number", "3", "-L", "2"),
    "random": netgenerate("--rand", "--rand.iterations", "40", "--random-lanenumber", "-L", "3"),
    "random_acute": netgenerate("--rand", "--rand.iterations", "30", "--rand.min-angle", "5"),
    "roundabout": _roundabout(),
    "roundabout_left": _roundabout("--lefthand"),
    "left_hand": netgenerate(*_CITY, "-L", "2", "--lefthand"),
    "one_lane": netgenerate(*_CITY, "-L", "1", "--default.lanewidth", "2.6", "-j", "right_before_left"),
    "odd_widths": _odd_widths(),
    "geographic": _geographic(),
    "ramps": _ramps(),
    "hairpins": _hairpins(),
    "short": _short(),
    "tracks": _tracks(),
    "wide_junction": _wide_junction(),
    "no_internal": netgenerate(*_CITY, "-L", "2", "--no-internal-links"),
    "u_turns": netgenerate(
        "--spider", "--spider.arm-number", "3", "--spider.circle-number", "1", "--spider.omit-center"
    ),
    "pavements": netgenerate(
        *_CITY, "-L", "2", "--sidewalks.guess", "--bikelanes.guess", "--crossings.guess"
    ),
}


def write_traffic(net_file: Path, routes: Path, duration_s: float, trips: int = 60, seed: int = 1) -> None:
    """Trips of all classes between random edges, stops beside and on the road, jumps, and persons.

    SUMO computes the routes; trips without a route are left out (`--ignore-route-errors`).
    """
    graph = lane_graph.read(net_file)
    draw = np.random.default_rng(seed)
    lines = ["<routes>"]
    for name in CLASSES:
        asks = '<param key="has.adas.device" value="true"/>' if name in ASKING else ""
        lines.append(f'<vType id="{name}" vClass="{name}">{asks}</vType>')
    edges = graph.drivable_edges()
    everywhere = [edge.id for edge in graph.edges.values() if not edge.internal]
    kinds = draw.choice(list(CLASSES), trips, p=list(CLASSES.values()))
    for k, depart in enumerate(np.sort(draw.uniform(0, duration_s * 0.6, trips))):
        kind = str(kinds[k])
        among = everywhere if kind in ("tram", "bus", "bicycle") else edges
        source, target = draw.choice(among, 2)
        stop = ""
        if k % 7 == 3:
            lane = graph.edges[str(target)].lanes[0]
            parks = ("true", "false", "opportunistic")[k % 3]
            jump = ' jump="2"' if k % 2 else ""
            stop = f'<stop lane={quoteattr(lane)} duration="3" parking="{parks}"{jump}/>'
        lines.append(
            f'<trip id="{kind}_{k}" type="{kind}" depart="{depart:.1f}" from={quoteattr(str(source))}'
            f' to={quoteattr(str(target))} departLane="free" departSpeed="max" departPos="random_free">'
            f"{stop}</trip>"
        )
    lines.append("</routes>")
    routes.write_text("\n".join(lines), encoding="utf-8")


def write_scenario(name: str, directory: Path, duration_s: float = 30.0, trips: int = 60) -> Path:
    """Make the network `name` and its traffic in `directory`; returns the .sumocfg. Jams end in teleports."""
    directory.mkdir(parents=True, exist_ok=True)
    net_file, routes = directory / f"{name}.net.xml", directory / f"{name}.rou.xml"
    NETWORKS[name](net_file)
    write_traffic(net_file, routes, duration_s, trips)
    options = {
        "net-file": net_file.name,
        "route-files": routes.name,
        "step-length": "0.1",
        "ignore-route-errors": "true",
        "time-to-teleport": "5",
        "collision.action": "teleport",
    }
    file = directory / f"{name}.sumocfg"
    body = "".join(f'<{option} value="{value}"/>' for option, value in options.items())
    file.write_text(f"<configuration>{body}</configuration>", encoding="utf-8")
    return file
