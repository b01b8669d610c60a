"""Two ways to read what changes of all vehicles: values asked one by one, or sent by SUMO with each step.

Each gives a function of the vehicles' names that returns six lists: position (x, y), angle, speed,
acceleration, lane, position along it; all as SUMO has them.
"""

from collections.abc import Callable
from typing import Any

Read = Callable[[list[str]], list[list[Any]]]


_ASKED = ("Position", "Angle", "Speed", "Acceleration", "LaneID", "LanePosition")


def by_getters(vehicle: Any, compiled: Any = None) -> Read:
    """For libsumo, where a value costs 0.15 µs and subscriptions cost more.

    compiled: libsumo's extension module, whose functions are asked without the Python ones around them, which
    cost as much again; None for those of `vehicle`.
    """
    getters = [
        getattr(compiled, f"vehicle_get{name}", None) or getattr(vehicle, f"get{name}") for name in _ASKED
    ]

    def read(names: list[str]) -> list[list[Any]]:
        return [list(map(get, names)) for get in getters]

    return read


def by_subscription(vehicle: Any, tc: Any) -> Read:
    """For traci, where each value asked for is a message to and fro. `tc` is traci.constants."""
    variables = (
        tc.VAR_POSITION,
        tc.VAR_ANGLE,
        tc.VAR_SPEED,
        tc.VAR_ACCELERATION,
        tc.VAR_LANE_ID,
        tc.VAR_LANEPOSITION,
    )

    def values(name: str) -> Any:
        # The answer to a subscription holds the values of now. SUMO adds it to what the user subscribed to.
        vehicle.subscribe(name, variables)
        return vehicle.getSubscriptionResults(name)

    def read(names: list[str]) -> list[list[Any]]:
        known = vehicle.getAllSubscriptionResults()
        rows = []
        for name in names:
            row = known.get(name)
            complete = row is not None and all(variable in row for variable in variables)
            rows.append(row if complete else values(name))
        return [[row[variable] for row in rows] for variable in variables]

    return read
