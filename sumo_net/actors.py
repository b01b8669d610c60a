"""A scenario's actors as vehicles of a SUMO route file."""

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from sumo_net.demand import read_net
from sumo_net.network import BuiltNetwork
from sumo_net.script import Actor
from sumo_net.settings import SettingsError


def actor_lines(actors: Sequence[Actor], network: BuiltNetwork | Path, begin_s: float) -> list[str]:
    """One <vehicle> per actor, by time of departure; `begin_s`: SUMO's time when recording begins.

    Raises SettingsError.
    """
    lines = []
    for actor in sorted(actors, key=lambda one: one.at_s):
        edges, along = (
            _on_highway(actor, network) if isinstance(network, BuiltNetwork) else _on_net(actor, network)
        )
        lines.append(
            f'<vehicle id={quoteattr(actor.id)} type="{actor.body}" depart="{begin_s + actor.at_s:.1f}"'
            f' departLane="{actor.lane}" departPos="{along:.3f}" departSpeed="{actor.speed_mps:.4f}"'
            f' speedFactor="1" insertionChecks="none"><route edges={quoteattr(" ".join(edges))}/>'
            f'<param key="adas.equipped" value="{str(actor.equipped).lower()}"/></vehicle>'
        )
    return lines


def _on_highway(actor: Actor, built: BuiltNetwork) -> tuple[tuple[str, ...], float]:
    if actor.edges:
        raise SettingsError(f"actor '{actor.id}': edges: not allowed on the built-in highway; set direction")
    if actor.lane >= built.highway.lanes:
        raise SettingsError(f"actor '{actor.id}': lane = {actor.lane}: must be below {built.highway.lanes}")
    way = next(way for way in built.carriageways if way.direction == actor.direction)
    ends = way.alignment.offset_length(way.start_m, built.highway.lane_offset_m(actor.lane))
    if not 5.0 <= actor.position_m < ends[-1] - 1.0:
        raise SettingsError(
            f"actor '{actor.id}': position_m = {actor.position_m:g}: allowed are 5 to {ends[-1] - 1.0:.0f}"
        )
    edge = int(np.searchsorted(ends, actor.position_m, side="right")) - 1
    return way.edges[edge:], actor.position_m - float(ends[edge])


def _on_net(actor: Actor, net_file: Path) -> tuple[tuple[str, ...], float]:
    net = read_net(net_file)
    if not actor.edges:
        raise SettingsError(f"actor '{actor.id}': needs edges = [...], its route on {net_file.name}")
    for name in actor.edges:
        if not net.hasEdge(name):
            raise SettingsError(f"actor '{actor.id}': edges: {net_file.name} has no edge '{name}'")
    first = net.getEdge(actor.edges[0])
    if actor.lane >= first.getLaneNumber():
        raise SettingsError(
            f"actor '{actor.id}': lane = {actor.lane}: must be below {first.getLaneNumber()} on that edge"
        )
    if actor.position_m >= first.getLength():
        raise SettingsError(
            f"actor '{actor.id}': position_m = {actor.position_m:g}: must be below {first.getLength():.1f}"
        )
    return actor.edges, actor.position_m
