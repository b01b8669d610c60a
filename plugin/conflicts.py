"""True rear-end conflicts and how the warnings match them: for scoring only, unknown to the assistance."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import Field

from plugin import leader_kernels
from plugin.events import Place
from plugin.leaders import NOBODY, Leaders
from sumo_net.arrays import Array
from sumo_net.settings import settings
from sumo_net.step import STEP_S

LEVELS = ("", "reminder", "danger")
REMINDER, DANGER = 1, 2


@settings
class ConflictSettings:
    """What counts as a rear-end conflict, and which warnings belong to it."""

    ttc_s: float = Field(
        3.0, gt=0, description="a conflict lasts while the true time to collision is under this"
    )
    critical_ttc_s: float = Field(
        2.0, gt=0, description="a warning must be on before the true time to collision falls under this"
    )
    merge_s: float = Field(1.0, ge=0, description="shorter pauses do not end a conflict")
    early_s: float = Field(
        4.0, gt=0, description="a warning is true if a conflict follows its start within this time, or …"
    )
    after_end_s: float = Field(1.0, ge=0, description="… its end within this time")
    late_s: float = Field(0.5, ge=0, description="a warning may begin this long after the conflict has ended")
    approach_mps: float = Field(
        0.5, ge=0, description="true closing speed that makes a warning without a conflict a nuisance"
    )
    approach_window_s: float = Field(
        0.5, ge=0, description="such a closing speed counts also this long before the warning"
    )
    close_s: float = Field(
        1.0, ge=0, description="a true time gap under this makes it a nuisance, too; otherwise it is false"
    )
    reach_m: float = Field(200.0, gt=0, description="distance up to which leaders are considered")
    overlap_m: float = Field(0.3, ge=0, description="bodies that reach this far into the lane are in path")
    entering_s: float = Field(
        1.0, ge=0, description="the lane that will be reached in this time justifies a nuisance, too"
    )
    braking_mps2: float = Field(
        2.0, gt=0, description="a warning of a body ahead that brakes this hard is at least a nuisance"
    )


@dataclass(slots=True)
class Conflict:
    """One rear-end conflict of a vehicle with one leader."""

    handle: int
    target: int
    start_s: float
    end_s: float
    min_ttc_s: float
    min_gap_m: float
    worst_s: float
    visible_s: float
    place: Place  # of the follower at the start
    critical_s: float | None = None

    @property
    def decisive_s(self) -> float:
        """Time by which a warning must have been on: `critical_s`, or else that of the least TTC."""
        return self.worst_s if self.critical_s is None else self.critical_s


@dataclass(slots=True)
class CollisionWarning:
    """One warning of one level; `end_s` is None while it lasts."""

    handle: int
    level: int
    start_s: float
    ttc_s: float
    approach: bool
    place: Place
    end_s: float | None = None


@dataclass(slots=True)
class ConflictBook:
    """Collects conflicts and rear-end warnings step by step, and matches them."""

    settings: ConflictSettings = field(default_factory=ConflictSettings)
    _open: dict[tuple[int, int], Conflict] = field(default_factory=dict)
    _done: list[Conflict] = field(default_factory=list)
    _on: dict[tuple[int, int], CollisionWarning] = field(default_factory=dict)
    _ended: list[CollisionWarning] = field(default_factory=list)
    _archive: list[Conflict | CollisionWarning] = field(default_factory=list)
    _seen: dict[int, tuple[int, float]] = field(default_factory=dict)  # leader, in view since
    _approached: dict[int, float] = field(default_factory=dict)  # time of the last approach
    _speeds: dict[tuple[int, int], float] = field(default_factory=dict)  # of bodies warned of, a step ago

    def add(
        self,
        time_s: float,
        handle: Array,
        leader: Leaders,
        in_path: Leaders,
        target: Leaders,
        visible: Array,
        speed_mps: Array,
        level: Array,
        warned_ttc_s: Array,
        place: Callable[[int], Place],
    ) -> None:
        """One step of n vehicles.

        leader : on SUMO's lanes, defines conflicts; in_path : by position, target : the body warned of if it
        is in the way; both may also justify warnings.
        visible (n,) : the leader is in the radar's view (`in_view`); level (n,) 0, 1, 2 of the
        warning that is on; warned_ttc_s (n,) the estimated time to collision of its target; place gives
        where a vehicle is, by its row.
        """
        s = self.settings
        approached, near = leader_kernels.approaches(
            leader, in_path, target, speed_mps, s.approach_mps, s.close_s, s.ttc_s
        )
        braked = self._braking(handle, target, speed_mps)
        for one in [*handle[approached].tolist(), *braked]:
            self._approached[one] = time_s
        self._follow_views(time_s, handle, leader.handle, visible)
        for i in near.tolist():
            self._conflict(time_s, int(handle[i]), leader, i, place)
        warned = np.flatnonzero(level > 0)
        on = set()
        for i in warned.tolist():
            for kind in range(REMINDER, int(level[i]) + 1):
                key = int(handle[i]), kind
                on.add(key)
                if key not in self._on:
                    self._on[key] = CollisionWarning(*key, time_s, float(warned_ttc_s[i]), False, place(i))
                since = time_s - self._approached.get(key[0], -np.inf)
                self._on[key].approach |= since <= s.approach_window_s + 1e-9
        for key in [key for key in self._on if key not in on]:
            warning = self._on.pop(key)
            warning.end_s = time_s - STEP_S
            self._ended.append(warning)
        for pair in [pair for pair, c in self._open.items() if time_s - c.end_s > s.merge_s]:
            self._done.append(self._open.pop(pair))

    def settle(
        self, until_s: float, final: bool = False
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Rows (conflicts, warnings) of all that can be matched by `until_s`; the rest is kept."""
        s = self.settings
        if final:
            self._done += self._open.values()
            self._ended += self._on.values()
            self._open, self._on = {}, {}
        conflicts = [c for c in self._done if final or c.end_s + s.late_s + 1.0 <= until_s]
        warnings = [w for w in self._ended if final or self._last_match(w) + s.merge_s <= until_s]
        known = [*self._archive, *self._done, *self._open.values(), *self._ended, *self._on.values()]
        known_warnings = [e for e in known if isinstance(e, CollisionWarning)]
        known_conflicts = [e for e in known if isinstance(e, Conflict)]
        rows = (
            [self._conflict_row(c, known_warnings) for c in conflicts],
            [self._warning_row(w, known_conflicts) for w in warnings],
        )
        finished = {id(e) for e in (*conflicts, *warnings)}
        self._archive = [e for e in (*self._archive, *conflicts, *warnings) if e.start_s > until_s - 120.0]
        self._done = [c for c in self._done if id(c) not in finished]
        self._approached = {one: time for one, time in self._approached.items() if time > until_s - 60.0}
        self._ended = [w for w in self._ended if id(w) not in finished]
        return rows

    def _braking(self, handle: Array, target: Leaders, speed_mps: Array) -> list[int]:
        """The vehicles, of handle (n,), whose target has braked hard in the last step."""
        rows = np.flatnonzero(target.handle != NOBODY)
        pairs = zip(handle[rows].tolist(), target.handle[rows].tolist(), strict=True)
        before, self._speeds = (
            self._speeds,
            dict(zip(pairs, (speed_mps - target.closing_mps)[rows].tolist(), strict=True)),
        )
        hard = STEP_S * self.settings.braking_mps2 - 1e-9
        return [pair[0] for pair, now in self._speeds.items() if before.get(pair, now) - now >= hard]

    def _follow_views(self, time_s: float, handle: Array, leader: Array, visible: Array) -> None:
        now: dict[int, tuple[int, float]] = {}
        rows = np.flatnonzero(visible & (leader != NOBODY))
        for one, target in zip(handle[rows].tolist(), leader[rows].tolist(), strict=True):
            before = self._seen.get(one)
            now[one] = before if before is not None and before[0] == target else (target, time_s)
        self._seen = now

    def _conflict(
        self, time_s: float, handle: int, leader: Leaders, i: int, place: Callable[[int], Place]
    ) -> None:
        target, ttc, gap = int(leader.handle[i]), float(leader.ttc_s[i]), float(leader.gap_m[i])
        seen = self._seen.get(handle)
        visible_s = time_s - seen[1] if seen is not None and seen[0] == target else 0.0
        conflict = self._open.get((handle, target))
        if conflict is None:
            conflict = Conflict(handle, target, time_s, time_s, ttc, gap, time_s, visible_s, place(i))
            self._open[handle, target] = conflict
        conflict.end_s = time_s
        conflict.min_gap_m = min(conflict.min_gap_m, gap)
        if conflict.critical_s is None and ttc < self.settings.critical_ttc_s:
            conflict.critical_s, conflict.visible_s = time_s, visible_s
        if ttc < conflict.min_ttc_s:
            conflict.min_ttc_s, conflict.worst_s = ttc, time_s
            if conflict.critical_s is None:
                conflict.visible_s = visible_s

    def _last_match(self, warning: CollisionWarning) -> float:
        end = float("inf") if warning.end_s is None else warning.end_s
        return max(warning.start_s + self.settings.early_s, end + self.settings.after_end_s)

    def _conflict_row(self, c: Conflict, warnings: Iterable[CollisionWarning]) -> dict[str, Any]:
        s = self.settings
        mine = [w for w in warnings if w.handle == c.handle and w.level == REMINDER]
        in_time = [w.start_s for w in mine if w.start_s <= c.decisive_s <= self._last_match(w)]
        late = [w.start_s for w in mine if c.decisive_s < w.start_s <= c.end_s + s.late_s]
        start = max(in_time) if in_time else min(late, default=None)
        return {
            "handle": c.handle,
            "target": c.target,
            "start_s": c.start_s,
            "end_s": c.end_s,
            "min_ttc_s": c.min_ttc_s,
            "min_gap_m": c.min_gap_m,
            "critical_s": c.critical_s,
            "visible_s": c.visible_s,
            "warned": bool(in_time),
            "lead_time_s": None if start is None else c.decisive_s - start,
            **c.place._asdict(),
        }

    def _warning_row(self, w: CollisionWarning, conflicts: Iterable[Conflict]) -> dict[str, Any]:
        s = self.settings
        matches = [
            c.decisive_s
            for c in conflicts
            if c.handle == w.handle and c.start_s <= self._last_match(w) and c.end_s >= w.start_s - s.late_s
        ]
        return {
            "handle": w.handle,
            "kind": "fcw",
            "level": LEVELS[w.level],
            "side": None,
            "start_s": w.start_s,
            "end_s": w.end_s,
            "ttc_s": w.ttc_s if np.isfinite(w.ttc_s) else None,
            "lead_time_s": min(matches) - w.start_s if matches else None,
            "outcome": "true" if matches else ("nuisance" if w.approach else "false"),
            **w.place._asdict(),
        }
