"""Time of the published lane search per frame (Zhang et al. 2011, table 4): 180, 120, 25 generations.

Frames are rendered from gentle bends with solid and dashed borders and searched as in a run: frame 1, frames
2 to 6, later frames. Measured is the processor time of one thread for both borders, block maps included; the
source does not name its computer.
"""

import time
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import Field

from analysis.published import comparison
from camera_synth.camera import PROCESSED_FROM, Camera, projection
from camera_synth.condition import looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from plugin.lane import genetic
from sumo_net.plain_road import no_objects, road_ahead
from sumo_net.randomness import stream_key
from sumo_net.settings import settings

CLASSES = ("frame 1", "frames 2 to 6", "later frames")
PRINTED_MS = (210.0, 150.0, 30.0)
PRINTED_GENERATIONS = (180, 120, 25)
_STEP_M = 2.5


@settings
class SearchTimes:
    """Number of frames and repeats."""

    vehicles: int = Field(32, ge=1, le=256, description="frames searched in one call")
    later_frames: int = Field(20, ge=1, le=1000)
    repeats: int = Field(3, ge=1, le=100)
    condition: str = Field("clear", description="preset of camera_synth.condition")
    seed: int = Field(1, ge=0)


def times(experiment: SearchTimes) -> pd.DataFrame:
    """One row per repeat and frame: class, ms of processor time (both borders), generations."""
    n = experiment.vehicles
    keys = np.array([stream_key(experiment.seed, f"car {i}", "camera") for i in range(n)], np.uint64)
    numbers = genetic.search_numbers(genetic.GeneticSearch())
    shots = [frames_at(experiment, keys, k) for k in range(6 + experiment.later_frames)]
    genetic.search(shots[0], genetic.init(keys), numbers)  # compiles the kernels if necessary
    rows = []
    for repeat in range(experiment.repeats):
        state = genetic.init(keys + np.uint64(repeat))
        for k, frames in enumerate(shots):
            kind = 0 if k == 0 else 1 if k < 6 else 2
            begin = time.process_time()
            state, _ = genetic.search(frames, state, numbers)
            spent = time.process_time() - begin
            rows.append(
                {
                    "repeat": repeat,
                    "frame": k + 1,
                    "class": CLASSES[kind],
                    "ms": 1e3 * spent / n,
                    "published_ms": PRINTED_MS[kind],
                    "generations": int(numbers.generations[kind]),
                }
            )
    return pd.DataFrame(rows)


def compare(measured: pd.DataFrame) -> pd.DataFrame:
    """Medians of the frame classes and table 4."""
    rows = []
    for kind, printed_ms, generations in zip(CLASSES, PRINTED_MS, PRINTED_GENERATIONS, strict=True):
        of_kind = measured[measured["class"] == kind]
        rows.append(
            comparison.row(
                kind, "generations", "", float(of_kind["generations"].iloc[0]), generations, "printed"
            )
        )
        rows.append(
            comparison.row(
                kind, "time a frame, both borders", "ms", of_kind["ms"].median(), printed_ms, "printed"
            )
        )
    return comparison.table(rows)


def reproduce(out: Path, experiment: SearchTimes | None = None) -> pd.DataFrame:
    """Write search-times.csv, search-times.png and the comparison into `out`; return the comparison."""
    measured = times(experiment or SearchTimes())
    return comparison.write(out, "search-times", {"search-times.csv": measured}, compare(measured))


def frames_at(experiment: SearchTimes, keys: np.ndarray, k: int) -> np.ndarray:
    """The k-th frames (n, 240, 320) of n cars, each at its own position on its own bend."""
    n = len(keys)
    curvature = np.linspace(-1e-3, 1e-3, n)
    offset = 0.3 * np.sin(np.arange(n))
    station = 1000.0 + 137.0 * np.arange(n) + _STEP_M * k
    frames, straight_on = new_frames(n), np.zeros(n)
    ahead = road_ahead(curvature, 0.0, offset, 0.0, station)
    pose = Pose(station, offset, straight_on)
    condition = looks(preset(experiment.condition), n)
    counter = np.full(n, k, np.int64)
    render(frames, projection(Camera()), ahead, no_objects(n), pose, condition, keys, counter, PROCESSED_FROM)
    return frames
