"""The road of a run as lines for a map: the lanes of its network file, if known."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.report.reading import RunTables
from plugin.configuration import configuration_from
from sumo_net.arrays import Array
from sumo_net.configuration import read_configuration
from sumo_net.lane_graph import NetworkError
from sumo_net.lane_graph import read as read_lane_graph
from sumo_net.network import BuiltNetwork
from sumo_net.scenario import road
from sumo_net.settings import SettingsError

MARGIN_M = 150.0  # the network is shown this far around the driven paths
MOST_POINTS = 30_000  # more would make the page heavy; the outline is then left out


def outline(run: RunTables) -> list[Array]:
    """(N, 2) lane centre lines in the coordinates of `true_x_m`, near the driven paths.

    Empty if the settings or the network file are missing, which the run's notes then say.
    """
    steps = run["steps"]
    x, y = steps["true_x_m"].dropna(), steps["true_y_m"].dropna()
    if x.empty:
        return []
    if not run.settings:
        run.notes.append("Without configuration.json the network is unknown: the map shows only driven paths")
        return []
    try:
        with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
            lanes = _lanes(run.settings, Path(work))
    except (SettingsError, NetworkError, OSError, ValueError, KeyError) as error:
        run.notes.append(f"The network cannot be shown ({error}): the map shows only driven paths")
        return []
    low = np.array([x.min(), y.min()]) - MARGIN_M
    high = np.array([x.max(), y.max()]) + MARGIN_M
    near = [line for line in lanes if ((line >= low) & (line <= high)).all(axis=1).any()]
    if sum(len(line) for line in near) > MOST_POINTS:
        run.notes.append("The network is too large for the page: the map shows only driven paths")
        return []
    return near


def _lanes(settings: Mapping[str, Any], work: Path) -> list[Array]:
    configuration = configuration_from(settings, "configuration.json")
    if configuration.configuration:
        file = Path(read_configuration(Path(configuration.configuration), work)["net-file"])
    else:
        found = road(configuration, work)
        file = found.net_file if isinstance(found, BuiltNetwork) else found
    graph = read_lane_graph(file)
    return [lane.shape for lane in graph.lanes.values() if lane.drivable]
