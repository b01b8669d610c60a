"""What the commands share: options, and errors as one line on standard error."""

import contextlib
import enum
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)

Out = Annotated[Path, typer.Option("--out", help="Directory for the tables.", file_okay=False, metavar="DIR")]


class Mode(enum.StrEnum):
    """Which chain runs."""

    PAPER = "paper"
    REFINED = "refined"


class Format(enum.StrEnum):
    """How tables are written."""

    CSV = "csv"
    PARQUET = "parquet"
    BOTH = "both"


@contextlib.contextmanager
def plain_errors() -> Iterator[None]:
    try:
        yield
    except (SettingsError, TrafficError, ValueError, OSError) as error:
        errors.print(f"error: {error}")
        raise typer.Exit(2) from None


@contextlib.contextmanager
def told_where(out: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        errors.print(f"interrupted: the rows so far are in {out}" if out.exists() else "interrupted")
        raise typer.Exit(130) from None
