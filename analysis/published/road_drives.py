"""The drives of the road runs (Zhang et al. 2011, section 4.2) and the frames that their cameras see."""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from analysis.published.manoeuvre import Drive, Steer, drive, world_path
from camera_synth.camera import Camera, projection
from camera_synth.condition import looks, preset
from camera_synth.pose import Pose
from camera_synth.render import NO_TRUTH, render
from camera_synth.truth import BorderColumns
from sumo_net.arrays import Array
from sumo_net.plain_road import PlainRoad, no_objects
from sumo_net.randomness import stream_key, uniform
from sumo_net.settings import settings
from sumo_net.step import STEP_S
from sumo_net.vehicle import Vehicle

HALF, FULL, CAMERA = Vehicle(), Vehicle(mass_kg=1460.0), Camera()
ROAD = PlainRoad(np.array([0.0, 150.0, 250.0, 420.0, 520.0]), np.array([0.0, 0.0, 1e-3, 1e-3, 0.0]))
HORIZON_S = 2.0
STILL_S = 8.0  # time of the picture of a run
AHEAD = round(HORIZON_S / STEP_S)  # steps
_FINE_S = 0.01


class Run(NamedTuple):
    """One of the source's runs."""

    title: str
    vehicle: Vehicle
    start_kmh: float
    acceleration_mps2: float

    def speed(self, time_s: float) -> float:
        """m/s at a time."""
        return self.start_kmh / 3.6 + self.acceleration_mps2 * time_s


RUNS = (
    Run("half load, 90 km/h", HALF, 90.0, 0.0),
    Run("half load, from 80 km/h at 0.2 m/s²", HALF, 80.0, 0.2),
    Run("full load, from 70 km/h at 0.18 m/s²", FULL, 70.0, 0.18),
)


@settings
class RoadRuns:
    """The cars, the drives and the light; all our choice."""

    cars: int = Field(6, ge=1, le=64)
    duration_s: float = Field(16.0, gt=4, le=600)
    settle_s: float = Field(2.0, ge=0, description="start of the drive, not scored")
    weave_m: float = Field(0.2, ge=0, le=1, description="amplitude of the slower of two weaves in the lane")
    condition: str = Field("clear", description="preset of camera_synth.condition")
    seed: int = Field(1, ge=0)


class Truth(NamedTuple):
    """The drives of all cars of a run at 0.1 s, (steps, cars) each."""

    drive: Drive
    x_m: Array  # world
    y_m: Array
    world_heading_rad: Array


def keeping_the_lane(vehicle: Vehicle, weave_m: float, phase: Array) -> Steer:
    """A driver who follows the road and weaves a little: the desired offset is a sum of two slow sines."""

    def steer(t: float, x: Array, v: float) -> float:
        v_y, _, s, d, psi = x
        wanted = weave_m * (
            np.sin(2 * np.pi * (0.11 * t + phase[0])) + 0.4 * np.sin(2 * np.pi * (0.27 * t + phase[1]))
        )
        # 0.5 rad/s, damping 0.7: differs from the lane keeping that the refined prediction assumes
        to_lane = (0.25 * (d - wanted) + 0.7 * (v * psi + v_y)) / v**2
        turned = float(ROAD.curvature(s + 0.3 * v)) - to_lane
        return float((vehicle.wheelbase_m + vehicle.understeer * v**2) * turned)

    return steer


def truth_of(run: Run, experiment: RoadRuns) -> Truth:
    """All cars' drives; a car's weave depends only on the seed and its number."""
    drives, paths = [], []
    for i in range(experiment.cars):
        key = stream_key(experiment.seed, f"car {i}", "weave")
        phase = np.array([uniform(key, np.uint64(0)), uniform(key, np.uint64(1))])
        fine = drive(
            run.vehicle,
            keeping_the_lane(run.vehicle, experiment.weave_m, phase),
            run.speed,
            lambda s: float(ROAD.curvature(s)),
            duration_s=experiment.duration_s + HORIZON_S,
            fine_s=_FINE_S,
            each=1,
        )
        every = slice(None, None, 10)
        paths.append([part[every] for part in world_path(fine)])
        drives.append([part[every] for part in fine])
    whole = Drive(*np.moveaxis(np.array(drives), 0, -1))
    return Truth(whole, *np.moveaxis(np.array(paths), 0, -1))


def frames_of(
    truth: Truth,
    experiment: RoadRuns,
    k: int,
    frames: Array,
    first_row: int = 0,
    borders: tuple[Array, BorderColumns] = NO_TRUTH,
) -> None:
    """Draw what all cars see at step k into frames (cars, 240, 320); `borders` is filled as `render` does."""
    n = experiment.cars
    keys = np.array([stream_key(experiment.seed, f"car {i}", "camera") for i in range(n)], np.uint64)
    t = truth.drive
    ahead = ROAD.ahead(t.station_m[k], t.offset_m[k], t.heading_rad[k])
    pose = Pose(*(np.ascontiguousarray(part[k]) for part in truth[1:]))
    condition, counter = looks(preset(experiment.condition), n), np.full(n, k, np.int64)
    render(
        frames, projection(CAMERA), ahead, no_objects(n), pose, condition, keys, counter, first_row, borders
    )


def still_step(experiment: RoadRuns) -> int:
    """The step at which the picture is taken."""
    return round(min(STILL_S, experiment.duration_s - STEP_S) / STEP_S)


def driven(truth: Truth, k: int) -> tuple[Array, Array]:
    """Car 0's positions in the 2 s after step k, (forward, left) in the vehicle frame of k, (20,) each."""
    later = slice(k + 1, k + AHEAD + 1)
    dx, dy = truth.x_m[later, 0] - truth.x_m[k, 0], truth.y_m[later, 0] - truth.y_m[k, 0]
    cos, sin = np.cos(truth.world_heading_rad[k, 0]), np.sin(truth.world_heading_rad[k, 0])
    return cos * dx + sin * dy, cos * dy - sin * dx
