"""Common parts of the commands: options, and errors as one line on standard error."""

import contextlib
import enum
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)

Out = Annotated[Path, typer.Option("--out", help="Directory for the tables.", file_okay=False, metavar="DIR")]


_HELD = {"run": "configuration.json", "campaign": "plan.json"}


class Mode(enum.StrEnum):
    """The chain to run."""

    PAPER = "paper"
    REFINED = "refined"


class Format(enum.StrEnum):
    """File formats of tables."""

    CSV = "csv"
    PARQUET = "parquet"
    BOTH = "both"


@contextlib.contextmanager
def plain_errors() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # who reads, as head does, has seen enough
        raise
    except OSError as error:
        named = error.filename is not None and error.strerror
        errors.print(f"error: {error.filename}: {error.strerror}" if named else f"error: {error}")
        raise typer.Exit(2) from None
    except (SettingsError, TrafficError, ValueError) as error:
        errors.print(f"error: {error}")
        raise typer.Exit(2) from None


def refuse_to_mix(out: Path, *kinds: Literal["run", "campaign"]) -> None:
    """Refuse a directory that holds tables which would be overwritten, or shown with others."""
    for kind in kinds:
        if (out / _HELD[kind]).exists():
            raise SettingsError(f"{out}: holds a {kind}'s tables: name another --out")


@contextlib.contextmanager
def told_of_compiling() -> Iterator[None]:
    """Says once that kernels are compiled, where that has to be done."""
    from numba.core import event

    class Teller(event.Listener):
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                errors.print("compiling, once, up to a minute")

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Teller()):
        yield


@contextlib.contextmanager
def told_where(out: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        errors.print(f"interrupted: the rows so far are in {out}" if out.exists() else "interrupted")
        raise typer.Exit(130) from None
