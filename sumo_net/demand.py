"""Traffic demand: vehicle types, drivers and flows, written as a SUMO route file.

The built-in highway is filled from the first step: vehicles are placed at the spacing that the flow implies,
in place of those that would have entered before. Further ones enter at both ends at random times.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self
from xml.sax.saxutils import quoteattr

import numpy as np
import pydantic
from pydantic import Field

from sumo_net.network import BuiltNetwork, Carriageway
from sumo_net.randomness import generator
from sumo_net.settings import SettingsError, settings
from sumo_net.xml_input import root_element

_MOST_SINKS = 20  # destinations from one place in a user's network
_ENTRY_M = 30.0  # no vehicle is placed this close to the start, where the flows enter


@settings
class Car:
    """Passenger cars: all vehicles that are neither vans nor trucks."""

    length_m: float = Field(4.2, gt=1, le=30)
    width_m: float = Field(1.75, gt=0.5, le=3)
    height_m: float = Field(1.5, gt=0.5, le=5)
    max_speed_mps: float = Field(55.0, gt=5, le=100)
    acceleration_mps2: float = Field(2.6, gt=0, le=10)
    speed_factor: float = Field(1.0, gt=0.2, le=2, description="desired speed over the speed limit, mean")
    speed_factor_deviation: float = Field(
        0.1, ge=0, le=0.5, description="standard deviation of the speed factor"
    )


@settings
class Van(Car):
    """Delivery vans."""

    share: float = Field(0.08, ge=0, le=1, description="share of all vehicles")
    length_m: float = Field(6.0, gt=1, le=30)
    width_m: float = Field(2.05, gt=0.5, le=3)
    height_m: float = Field(2.7, gt=0.5, le=5)
    max_speed_mps: float = Field(42.0, gt=5, le=100)
    acceleration_mps2: float = Field(2.0, gt=0, le=10)


@settings
class Truck(Car):
    """Trucks: they keep to the right lane and drive about 80 km/h."""

    share: float = Field(0.12, ge=0, le=1, description="share of all vehicles")
    length_m: float = Field(14.0, gt=1, le=30)
    width_m: float = Field(2.5, gt=0.5, le=3)
    height_m: float = Field(3.8, gt=0.5, le=5)
    max_speed_mps: float = Field(24.5, gt=5, le=100)
    acceleration_mps2: float = Field(1.1, gt=0, le=10)
    speed_factor_deviation: float = Field(
        0.05, ge=0, le=0.5, description="standard deviation of the speed factor"
    )


@settings
class Driver:
    """Car-following (SUMO's Krauss model) of most drivers."""

    tau_s: float = Field(1.2, ge=0.1, le=10, description="desired time gap")
    min_gap_m: float = Field(2.5, ge=0, le=20)
    sigma: float = Field(0.5, ge=0, le=1, description="driver imperfection (SUMO's sigma)")
    action_step_s: float = Field(0.1, ge=0.1, le=3, description="interval between the driver's decisions")


@settings
class HurriedDriver(Driver):
    """Drivers who follow closely; without them no vehicles come near a collision."""

    share: float = Field(0.1, ge=0, le=1, description="share of the cars")
    tau_s: float = Field(0.4, ge=0.1, le=10, description="desired time gap")
    min_gap_m: float = Field(1.0, ge=0, le=20, description="gap at standstill")
    sigma: float = Field(0.9, ge=0, le=1, description="driver imperfection of the Krauss model")
    action_step_s: float = Field(1.0, ge=0.1, le=3, description="interval between the driver's decisions")


@settings
class Demand:
    """Traffic flows and the vehicles in them."""

    flow_per_lane_vph: float = Field(
        900.0, ge=0, le=3000, description="vehicles per hour and lane, in each direction"
    )
    backward_flow_per_lane_vph: float | None = Field(
        None,
        ge=0,
        le=3000,
        description="the same for the opposite direction of the built-in highway, if different",
    )
    filled: bool = Field(True, description="the built-in highway is full of traffic from the start")
    car: Car = Field(default_factory=Car)
    van: Van = Field(default_factory=Van)
    truck: Truck = Field(default_factory=Truck)
    driver: Driver = Field(default_factory=Driver)
    hurried: HurriedDriver = Field(default_factory=HurriedDriver)

    @pydantic.model_validator(mode="after")
    def _shares_fit(self) -> Self:
        if self.van.share + self.truck.share > 1:
            raise ValueError(
                f"van.share = {self.van.share} and truck.share = {self.truck.share}: together at most 1"
            )
        return self


def write_highway_demand(
    demand: Demand, built: BuiltNetwork, end_s: float, seed: int, path: Path, placed: Sequence[str] = ()
) -> None:
    """Write the route file for the built-in highway: both directions, from time 0 to `end_s`.

    `placed`: lines of further vehicles, ordered by time of departure.
    """
    lines = _types(demand, built.highway.lanes)
    flows = [demand.flow_per_lane_vph, demand.backward_flow_per_lane_vph]
    for way, flow in zip(built.carriageways, flows, strict=True):
        lines.append(f'<route id="{way.direction}" edges="{" ".join(way.edges)}"/>')
        if demand.filled:
            vph = demand.flow_per_lane_vph if flow is None else flow
            lines += _standing_in(way, built, vph, seed)
    for way, flow in zip(built.carriageways, flows, strict=True):
        vph = demand.flow_per_lane_vph if flow is None else flow
        for lane in range(built.highway.lanes if vph > 0 else 0):
            lines.append(
                f'<flow id="{way.direction}_{lane}" type="{_lane_type(lane)}" route="{way.direction}"'
                f' begin="0" end="{end_s:.1f}" period="exp({vph / 3600.0:.6f})"'
                f' departLane="{lane}" departPos="base" departSpeed="desired"/>'
            )
    _write(path, [*lines, *placed])


def write_network_demand(
    demand: Demand, net_file: Path, end_s: float, seed: int, path: Path, placed: Sequence[str] = ()
) -> None:
    """Write a route file for any network: flows from each edge without a predecessor to those without a
    successor.

    Raises SettingsError for a file that is not a network or has no lane for cars.
    """
    net = read_net(net_file)
    edges = [edge for edge in net.getEdges() if edge.allows("passenger")]
    if not edges:
        raise SettingsError(f"{net_file}: has no lane for passenger cars")
    sources = [edge for edge in edges if not _leads(edge.getIncoming(), edge)]
    sinks = [edge for edge in edges if not _leads(edge.getOutgoing(), edge)]
    if not sources or not sinks:  # a closed network: a few edges drawn at random
        draw = generator(seed, "", "demand")
        some = draw.choice(len(edges), size=min(12, len(edges)), replace=False)
        sources = sources or [edges[i] for i in some]
        sinks = sinks or [edges[i] for i in some[::-1]]
    lines, number = _types(demand, 1), 0
    for source in sources:
        reached = _reachable(source)
        ends = [edge for edge in sinks if edge.getID() in reached and edge is not source]
        if len(ends) > _MOST_SINKS:
            draw = generator(seed, source.getID(), "demand")
            ends = [ends[i] for i in sorted(draw.choice(len(ends), size=_MOST_SINKS, replace=False))]
        if not ends and source in sinks:
            ends = [source]  # an isolated edge
        vph = demand.flow_per_lane_vph * source.getLaneNumber() / max(len(ends), 1)
        for sink in ends if vph > 0 else []:
            number += 1
            lines.append(
                f'<flow id="flow_{number}" type="{_lane_type(0)}" from={quoteattr(source.getID())}'
                f' to={quoteattr(sink.getID())} begin="0" end="{end_s:.1f}"'
                f' period="exp({vph / 3600.0:.6f})" departLane="free" departSpeed="desired"/>'
            )
    _write(path, [*lines, *placed])


def read_net(net_file: Path) -> Any:
    """The network, read by sumolib. Raises SettingsError where that fails or the network has no lane."""
    import sumolib

    if not net_file.is_file():
        raise SettingsError(f"{net_file}: no such file")
    try:
        root_element(net_file)  # refuses XML entities
        net = sumolib.net.readNet(str(net_file))
        lanes = sum(edge.getLaneNumber() for edge in net.getEdges())
    except SettingsError:
        raise
    except Exception as error:
        raise SettingsError(f"{net_file}: is not a SUMO network: {' '.join(str(error).split())}") from None
    if lanes == 0:
        raise SettingsError(f"{net_file}: the network has no lanes")
    return net


def _types(demand: Demand, lanes: int) -> list[str]:
    """The vehicle types, and their distributions on the right lane and on the others.

    The trucks of all lanes drive on the right one, as far as it has room for them.
    """
    truck_right = min(1.0, demand.truck.share * lanes)
    rest = 1.0 - truck_right
    vans = min(demand.van.share / max(1.0 - demand.truck.share, 1e-9), 1.0)
    hurried = demand.hurried.share
    cars = {"car": (1 - vans) * (1 - hurried), "hurried": (1 - vans) * hurried, "van": vans}
    lines = [
        _type("car", "passenger", demand.car, demand.driver),
        _type("hurried", "passenger", demand.car, demand.hurried),
        _type("van", "delivery", demand.van, demand.driver),
        _type("truck", "truck", demand.truck, demand.driver),
    ]
    right = {"truck": truck_right} | {name: rest * share for name, share in cars.items()}
    for name, mix in (("right", right), ("left", cars)):
        there = {kind: share for kind, share in mix.items() if share > 0}
        lines.append(
            f'<vTypeDistribution id="{name}" vTypes="{" ".join(there)}"'
            f' probabilities="{" ".join(f"{share:.6f}" for share in there.values())}"/>'
        )
    return lines


def _type(name: str, vehicle_class: str, body: Car, driver: Driver) -> str:
    mean, deviation = body.speed_factor, body.speed_factor_deviation
    return (
        f'<vType id="{name}" vClass="{vehicle_class}" length="{body.length_m}" width="{body.width_m}"'
        f' height="{body.height_m}" maxSpeed="{body.max_speed_mps}" accel="{body.acceleration_mps2}"'
        f' speedFactor="normc({mean},{deviation},{max(mean - 3 * deviation, 0.2)},{mean + 3 * deviation})"'
        f' carFollowModel="Krauss" tau="{driver.tau_s}" minGap="{driver.min_gap_m}" sigma="{driver.sigma}"'
        f' actionStepLength="{driver.action_step_s}"/>'
    )


def _lane_type(lane: int) -> str:
    return "right" if lane == 0 else "left"


def _standing_in(way: Carriageway, built: BuiltNetwork, vph: float, seed: int) -> list[str]:
    """Vehicles on the road at time 0, spaced by 0.7 to 1.3 times the mean spacing.

    The foremost comes first, so that SUMO can give each a speed that suits the vehicle ahead.
    """
    lines: list[str] = []
    for lane in range(built.highway.lanes if vph > 0 else 0):
        draw = generator(seed, f"{way.direction}_{lane}", "demand")
        ends = way.alignment.offset_length(way.start_m, built.highway.lane_offset_m(lane))
        position = float(ends[-1])
        while True:
            edge = int(np.searchsorted(ends, position)) - 1
            spacing = max(float(way.speed_limit_mps[edge]) * 3600.0 / vph, 15.0)
            position -= spacing * draw.uniform(0.7, 1.3)
            if position < _ENTRY_M:
                break
            edge = int(np.searchsorted(ends, position)) - 1
            # Not at the very ends of an edge: SUMO's lane may be slightly shorter.
            along = min(max(position - float(ends[edge]), 0.5), float(ends[edge + 1] - ends[edge]) - 0.5)
            lines.append(
                f'<vehicle id="{way.direction}_{lane}_standing_in_{len(lines):03d}" type="{_lane_type(lane)}"'
                f' depart="0" departLane="{lane}" departPos="{along:.2f}" departSpeed="desired">'
                f'<route edges="{" ".join(way.edges[edge:])}"/></vehicle>'
            )
    return lines


def _leads(connections: dict[Any, Any], edge: Any) -> bool:
    """Whether cars can enter (or leave) this edge other than by a U-turn."""
    for other in connections:
        back = other.getFromNode() is edge.getToNode() and other.getToNode() is edge.getFromNode()
        if other is not edge and not back and other.allows("passenger"):
            return True
    return False


def _reachable(source: Any) -> set[str]:
    found, waiting = {source.getID()}, [source]
    while waiting:
        for edge in waiting.pop().getOutgoing():
            if edge.allows("passenger") and edge.getID() not in found:
                found.add(edge.getID())
                waiting.append(edge)
    return found


def _write(path: Path, lines: list[str]) -> None:
    text = "\n".join(["<?xml version='1.0' encoding='UTF-8'?>", "<routes>", *lines, "</routes>", ""])
    path.write_text(text, encoding="utf-8")
