"""Figures from tables, as matplotlib Figures: for notebooks, the command `plot` and the report page.

from analysis import plots

plots.prediction_error(adas.tables["predictions"])        # from tables at hand
plots.draw("out/demo", "timeline", vehicle="forward_0.3")  # by name, from a directory
"""

from analysis.plots.campaign import benefit, rates, roc, shares, times
from analysis.plots.catalogue import PLOTS, draw, write
from analysis.plots.drive import road_map, timeline
from analysis.plots.published import adaptive, correction, imm, observer, road
from analysis.plots.recording import lanes, tracks
from analysis.plots.run import (
    motion_classes,
    prediction_by_category,
    prediction_error,
    recognition,
    tlc_error,
    ttc_error,
    warning_outcomes,
)

__all__ = [
    "PLOTS",
    "adaptive",
    "benefit",
    "correction",
    "draw",
    "imm",
    "lanes",
    "motion_classes",
    "observer",
    "prediction_by_category",
    "prediction_error",
    "rates",
    "recognition",
    "road",
    "road_map",
    "roc",
    "shares",
    "timeline",
    "times",
    "tlc_error",
    "tracks",
    "ttc_error",
    "warning_outcomes",
    "write",
]
