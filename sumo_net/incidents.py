"""Causes of near-collisions: leaders that brake hard, cut-ins, followers who look away.

SUMO's car-following alone hardly ever leads to one. Vehicles are influenced through SUMO's own interface and
drive as before afterwards. All draws depend on the seed and the vehicle's id alone.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pydantic import Field

from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.influence import Influence
from sumo_net.randomness import stream_key, uniform, uniforms
from sumo_net.settings import settings
from sumo_net.snapshot import Snapshot
from sumo_net.step import STEP_S
from sumo_net.traffic import Traffic

KINDS = "braking", "cut-in"
_CUT_IN_S = 3.0  # how long the vehicle stays on the lane it has cut into


@settings
class Incidents:
    """How often vehicles do what others have to react to; 0: never."""

    brakings_per_h: float = Field(0.0, ge=0, le=3600, description="hard brakings per vehicle and hour, mean")
    braking_least_mps2: float = Field(3.0, gt=0, le=9)
    braking_hardest_mps2: float = Field(7.0, gt=0, le=9)
    speed_lost_least: float = Field(
        0.3, gt=0, le=1, description="share of the speed that is lost by a hard braking"
    )
    speed_lost_most: float = Field(0.8, gt=0, le=1)
    follower_away: float = Field(
        0.0, ge=0, le=1, description="probability that the follower looks away when the leader brakes hard"
    )
    away_least_s: float = Field(1.0, gt=0, le=10, description="time for which that follower does not react")
    away_most_s: float = Field(2.5, gt=0, le=10)
    cut_ins_per_h: float = Field(
        0.0,
        ge=0,
        le=3600,
        description="attempted cut-ins per vehicle and hour, mean; most find no vehicle to cut in on",
    )
    cut_in_least_s: float = Field(
        0.3, gt=0, le=10, description="time gap left to the vehicle that is cut in on"
    )
    cut_in_most_s: float = Field(1.0, gt=0, le=10)
    least_speed_mps: float = Field(8.0, ge=0, le=60, description="slower vehicles cause no incidents")


class _Draws(NamedTuple):
    """Four numbers in [0, 1) of one vehicle in one step."""

    event: float
    strength: float
    length: float
    other: float  # braking: whether the follower looks away, and for how long; cut-in: the side tried first


class IncidentMaker:
    """Call `step` once before each step of SUMO."""

    def __init__(self, options: Incidents, traffic: Traffic, seed: int) -> None:
        self._options, self._traffic, self._seed = options, traffic, seed
        self._influence = Influence(traffic)
        self._keys = {kind: np.zeros(0, np.uint64) for kind in KINDS}  # by handle
        self._away: dict[int, tuple[float, float]] = {}  # follower: until when, its reaction time before
        self._cutting_in: dict[int, tuple[float, int]] = {}  # until when, lane-change mode before
        self._steps = 0

    def step(self, snapshot: Snapshot) -> None:
        """Start incidents of vehicles of this snapshot, and end those whose time is over."""
        self._steps += 1
        time = self._traffic.time_s
        for handle in [h for h, (until, _) in self._away.items() if time >= until]:
            self._influence.set_reaction_s(handle, self._away.pop(handle)[1])
        for handle in [h for h, (until, _) in self._cutting_in.items() if time >= until]:
            self._influence.obey(handle, self._cutting_in.pop(handle)[1])
        fast = np.flatnonzero((snapshot.speed_mps >= self._options.least_speed_mps) & (snapshot.lane >= 0))
        for i, draws in self._chosen(snapshot, fast, "braking", self._options.brakings_per_h):
            self._brake(snapshot, i, draws, time)
        for i, draws in self._chosen(snapshot, fast, "cut-in", self._options.cut_ins_per_h):
            self._cut_in(snapshot, i, draws, time)

    def look_ahead(self, handles: Array, reaction_s: float) -> None:
        """Let drivers of these vehicles who look away look ahead again after at most `reaction_s`."""
        time = self._traffic.time_s
        for handle in handles.tolist():
            if handle in self._away:
                until, own = self._away[handle]
                self._away[handle] = min(until, time + reaction_s), own

    def _chosen(
        self, snapshot: Snapshot, rows: Array, kind: str, per_h: float
    ) -> Iterator[tuple[int, _Draws]]:
        chance = per_h / 3600.0 * STEP_S
        if chance <= 0.0 or not len(rows):
            return
        keys = self._keys_of(snapshot.handle[rows], kind)
        for k in np.flatnonzero(uniforms(keys, 4 * self._steps) < chance).tolist():
            draws = (float(uniform(keys[k], 4 * self._steps + j)) for j in range(4))
            yield int(rows[k]), _Draws(*draws)

    def _keys_of(self, handles: Array, kind: str) -> Array:
        known = self._keys[kind] = longer(self._keys[kind], int(handles.max()) + 1)
        for handle in handles[known[handles] == 0].tolist():
            known[handle] = stream_key(self._seed, self._traffic.vehicle_id(handle), kind)
        return known[handles]

    def _brake(self, snapshot: Snapshot, i: int, draws: _Draws, time: float) -> None:
        o = self._options
        strength = o.braking_least_mps2 + draws.strength * (o.braking_hardest_mps2 - o.braking_least_mps2)
        lost = o.speed_lost_least + draws.length * (o.speed_lost_most - o.speed_lost_least)
        speed = float(snapshot.speed_mps[i])
        self._influence.slow_down(int(snapshot.handle[i]), (1.0 - lost) * speed, lost * speed / strength)
        if draws.other < o.follower_away:
            follower = self._influence.follower(int(snapshot.handle[i]))
            if follower is not None and follower not in self._away:
                part = draws.other / o.follower_away
                away = o.away_least_s + part * (o.away_most_s - o.away_least_s)
                self._away[follower] = time + away, self._influence.reaction_s(follower)
                self._influence.set_reaction_s(follower, away)

    def _cut_in(self, snapshot: Snapshot, i: int, draws: _Draws, time: float) -> None:
        """Change lanes in front of a faster neighbour, on either side, within at most the drawn time gap."""
        o = self._options
        wanted = o.cut_in_least_s + draws.strength * (o.cut_in_most_s - o.cut_in_least_s)
        handle = int(snapshot.handle[i])
        if handle in self._cutting_in:
            return
        sides = (1, -1) if draws.other < 0.5 else (-1, 1)
        for side in sides:
            for follower, gap in self._influence.followers_beside(handle, side):
                row = int(np.searchsorted(snapshot.handle, follower))
                if row >= len(snapshot.handle) or snapshot.handle[row] != follower:
                    continue
                speed = float(snapshot.speed_mps[row])
                if 0.0 < gap <= wanted * speed and speed > snapshot.speed_mps[i]:
                    self._cutting_in[handle] = time + _CUT_IN_S, self._influence.cut_in(handle, side)
                    return
