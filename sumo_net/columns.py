"""Two ways to read the changing values of all vehicles: getter calls, or subscriptions sent with each step.

Values are in SUMO's units and frames. Accelerations are read of equipped vehicles only.
"""

from collections.abc import Callable
from typing import Any, NamedTuple


class Reader(NamedTuple):
    """Functions that read values of vehicles by their names."""

    places: Callable[[list[str]], list[list[Any]]]  # position (x, y), angle, speed, lane, position along it
    acceleration: Callable[[str], float]  # SUMO's invalid value, or its exception, where there is none


_ASKED = ("Position", "Angle", "Speed", "LaneID", "LanePosition")


def reader_of(simulation: Any, tc: Any) -> Reader:
    """The reader for the module libsumo, or for traci or one of its connections. `tc` is traci.constants."""
    if getattr(simulation, "__name__", "") == "libsumo":
        # None in releases that keep the extension module elsewhere
        return by_getters(simulation.vehicle, getattr(getattr(simulation, "libsumo", None), "_libsumo", None))
    return by_subscription(simulation.vehicle, tc)


def by_getters(vehicle: Any, compiled: Any) -> Reader:
    """For libsumo, where a getter costs 0.15 µs and a subscription more.

    compiled: libsumo's extension module; calling it directly saves the Python wrappers, which double the
    cost. None: the getters of `vehicle` are used.
    """

    def getter(name: str) -> Any:
        return getattr(compiled, f"vehicle_get{name}", None) or getattr(vehicle, f"get{name}")

    getters, acceleration = [getter(name) for name in _ASKED], getter("Acceleration")

    def places(names: list[str]) -> list[list[Any]]:
        return [list(map(get, names)) for get in getters]

    return Reader(places, acceleration)


def by_subscription(vehicle: Any, tc: Any) -> Reader:
    """For traci, where each getter is a round trip over a socket. `tc` is traci.constants."""
    variables = (
        tc.VAR_POSITION,
        tc.VAR_ANGLE,
        tc.VAR_SPEED,
        tc.VAR_LANE_ID,
        tc.VAR_LANEPOSITION,
        tc.VAR_ACCELERATION,
    )

    def values(name: str) -> Any:
        # A new subscription is answered with the present values. SUMO adds it to the user's own.
        vehicle.subscribe(name, variables)
        return vehicle.getSubscriptionResults(name)

    def places(names: list[str]) -> list[list[Any]]:
        known = vehicle.getAllSubscriptionResults()
        rows = []
        for name in names:
            row = known.get(name)
            complete = row is not None and all(variable in row for variable in variables)
            rows.append(row if complete else values(name))
        return [[row[variable] for row in rows] for variable in variables[:-1]]

    def acceleration(name: str) -> float:
        row = vehicle.getSubscriptionResults(name)  # already received
        return float(row.get(tc.VAR_ACCELERATION, tc.INVALID_DOUBLE_VALUE))

    return Reader(places, acceleration)
