"""Placement of a protocol's trials on roads: many in one run, one behind the other, independent."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from analysis.protocol.definition import CollisionTest, DepartureTest, Procedure, Protocol, QuietTest
from sumo_net.scenario import laid_over
from sumo_net.settings import read
from sumo_net.vehicle import Vehicle

LANE_M = 3.75
CAR_M = 1.75  # width of the demand's cars
_ENTRY_M = 60.0
_CLOTHOID_M = 100.0
_MOST_OF_A_TURN = 0.85  # of a full circle: beyond, the road would meet itself
_TRIALS_A_RUN = 45
_AFTER_S = 0.5
_BEYOND_M = 0.15  # a departure continues this far beyond the latest line
_FREE_M = 0.3  # distance to the other border at the start of a departure


@dataclass(frozen=True, slots=True)
class Trial:
    """One drive of one vehicle."""

    test: Procedure
    cell: str  # name: the test, and what varies within it
    number: int
    attempt: int
    radius_m: float
    side: int = 0  # of a departure: +1 left, -1 right
    drift_mps: float = 0.0

    @property
    def vehicle_id(self) -> str:
        """Id of the vehicle under test; its random draws depend on it."""
        return f"{self.cell.replace(' ', '_')}_{self.number}_{self.attempt}"


@dataclass(frozen=True, slots=True)
class Batch:
    """Trials driven in one run of SUMO."""

    trials: tuple[Trial, ...]
    changes: dict[str, Any]  # to the scenario `straight`
    half_span_m: float  # from the middle to the outer edge of a front wheel


def trials_of(protocol: Protocol) -> list[Trial]:
    """All trials of a protocol, first attempts, in the order of its file."""
    trials = []
    for test in (*protocol.departure, *protocol.quiet, *protocol.collision):
        sides = (
            [1 if side == "left" else -1 for side in test.sides] if isinstance(test, DepartureTest) else [0]
        )
        rates = test.drift_mps if isinstance(test, DepartureTest) else (0.0,)
        for radius, side, rate in itertools.product(test.radius_m, sides, rates):
            cell = test.name
            if len(test.radius_m) > 1:
                cell += f" R{radius:+.0f}" if radius else " straight"
            if side:
                cell += f" {'left' if side > 0 else 'right'} {rate:g}"
            trials += [Trial(test, cell, k + 1, 1, radius, side, rate) for k in range(test.trials)]
    return trials


def batches(protocol: Protocol, trials: Iterable[Trial]) -> list[Batch]:
    """The trials grouped by road, line and settings, as many at a time as fit on the road."""
    by_road: dict[tuple[float, str, str], list[Trial]] = {}
    for trial in trials:
        key = trial.radius_m, _line(trial.test), repr(trial.test.settings)
        by_road.setdefault(key, []).append(trial)
    made = []
    for together in by_road.values():
        # trials of similar duration together
        together.sort(key=lambda trial: -_duration_s(trial))
        made += [_batch(protocol, part) for part in _parts(together)]
    return made


def free_m() -> float:
    """Lane width minus the width over both tyres."""
    return LANE_M - 2.0 * half_span_m()


def half_span_m(vehicle: Vehicle | None = None) -> float:
    """Half the distance between the outer edges of the test car's wheels, as in the driver model."""
    vehicle = vehicle or Vehicle()
    return 0.5 * vehicle.wheel_span_m * CAR_M / vehicle.width_m


def start_gap_m(test: DepartureTest, drift_mps: float) -> float:
    """Tyre to border at the start of a departure: it has its rate `run_up_s` before the earliest line."""
    wanted = test.earliest_at(drift_mps) + drift_mps * (0.5 * test.ramp_s + test.run_up_s)
    return min(wanted, free_m() - _FREE_M)


def _line(test: Procedure) -> str:
    return "dashed" if isinstance(test, CollisionTest) else str(getattr(test, "line", "solid"))


def _parts(trials: Sequence[Trial]) -> Iterator[Sequence[Trial]]:
    """Parts of about equal size that fit on the road."""
    radius = trials[0].radius_m
    longest = max(_needs_m(trial) for trial in trials)
    pace = max(_pace_m(trial) for trial in trials)
    room = _TRIALS_A_RUN
    if radius:
        arc = _MOST_OF_A_TURN * 2.0 * math.pi * abs(radius)
        room = max(int((arc - longest - 40.0) / pace) + 1, 1)
    size = math.ceil(len(trials) / math.ceil(len(trials) / room))
    for first in range(0, len(trials), size):
        yield trials[first : first + size]


def _speed_mps(trial: Trial) -> float:
    return trial.test.speed_kmh / 3.6


def _manoeuvre_s(trial: Trial) -> float:
    test = trial.test
    if isinstance(test, DepartureTest):
        way = start_gap_m(test, trial.drift_mps) + test.latest_m + _BEYOND_M
        return way / trial.drift_mps + 0.5 * test.ramp_s
    if isinstance(test, QuietTest):
        return test.distance_m / _speed_mps(trial)
    assert isinstance(test, CollisionTest)
    closing = (test.speed_kmh - test.leader_kmh) / 3.6
    if test.brake_mps2 is not None:
        stop = test.leader_kmh / 3.6 / test.brake_mps2
        way = 0.5 * test.brake_mps2 * stop**2 + closing * stop
        if test.gap_m < way:
            return (math.sqrt(closing**2 + 2.0 * test.brake_mps2 * test.gap_m) - closing) / test.brake_mps2
        return stop + (test.gap_m - way) / _speed_mps(trial)
    passed = 15.0 if test.expect == "none" else 0.0  # until past a vehicle in the next lane
    return (test.gap_m + passed) / closing - test.settle_s


def _duration_s(trial: Trial) -> float:
    return (
        trial.test.settle_s
        + _manoeuvre_s(trial)
        + (_AFTER_S if isinstance(trial.test, DepartureTest) else 0.0)
    )


def _needs_m(trial: Trial) -> float:
    """Length of road that a trial needs from its start."""
    ahead = trial.test.gap_m if isinstance(trial.test, CollisionTest) else 0.0
    return max(_duration_s(trial) * _speed_mps(trial), ahead) + 60.0


def _pace_m(trial: Trial) -> float:
    """Distance between the starts of consecutive trials on the same lane."""
    test = trial.test
    return test.spacing_m + (test.gap_m if isinstance(test, CollisionTest) else 0.0)


def _batch(protocol: Protocol, trials: Sequence[Trial]) -> Batch:
    radius, line = trials[0].radius_m, _line(trials[0].test)
    duration = max(_duration_s(trial) for trial in trials)
    lanes, lane = (1, 0) if line == "solid" else (3, 1)
    place = _ENTRY_M + (40.0 + _CLOTHOID_M if radius else 0.0)
    actors: list[dict[str, Any]] = []
    script: list[dict[str, Any]] = []
    for k, trial in enumerate(trials):
        follower = {
            "id": trial.vehicle_id,
            "lane": lane,
            "position_m": place + 0.37 * (k % 7),  # trials differ in where the steps of 0.1 s fall
            "speed_mps": _speed_mps(trial),
            "equipped": True,
        }
        actors.append(follower)
        if isinstance(trial.test, DepartureTest):
            _depart(trial, trial.test, follower, script)
        if isinstance(trial.test, CollisionTest):
            _lead(trial, trial.test, follower, actors, script)
        place += _pace_m(trial)
    # the foremost must have road until the end of the longest trial
    fastest = max(_speed_mps(trial) for trial in trials)
    length = place + duration * fastest + 60.0
    changes: dict[str, Any] = {
        "title": protocol.title,
        "duration_s": round(duration, 1),
        "warm_up_s": 0.0,
        "demand": {"flow_per_lane_vph": 0.0},
        "equipment": {"fraction": 0.0},
        "highway": {"lanes": lanes, "lane_width_m": LANE_M, "elements": _road(radius, length)},
        "actors": actors,
        "script": script,
    }
    if line == "dots":
        changes["condition"] = {"dash_stroke_m": 0.10, "dash_gap_m": 1.12, "marking_width_m": 0.10}
    changes = laid_over(laid_over(protocol.settings, trials[0].test.settings), changes)
    vehicle = read(Vehicle, changes.get("vehicle", {}), protocol.title)
    return Batch(tuple(trials), changes, half_span_m(vehicle))


def _depart(trial: Trial, test: DepartureTest, actor: dict[str, Any], script: list[dict[str, Any]]) -> None:
    rest = 0.5 * free_m() - start_gap_m(test, trial.drift_mps)  # from the lane centre towards the side
    actor["offset_m"] = trial.side * rest
    script.append(
        {
            "who": trial.vehicle_id,
            "at_s": test.settle_s,
            "do": "veer",
            "drift_mps": trial.side * trial.drift_mps,
            "ramp_s": test.ramp_s,
            "for_s": _manoeuvre_s(trial),
        }
    )


def _lead(
    trial: Trial,
    test: CollisionTest,
    follower: dict[str, Any],
    actors: list[dict[str, Any]],
    script: list[dict[str, Any]],
) -> None:
    leader = f"{trial.vehicle_id}_leader"
    aside = {"own": 0, "left": 1, "right": -1}[test.leader_lane]
    follower["offset_m"] = 0.0
    actors.append(
        {
            "id": leader,
            "lane": follower["lane"] + aside,
            # SUMO's position is that of the front bumper; the demand's cars are 4.2 m long
            "position_m": follower["position_m"] + test.gap_m + 4.2,
            "speed_mps": test.leader_kmh / 3.6,
        }
    )
    if test.brake_mps2 is not None:
        script.append(
            {
                "who": leader,
                "at_s": test.settle_s,
                "do": "speed",
                "speed_mps": 0.0,
                "rate_mps2": test.brake_mps2,
            }
        )


def _road(radius_m: float, length_m: float) -> list[dict[str, Any]]:
    if not radius_m:
        return [{"kind": "straight", "length_m": length_m}]
    # the arc is that of the alignment: the test's lane is up to 8 m beside it, outside in left bends
    arc = length_m - _ENTRY_M - _CLOTHOID_M
    return [
        {"kind": "straight", "length_m": _ENTRY_M},
        {"kind": "clothoid", "length_m": _CLOTHOID_M},
        {"kind": "arc", "length_m": arc, "radius_m": radius_m},
        {"kind": "clothoid", "length_m": _CLOTHOID_M},
        {"kind": "straight", "length_m": 60.0},
    ]
