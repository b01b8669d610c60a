"""Plays a script in the running simulation, and checks that SUMO does what was commanded."""

from collections.abc import Sequence
from typing import Any

from sumo_net.ego import Ego
from sumo_net.influence import Influence
from sumo_net.script import Actor, Manoeuvre
from sumo_net.snapshot import Snapshot
from sumo_net.step import STEP_S
from sumo_net.traffic import Traffic, TrafficError

_RATE_MPS2, _RAMP_S = 3.0, 1.5
_SLACK_MPS = 0.05  # largest difference of driven and commanded speed
_WAIT_STEPS = 3  # until a commanded lane change must have been made


class ScriptError(TrafficError):
    """SUMO did not carry out what the script commands."""


class _Held:
    """A commanded speed that changes to its target at a constant rate."""

    def __init__(self, speed_mps: float) -> None:
        self.told = self.target = speed_mps
        self.rate = _RATE_MPS2

    def advance(self) -> float:
        most = self.rate * STEP_S
        self.told += min(max(self.target - self.told, -most), most)
        return self.told


class ScriptPlayer:
    """Call `step` last in each step: its commands take effect in SUMO's next step."""

    def __init__(
        self, actors: Sequence[Actor], script: Sequence[Manoeuvre], traffic: Traffic, ego: Ego
    ) -> None:
        self._waiting = sorted(actors, key=lambda actor: actor.at_s)
        self._script = sorted(script, key=lambda manoeuvre: manoeuvre.at_s)
        self._traffic, self._ego = traffic, ego
        self._influence = Influence(traffic)
        self._held: dict[int, _Held] = {}
        self._changing: dict[int, tuple[int, int]] = {}  # the lane before, steps left
        self._begin_s: float | None = None

    def step(self, snapshot: Snapshot) -> None:
        """Check past commands, begin manoeuvres that are due, hold speeds. Raises ScriptError."""
        if self._begin_s is None:
            self._begin_s = self._traffic.time_s - STEP_S
        now_s = self._traffic.time_s - self._begin_s
        if not (self._waiting or self._script or self._held or self._changing):
            return
        row = {int(handle): i for i, handle in enumerate(snapshot.handle)}
        self._check(snapshot, row, now_s)
        while self._waiting and self._waiting[0].at_s <= now_s + 1e-6:
            if not self._place(self._waiting[0], now_s):
                break
            self._waiting.pop(0)
        while self._script and self._script[0].at_s <= now_s + 1e-6:
            self._begin(self._script.pop(0), snapshot, row)
        for handle, held in self._held.items():
            self._influence.hold_speed(handle, held.advance())

    def _place(self, actor: Actor, now_s: float) -> bool:
        handle = self._influence.find(actor.id)
        if handle is None:
            if now_s > actor.at_s + 2.05:
                raise ScriptError(
                    f"actor '{actor.id}' is not on the road at {now_s:.1f} s: SUMO did not insert it"
                )
            return False
        if actor.held:
            self._influence.keep_lane(handle)
            self._held[handle] = _Held(actor.speed_mps)
        else:
            self._influence.wish(handle, actor.speed_mps)
        return True

    def _begin(self, manoeuvre: Manoeuvre, snapshot: Snapshot, row: dict[int, int]) -> None:
        handle = self._influence.find(manoeuvre.who)
        where = f"script: '{manoeuvre.who}' at {manoeuvre.at_s:g} s"
        if handle is None or handle not in row:
            raise ScriptError(f"{where}: is not on the road then")
        if manoeuvre.do == "speed":
            held = self._held.setdefault(handle, _Held(float(snapshot.speed_mps[row[handle]])))
            held.target = _given(manoeuvre.speed_mps)
            held.rate = manoeuvre.rate_mps2 or _RATE_MPS2
        elif manoeuvre.do == "free":
            self._held.pop(handle, None)
            self._influence.free(handle)
        elif manoeuvre.do == "veer":
            try:
                self._ego.veer(
                    handle,
                    _given(manoeuvre.drift_mps),
                    manoeuvre.ramp_s or _RAMP_S,
                    _given(manoeuvre.for_s),
                )
            except KeyError:
                raise ScriptError(f"{where}: veer needs an equipped vehicle") from None
        else:
            self._change_lane(handle, manoeuvre, int(snapshot.lane[row[handle]]))

    def _change_lane(self, handle: int, manoeuvre: Manoeuvre, lane: int) -> None:
        if self._ego.drives(handle):
            self._ego.next_change(handle, manoeuvre.signal is not False, manoeuvre.over_s)
        self._influence.change_lane(handle, 1 if manoeuvre.side == "left" else -1)
        self._changing[handle] = lane, _WAIT_STEPS

    def _check(self, snapshot: Snapshot, row: dict[int, int], now_s: float) -> None:
        for handle in [handle for handle in self._held if handle not in row]:
            del self._held[handle]  # it has reached the end of its road
        for handle, held in self._held.items():
            driven = float(snapshot.speed_mps[row[handle]])
            if abs(driven - held.told) > _SLACK_MPS:
                raise ScriptError(
                    f"'{self._traffic.vehicle_id(handle)}' drives {driven:.2f} m/s at {now_s:.1f} s,"
                    f" commanded were {held.told:.2f} m/s"
                )
        for handle, (lane, left) in list(self._changing.items()):
            if handle not in row or snapshot.lane[row[handle]] != lane:
                del self._changing[handle]
            elif left == 0:
                name = self._traffic.vehicle_id(handle)
                raise ScriptError(f"'{name}' has not changed lanes by {now_s:.1f} s: is there a lane?")
            else:
                self._changing[handle] = lane, left - 1


def _given(value: Any) -> float:
    return float(value)  # checked by Manoeuvre
