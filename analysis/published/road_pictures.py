"""Pictures of the road runs: the tracks and errors, and a frame with the path of the next 2 s drawn in."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.published.road import Measured
from analysis.published.road_drives import (
    CAMERA,
    HORIZON_S,
    RUNS,
    STILL_S,
    RoadRuns,
    frames_of,
    still_step,
    truth_of,
)
from camera_synth.camera import image_from_vehicle, projection
from camera_synth.render import new_frames

_STYLES: dict[str, dict[str, Any]] = {
    "driven": {"color": "white", "lw": 3},
    "paper": {"color": "tab:blue", "ls": "--"},
    "refined": {"color": "tab:orange", "ls": "--"},
}


def draw(out: Path, measured: Measured, experiment: RoadRuns) -> None:
    """road.png and road_frames.png."""
    _tracks(out / "road.png", measured.steps)
    _frames(out / "road_frames.png", measured.paths, experiment)


def _tracks(path: Path, step: pd.DataFrame) -> None:
    from matplotlib.figure import Figure  # slow to import, and needed only here

    figure = Figure(figsize=(12, 6.5), layout="constrained")
    axes = figure.subplots(2, len(RUNS))
    for k, run in enumerate(RUNS):
        of_run = step[step["run"] == run.title]
        first = of_run[of_run["car"] == 0]
        truth = first[first["chain"] == "paper"]
        axes[0, k].plot(truth["time_s"], truth["true_lateral_offset_m"], "k", lw=2.5, label="driven")
        for chain, one in first.groupby("chain", sort=False):
            axes[0, k].plot(one["time_s"], one["lateral_offset_m"], "--", label=f"observed, {chain}")
        axes[0, k].axvspan(STILL_S, STILL_S + HORIZON_S, color="0.9", zorder=0)
        axes[0, k].set(title=run.title, xlabel="time in s", ylim=(-0.8, 0.8))
        for chain, one in of_run.groupby("chain", sort=False):
            error = one["lateral_error_m"].abs().dropna().sort_values()
            axes[1, k].plot(error, np.linspace(0, 100, len(error)), label=str(chain))
        axes[1, k].set(xlabel="|lateral error| of the path 2 s ahead in m", xlim=(0, 2), ylim=(0, 100))
    axes[0, 0].set_ylabel("offset left of the lane's centre in m, car 0")
    axes[1, 0].set_ylabel("share of steps in %")
    axes[0, 0].legend(fontsize=8)
    axes[1, 0].legend(fontsize=8)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


def _frames(path: Path, paths: pd.DataFrame, experiment: RoadRuns) -> None:
    from matplotlib.figure import Figure  # slow to import, and needed only here

    figure = Figure(figsize=(12, 3.4), layout="constrained")
    axes = figure.subplots(1, len(RUNS))
    for axis, run in zip(axes, RUNS, strict=True):
        frames = new_frames(experiment.cars)
        frames_of(truth_of(run, experiment), experiment, still_step(experiment), frames)
        axis.imshow(frames[0], cmap="gray", vmin=0, vmax=255)
        for name, one in paths[paths["run"] == run.title].groupby("path", sort=False):
            style = _STYLES[str(name)]
            axis.plot(*_in_image(one["forward_m"].to_numpy(), one["left_m"].to_numpy()), label=name, **style)
        axis.set(title=run.title, xlim=(0, 319), ylim=(239, 0), xticks=[], yticks=[])
    axes[0].legend(fontsize=7, loc="upper left")
    figure.savefig(path, dpi=120)


def _in_image(forward: np.ndarray, left: np.ndarray) -> tuple[list[float], list[float]]:
    p = projection(CAMERA)
    points = [image_from_vehicle(x, y, 0.0, p) for x, y in zip(forward, left, strict=True)]
    return [point[0] for point in points], [239.0 - point[1] for point in points]
