"""A frame of each road run with the path of the next 2 s, driven and predicted."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from analysis.plots.published import PATH_STYLES
from analysis.plots.style import sheet, styled
from analysis.published.road_drives import CAMERA, RUNS, RoadRuns, frames_of, still_step, truth_of
from camera_synth.camera import image_from_vehicle, projection
from camera_synth.render import new_frames


@styled
def draw(paths: pd.DataFrame, experiment: RoadRuns) -> Figure:
    """The picture; `paths` as road.Measured has them."""
    figure, all_axes = sheet(1, len(RUNS), 2.9, width_in=9.6)
    for axes, run in zip(all_axes, RUNS, strict=True):
        frames = new_frames(experiment.cars)
        frames_of(truth_of(run, experiment), experiment, still_step(experiment), frames)
        axes.imshow(frames[0], cmap="gray", vmin=0, vmax=255)
        of_run = paths[paths["run"] == run.title]
        for name, (label, colour, dashes) in PATH_STYLES.items():
            one = of_run[of_run["path"] == name]
            columns, rows = _in_image(one["forward_m"].to_numpy(), one["left_m"].to_numpy())
            axes.plot(columns, rows, color=colour, linestyle=dashes, label=label)
        axes.set(title=run.title, xlim=(0, 319), ylim=(239, 0), xticks=[], yticks=[])
        axes.grid(False)
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _in_image(forward: np.ndarray, left: np.ndarray) -> tuple[list[float], list[float]]:
    p = projection(CAMERA)
    points = [image_from_vehicle(x, y, 0.0, p) for x, y in zip(forward, left, strict=True)]
    return [point[0] for point in points], [239.0 - point[1] for point in points]
