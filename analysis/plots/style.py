"""Common style of all figures: colours for colour-blind readers, sizes that fit a phone.

The palette is that of Okabe and Ito. No figure relies on colour alone: lines also differ in dashes, points in
markers, bars in hatches.
"""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLACK, GREY = "#1a1a1a", "#767676"
BLUE, SKY, GREEN = "#0072B2", "#56B4E9", "#009E73"
ORANGE, VERMILLION, PURPLE = "#E69F00", "#D55E00", "#CC79A7"
SERIES = (
    (BLUE, "-", "o"),
    (VERMILLION, "--", "s"),
    (GREEN, "-.", "^"),
    (ORANGE, ":", "D"),
    (PURPLE, (0, (5, 1, 1, 1, 1, 1)), "v"),
    (BLACK, (0, (3, 1)), "x"),
)
WIDTH_IN = 5.0  # a card of the report, as wide as a phone
_STYLE = {
    "axes.axisbelow": True,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.labelcolor": BLACK,
    "axes.labelsize": 9.5,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "figure.facecolor": "white",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "grid.color": "#e3e3e3",
    "hatch.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "savefig.dpi": 160,
    "svg.fonttype": "none",
    "svg.hashsalt": "sumo-adas",
    "text.parse_math": False,  # a vehicle's id may contain a dollar sign
    "xtick.color": BLACK,
    "ytick.color": BLACK,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}

_Given = ParamSpec("_Given")


def styled(draw: Callable[_Given, Figure]) -> Callable[_Given, Figure]:
    """Draw in the project's style, whatever the surrounding notebook has set."""

    @functools.wraps(draw)
    def inside(*args: _Given.args, **kwargs: _Given.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
            return draw(*args, **kwargs)

    return inside


def sheet(
    rows: int = 1, columns: int = 1, height_in: float = 3.2, width_in: float = WIDTH_IN, **options: Any
) -> tuple[Figure, Any]:
    """An empty figure and its axes, as `Figure.subplots` gives them."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def nothing(axes: Axes, why: str) -> None:
    """Write into empty axes why they are empty."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, why, ha="center", va="center", color=GREY, wrap=True, transform=axes.transAxes)


def blank_sheet(why: str) -> Figure:
    """A low figure that says why there is nothing to draw."""
    figure, axes = sheet(1, 1, 2.0)
    nothing(axes, why)
    return figure


def below(axes: Axes, columns: int = 2, lift: float = -0.2) -> None:
    """Put the legend below the axes."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, lift), ncols=columns, handlelength=2.6)


def save(figure: Figure, target: Any, file_format: str) -> None:
    """Write a figure as png, svg or pdf, the same bytes for the same figure. Raises OSError."""
    metadata = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figure.savefig(target, format=file_format, metadata=metadata.get(file_format))
