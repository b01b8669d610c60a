"""Commands that measure: `reproduce`, `evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import Out, plain_errors, told_of_compiling, told_where


def reproduce(
    experiment: Annotated[
        str, typer.Argument(help="A published experiment, or all.", metavar="NAME", show_default=False)
    ] = "",
    out: Out = Path("out/reproduce"),
    listed: Annotated[bool, typer.Option("--list", help="List the experiments and exit.")] = False,
) -> None:
    """Run a published experiment: published and measured values, curves and pictures."""
    from analysis.published import comparison
    from analysis.published.experiments import EXPERIMENTS, reproduce_all
    from analysis.published.experiments import reproduce as run

    with plain_errors(), told_where(out), told_of_compiling():
        if listed:
            width = max(map(len, EXPERIMENTS))
            typer.echo("\n".join(f"{name:{width}}  {title}" for name, title in EXPERIMENTS.items()))
            return
        if not experiment:
            raise ValueError(f"which experiment? Known are {', '.join(EXPERIMENTS)}, all")
        if experiment != "all":
            typer.echo(comparison.text(run(experiment, out)))
            typer.echo(f"Tables and pictures: {out}")
            return
        for name, one in reproduce_all(out).groupby("experiment", sort=False):
            typer.echo(f"\n{name}: {EXPERIMENTS[str(name)]}")
            typer.echo(comparison.text(one.drop(columns="experiment")))
        typer.echo(f"\nTables and pictures: {out}")


def evaluate(
    out: Out = Path("out/evaluation"),
    seeds: Annotated[int, typer.Option("--seeds", help="Number of seeds.", min=1, metavar="N")] = 10,
    first_seed: Annotated[
        int, typer.Option("--first-seed", help="The first seed.", min=0, metavar="N")
    ] = 100,
    duration: Annotated[
        float,
        typer.Option("--duration", help="Simulated seconds per run.", min=0.1, max=86_400, metavar="S"),
    ] = 60.0,
    equip: Annotated[
        float, typer.Option("--equip", help="Share of equipped vehicles.", min=0, max=1, metavar="FRACTION")
    ] = 0.1,
    workers: Annotated[int, typer.Option("--workers", help="Runs at once.", min=1, metavar="N")] = 2,
    scenario: Annotated[
        str, typer.Option("--scenario", help="Scenario, as for run.", metavar="SCENARIO")
    ] = "highway",
) -> None:
    """Measure accuracy over many seeds, in clear and complex conditions, against the stated targets."""
    from analysis.evaluation import evaluate as measure

    with plain_errors():
        measure(out, scenario, range(first_seed, first_seed + seeds), duration, equip, workers)
