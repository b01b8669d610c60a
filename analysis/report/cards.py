"""The parts of a page: figures with alternative text, tables, notes."""

import base64
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import pandas as pd
from matplotlib.figure import Figure

from analysis.plots.style import save


@dataclass(frozen=True, slots=True)
class Card:
    """One figure of the page."""

    title: str
    text: str  # description, also for screen readers
    picture: str = ""  # base64 of an SVG
    missing: str = ""  # why there is no picture
    wide: bool = False


@dataclass(frozen=True, slots=True)
class Grid:
    """A table on the page; the first column names the row."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    text: str = ""
    folded: bool = False


@dataclass(slots=True)
class Page:
    """Contents of a page; strings are plain text, escaped when the page is written."""

    title: str
    subtitle: str = ""
    facts: list[tuple[str, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    figures: list[Grid] = field(default_factory=list)  # above the pictures
    cards: list[Card] = field(default_factory=list)
    events: list[Grid] = field(default_factory=list)  # below them
    settings: str = ""
    scene: dict[str, object] | None = None  # data of map and timeline
    drives: list[dict[str, object]] = field(default_factory=list)  # data of the viewer


def card(title: str, text: str, draw: Callable[[], Figure], wide: bool = False) -> Card:
    """Draw a figure for the page, or say why it cannot be drawn, as from tables of another version."""
    try:
        figure = draw()
        picture = io.BytesIO()
        save(figure, picture, "svg")
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as error:
        return Card(title, text, missing=f"cannot be drawn from these tables: {error}", wide=wide)
    return Card(title, text, picture=base64.b64encode(picture.getvalue()).decode(), wide=wide)


def grid_of(table: pd.DataFrame, title: str, columns: Iterable[str], most: int, text: str = "") -> Grid:
    """The first `most` rows of a table as text."""
    shown = [name for name in columns if name in table.columns]
    rows = [[cell(value) for value in row] for row in table[shown].head(most).itertuples(index=False)]
    more = f"The first {most} of {len(table)}. " if len(table) > most else ""
    return Grid(title, shown, rows, more + text, folded=True)


def cell(value: object) -> str:
    """A table's value as readable text; empty if unknown."""
    if value is None or value is pd.NA or value != value:
        return ""
    if isinstance(value, float):
        return f"{value:.3f}".rstrip("0").rstrip(".")
    return str(value)
