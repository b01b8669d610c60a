"""The published lane search, `paper` mode (Zhang et al. 2011, section 1.2.2, tables 3, 4).

Each border x = a·y² + b·y + c is found anew in every frame by a genetic algorithm on the objective function:
binary chromosomes, roulette selection, elitism, three-point crossover with the next individual, mutation of
one bit. Regions of interest narrow in three stages: the first frame, five frames of transition, and all
later frames.

The source does not say what happens when a border is lost. `Restart` is our addition and can be switched off:
a border that fails for some frames starts again at the first stage. Since the regions would follow a border
across the whole image, the search moves on to the neighbouring lane's borders when the vehicle changes lanes.
"""

import dataclasses
import math
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from camera_synth.camera import WIDTH_PX, Camera, image_from_vehicle, projection, vehicle_from_image
from plugin.lane.estimate import Borders
from plugin.lane.genetic_kernels import search_kernel
from plugin.lane.objective import Objective, blocks_below_horizon, check_frames, objective_numbers
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings

Interval = tuple[float, float]

DECIMALS = (4, 2, 0)  # m of eq. 4 for a, b and c
MOST_BITS = 62


@settings
class Region:
    """Search region of a border's parameters in the first frame."""

    a: Interval = Field(description="lowest and highest a, 1/px")
    b: Interval = Field(description="lowest and highest b")
    c: Interval = Field(description="lowest and highest c, px")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name in ("a", "b", "c"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = [{low}, {high}]: the first must be below the second")
        return self


@settings
class Reach:
    """Search region of a border's parameters: distance to either side of the last result."""

    a: float = Field(gt=0, le=0.1, description="1/px")
    b: float = Field(gt=0, le=10)
    c: float = Field(gt=0, le=WIDTH_PX, description="px")


@settings
class Restart:
    """When the search restarts; not in the source.

    A border fails in a frame if its objective is below `least_score`, if the borders are not `least_width_px`
    to `greatest_width_px` apart at the bottom of the image, or if they cross in the processed rows.
    """

    enabled: bool = True
    patience: int = Field(8, ge=1, description="failed frames in a row before the first stage is run again")
    least_score: float = Field(5.0, description="least objective F, grey levels")
    least_width_px: float = Field(
        200.0, gt=0, description="least width at the bottom row; 1.7 m for the default camera"
    )
    greatest_width_px: float = Field(
        650.0, gt=0, description="greatest width at the bottom row; 5.6 m for the default camera"
    )
    center_px: float = Field(160.0, description="image column of the vehicle's path at the bottom row")
    crossed_by_px: float = Field(
        30.0,
        ge=0,
        description="a border this far on the wrong side of center_px counts as crossed: a lane change",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.greatest_width_px <= self.least_width_px:
            raise ValueError(
                f"greatest_width_px = {self.greatest_width_px}: "
                f"must be above least_width_px = {self.least_width_px}"
            )
        return self


@settings
class GeneticSearch:
    """The published search; the defaults are the source's."""

    population: int = Field(50, ge=4, le=1000)
    crossover_rate: float = Field(0.45, ge=0, le=1)
    mutation_rate: float = Field(0.05, ge=0, le=1)
    generations: tuple[int, int, int] = Field(
        (180, 120, 25), description="number of generations of each stage, table 4"
    )
    transition_frames: int = Field(
        5, ge=0, description="number of frames after the first that use the second stage: frames 2 to 6"
    )
    first_left: Region = Region(a=(-0.005, 0.005), b=(0.3, 2.3), c=(-100.0, 150.0))
    first_right: Region = Region(a=(-0.005, 0.005), b=(-2.3, -0.3), c=(200.0, 450.0))
    transition: Reach = Reach(a=0.003, b=0.6, c=60.0)
    tracking: Reach = Reach(a=0.001, b=0.15, c=15.0)
    objective: Objective = Objective()
    restart: Restart = Restart()

    @model_validator(mode="after")
    def _searchable(self) -> Self:
        if min(self.generations) < 1 or max(self.generations) > 100_000:
            raise ValueError(f"generations = {self.generations}: each must be 1 to 100000")
        for side in (self.first_left, self.first_right):
            lengths = [
                bits_needed(high - low, m) for (low, high), m in zip(_pairs(side), DECIMALS, strict=True)
            ]
            if not 4 <= sum(lengths) <= MOST_BITS:
                raise ValueError(f"the first region needs {sum(lengths)} bits: allowed are 4 to {MOST_BITS}")
        return self


def fitted_to(search: GeneticSearch, camera: Camera) -> GeneticSearch:
    """The search adapted to a camera: at most as many blocks as below its horizon, `restart` in its pixels.

    Lengths in pixels are taken as those of the default camera, for which nothing changes. The published
    regions of interest are kept. Raises ValueError for a camera that sees too little road.
    """
    numbers = projection(camera)
    forward, _ = vehicle_from_image(camera.center_x_px, 0.0, numbers)
    center, _, _ = image_from_vehicle(forward, 0.0, 0.0, numbers)
    scale = camera.px_per_m(0.0) / Camera().px_per_m(0.0)  # in the bottom row
    blocks = min(search.objective.blocks, blocks_below_horizon(camera))
    return dataclasses.replace(
        search,
        objective=dataclasses.replace(
            search.objective, blocks=blocks, minimum_blocks=min(search.objective.minimum_blocks, blocks)
        ),
        restart=dataclasses.replace(
            search.restart,
            center_px=search.restart.center_px + float(center) - Camera().center_x_px,
            least_width_px=search.restart.least_width_px * scale,
            greatest_width_px=search.restart.greatest_width_px * scale,
            crossed_by_px=search.restart.crossed_by_px * scale,
        ),
    )


class SearchNumbers(NamedTuple):
    """The search's parameters as kernels take them."""

    population: int
    crossover_rate: float
    mutation_rate: float
    generations: Array  # (3,) int64 per stage
    transition_frames: int
    bits: Array  # (2, 3, 3) int64 side, stage, parameter
    first: Array  # (2, 3, 2) side, parameter, low and high
    reach: Array  # (2, 3) transition and tracking, parameter
    stencils: Array
    alpha: Array
    region: tuple[int, int, int]
    blocks: int
    minimum_blocks: int
    restarts: bool
    patience: int
    least_score: float
    least_width_px: float
    greatest_width_px: float
    center_px: float
    crossed_by_px: float


class SearchState(NamedTuple):
    """Search state of n vehicles."""

    key: Array  # (n,) uint64 of the random stream
    frame: Array  # (n,) int64 frames searched: position in the random stream
    age: Array  # (n, 2) int32 frames since the (re)start of the left and the right border
    failing: Array  # (n, 2) int32 frames in a row in which the border failed
    border: Array  # (n, 2, 3) last result, left and right; NaN before the first
    score: Array  # (n, 2) its objective F
    shifted: Array  # (n,) int8: +1 the last search moved to the lane on the left, -1 on the right


def bits_needed(width: float, decimals: int) -> int:
    """k of eq. 4, 2ᵏ⁻¹ < (x₂ - x₁)·10ᵐ < 2ᵏ; a width of exactly 2ᵏ steps, which eq. 4 leaves out, takes k."""
    return max(1, math.ceil(math.log2(round(width * 10**decimals, 6))))


def _pairs(region: Region) -> tuple[Interval, Interval, Interval]:
    return region.a, region.b, region.c


def search_numbers(search: GeneticSearch) -> SearchNumbers:
    """Kernel parameters of the search."""
    first = np.array([_pairs(search.first_left), _pairs(search.first_right)])
    reach = np.array([[r.a, r.b, r.c] for r in (search.transition, search.tracking)])
    widths = np.stack([first[:, :, 1] - first[:, :, 0], *(np.tile(2 * r, (2, 1)) for r in reach)], axis=1)
    bits = [
        [[bits_needed(w, m) for w, m in zip(row, DECIMALS, strict=True)] for row in side] for side in widths
    ]
    return kernel_view(
        SearchNumbers,
        search.restart,
        population=search.population,
        crossover_rate=search.crossover_rate,
        mutation_rate=search.mutation_rate,
        generations=np.array(search.generations, np.int64),
        transition_frames=search.transition_frames,
        bits=np.array(bits, np.int64),
        first=first,
        reach=reach,
        restarts=search.restart.enabled,
        **objective_numbers(search.objective)._asdict(),
    )


def init(keys: Array) -> SearchState:
    """State before the first frame; keys (n,) uint64 from `sumo_net.randomness.stream_key`."""
    n = len(keys)
    return SearchState(
        np.asarray(keys, np.uint64),
        np.zeros(n, np.int64),
        np.zeros((n, 2), np.int32),
        np.zeros((n, 2), np.int32),
        np.full((n, 2, 3), np.nan),
        np.full((n, 2), np.nan),
        np.zeros(n, np.int8),
    )


def search(frames: Array, state: SearchState, numbers: SearchNumbers) -> tuple[SearchState, Borders]:
    """Both borders in one frame of each of n vehicles.

    frames (n, 240, 320) uint8; numbers from `search_numbers`. Raises ValueError for frames of another shape
    or type, or another number than the state has.
    """
    check_frames(frames)
    if len(frames) != len(state.key):
        raise ValueError(f"frames: {len(frames)}: must be {len(state.key)}, one per vehicle of the state")
    after = SearchState(*(np.empty_like(part) for part in state))
    search_kernel(np.ascontiguousarray(frames), state, numbers, after)
    left, right = (np.ascontiguousarray(after.border[:, side]) for side in range(2))
    return after, Borders(left, right, after.score.copy())
