"""Commands that measure: `reproduce`, `evaluate`."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import Out, plain_errors, told_where


class Experiment(enum.StrEnum):
    """Published experiments."""

    IMM = "imm"
    ADAPTIVE = "adaptive"


def reproduce(
    experiment: Annotated[Experiment, typer.Argument(help="Of the sources.", metavar="NAME")],
    out: Out = Path("out/reproduce"),
) -> None:
    """Run a published experiment, imm or adaptive: its table, curves and plot."""
    import importlib

    with plain_errors(), told_where(out):
        table = importlib.import_module(f"analysis.published.{experiment.value}").reproduce(out)
        typer.echo(table.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
        typer.echo(f"Tables and plot: {out}")


def evaluate(
    out: Out = Path("out/evaluation"),
    seeds: Annotated[int, typer.Option("--seeds", help="How many seeds.", min=1, metavar="N")] = 10,
    first_seed: Annotated[
        int, typer.Option("--first-seed", help="The first of them.", min=0, metavar="N")
    ] = 100,
    duration: Annotated[
        float,
        typer.Option("--duration", help="Seconds simulated a run.", min=0.1, max=86_400, metavar="S"),
    ] = 60.0,
    equip: Annotated[
        float, typer.Option("--equip", help="Share of equipped vehicles.", min=0, max=1, metavar="FRACTION")
    ] = 0.1,
    workers: Annotated[int, typer.Option("--workers", help="Runs at once.", min=1, metavar="N")] = 2,
    scenario: Annotated[str, typer.Option("--scenario", help="As for run.", metavar="SCENARIO")] = "highway",
) -> None:
    """Measure accuracy over many seeds, in clear and complex conditions, against the stated targets."""
    from analysis.evaluation import evaluate as measure

    with plain_errors():
        measure(out, scenario, range(first_seed, first_seed + seeds), duration, equip, workers)
