"""A SUMO-free bench for drivers: n vehicles at constant speed on roads given by their curvature."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sumo_net.arrays import Array
from sumo_net.batch import select
from sumo_net.driver import Driver, Mind, Traits, attentive, numbers, traits
from sumo_net.ego import Drive, Motion, standing
from sumo_net.ego_kernels import advance
from sumo_net.ego_road_kernels import SIGHT_S
from sumo_net.vehicle import Vehicle, model, steady_state

STEP_S, HALF_LANE_M = 0.1, 1.875
VEHICLE = Vehicle()
LORRY = Vehicle(  # two axles, 18 t
    front_axle_m=3.4,
    rear_axle_m=1.8,
    mass_kg=18_000.0,
    front_stiffness_npr=320_000.0,
    rear_stiffness_npr=650_000.0,
    yaw_inertia_kgm2=110_000.0,
    front_overhang_m=1.4,
    wheel_span_m=2.4,
    width_m=2.55,
)
QUIET = {"distraction_per_min": 0.0, "microsleep_per_min": 0.0}
STILL = QUIET | {
    "sleepy_share": 0.0,
    "alert_sd_least_m": 0.0,
    "alert_sd_most_m": 0.0,
    "offset_sd_m": 0.0,
    "jitter_sd_rad": 0.0,
}


def straight(s: Array) -> Array:
    return np.zeros_like(s)


def circle(radius_m: float) -> Callable[[Array], Array]:
    return lambda s: np.full_like(s, 1.0 / radius_m)


def motorway(s: Array) -> Array:
    """Straights of 900 m between bends of R 500 to 2000 m with clothoids of 120 m, over and over."""
    knots, values, at = [0.0], [0.0], 0.0
    for curvature in (1 / 700, -1 / 1000, -1 / 500, 1 / 1500, -1 / 2000):
        for length, value in ((900, 0.0), (120, curvature), (350, curvature), (120, 0.0)):
            at += length
            knots.append(at)
            values.append(value)
    return np.interp(s % at, knots, values)


@dataclass
class Bench:
    """The fleet's state; `step` moves it on."""

    driver: Driver
    n: int
    speed_mps: float
    curvature: Callable[[Array], Array] = straight
    seed: int = 1
    vehicle: Vehicle = VEHICLE
    station_m: Array = field(init=False)
    traits: Traits = field(init=False)
    mind: Mind = field(init=False)
    motion: Motion = field(init=False)

    def __post_init__(self) -> None:
        names = [f"car{i}" for i in range(self.n)]
        self.traits = traits(
            self.driver, self.vehicle, self.seed, names, np.full(self.n, self.vehicle.width_m)
        )
        self.mind = attentive(self.traits)
        self.motion = standing(np.arange(self.n))
        self.numbers, self.model = numbers(self.driver, self.vehicle), model(self.vehicle)
        self.station_m = 777.0 * np.arange(self.n, dtype=float)
        self.motion.offset_m[:] = self.traits.offset_m
        self.motion.along_mps[:] = self.speed_mps
        unit = steady_state(self.vehicle, self.speed_mps, 1.0)
        k = self.curvature(self.station_m)
        self.motion.steer_rad[:] = k * self.speed_mps / unit[1]
        self.motion.lateral_speed_mps[:], self.motion.yaw_rate_rps[:] = np.outer(unit, self.motion.steer_rad)
        self.motion.heading_rad[:] = -self.motion.lateral_speed_mps / self.speed_mps

    def keep(self, index: Array) -> None:
        self.n = len(index)
        self.station_m = self.station_m[index].copy()
        for name in ("traits", "mind", "motion"):
            setattr(self, name, select(getattr(self, name), index))

    def step(self, alerted: Array | None = None) -> None:
        v, s = self.speed_mps, self.station_m
        after = s + STEP_S * v
        ahead = v * np.interp(v, 4.0 * np.arange(16), self.numbers.preview_s)
        same = np.full(self.n, v)
        drive = Drive(
            STEP_S * same,
            same,
            same,
            self.curvature(s),
            self.curvature(after),
            self.curvature(s + ahead),
            self.curvature(after + ahead),
            self.curvature(after + SIGHT_S * v),
            np.full(self.n, HALF_LANE_M),
            np.zeros(self.n, np.bool_) if alerted is None else alerted,
        )
        advance(self.motion, self.mind, self.traits, drive, self.numbers, self.model)
        self.station_m = after

    def beyond_border_m(self) -> Array:
        """How far the outer edge of a front wheel stands beyond the border, (n,)."""
        front = self.motion.offset_m + self.vehicle.front_axle_m * np.sin(self.motion.heading_rad)
        return np.abs(front) + self.traits.half_span_m - HALF_LANE_M
