"""Commands to vehicles of the running simulation, and queries of their neighbours."""

import contextlib
from typing import Any

from sumo_net.traffic import Traffic

_ONLY_AS_TOLD = 256  # SUMO's lane-change mode: commanded changes only, unless they cause a collision
_TOLD_FOR_S = 2.0
_NO_CHANGES = 0  # SUMO's lane-change mode: commanded changes only, made regardless of other vehicles
_OWN_CHANGES = 1621  # SUMO's default lane-change mode
_NO_CHECKS = 32  # SUMO's speed mode: a commanded speed is driven regardless of what is ahead
_OWN_SPEED = 31  # SUMO's default speed mode


class Influence:
    """A thin layer over SUMO's vehicle interface, by handles. Vehicles that have left are ignored."""

    def __init__(self, traffic: Traffic) -> None:
        self._traffic = traffic
        self._vehicle: Any = traffic.vehicles
        self._gone = traffic.gone

    def slow_down(self, handle: int, speed_mps: float, duration_s: float) -> None:
        """Change the speed linearly over `duration_s`; then SUMO's driver takes over again."""
        with contextlib.suppress(*self._gone):
            self._vehicle.slowDown(self._name(handle), speed_mps, duration_s)

    def follower(self, handle: int) -> int | None:
        """The next vehicle behind on the same lane; None if there is none."""
        with contextlib.suppress(*self._gone):
            name = self._vehicle.getFollower(self._name(handle), 0.0)[0]
            return self._known(name) if name else None
        return None

    def followers_beside(self, handle: int, side: int) -> list[tuple[int, float]]:
        """(handle, gap in m) of the next vehicles behind on the lane to the left (+1) or right (-1)."""
        ask = self._vehicle.getLeftFollowers if side > 0 else self._vehicle.getRightFollowers
        with contextlib.suppress(*self._gone):
            found = [(self._known(name), float(gap)) for name, gap in ask(self._name(handle))]
            return [(one, gap) for one, gap in found if one is not None]
        return []

    def reaction_s(self, handle: int) -> float:
        """Interval between the driver's decisions."""
        with contextlib.suppress(*self._gone):
            return float(self._vehicle.getActionStepLength(self._name(handle)))
        return 0.1

    def set_reaction_s(self, handle: int, seconds: float) -> None:
        """Set the interval between the driver's decisions; it starts now."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setActionStepLength(self._name(handle), seconds, True)

    def cut_in(self, handle: int, side: int) -> int:
        """Change lanes now to the left (+1) or right (-1); returns the mode to hand to `obey` later."""
        with contextlib.suppress(*self._gone):
            name = self._name(handle)
            before = int(self._vehicle.getLaneChangeMode(name))
            self._vehicle.setLaneChangeMode(name, _ONLY_AS_TOLD)
            self._vehicle.changeLaneRelative(name, side, _TOLD_FOR_S)
            return before
        return -1

    def obey(self, handle: int, mode: int) -> None:
        """Restore the lane-change mode that `cut_in` returned."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setLaneChangeMode(self._name(handle), mode)

    def find(self, vehicle_id: str) -> int | None:
        """The handle of a vehicle that has entered and not yet arrived; None otherwise."""
        return self._known(vehicle_id)

    def hold_speed(self, handle: int, speed_mps: float) -> None:
        """Drive at exactly this speed from the next step on."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setSpeedMode(self._name(handle), _NO_CHECKS)
            self._vehicle.setSpeed(self._name(handle), speed_mps)

    def keep_lane(self, handle: int) -> None:
        """Change lanes only when commanded."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setLaneChangeMode(self._name(handle), _NO_CHANGES)

    def wish(self, handle: int, speed_mps: float) -> None:
        """Limit the speed; SUMO's driver does the rest."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setMaxSpeed(self._name(handle), max(speed_mps, 0.1))

    def free(self, handle: int) -> None:
        """Hand speed and lane changes back to SUMO's driver."""
        with contextlib.suppress(*self._gone):
            self._vehicle.setSpeedMode(self._name(handle), _OWN_SPEED)
            self._vehicle.setSpeed(self._name(handle), -1.0)
            self._vehicle.setLaneChangeMode(self._name(handle), _OWN_CHANGES)

    def change_lane(self, handle: int, side: int) -> None:
        """Change lanes in the next step to the left (+1) or right (-1), regardless of others, and stay."""
        with contextlib.suppress(*self._gone):
            self.keep_lane(handle)
            # SUMO counts lanes from the side that traffic keeps to
            over = -side if self._traffic.left_hand else side
            self._vehicle.changeLaneRelative(self._name(handle), over, _TOLD_FOR_S)

    def _name(self, handle: int) -> str:
        return self._traffic.vehicle_id(handle)

    def _known(self, name: str) -> int | None:
        try:
            return self._traffic.handle(name)
        except KeyError:
            return None
