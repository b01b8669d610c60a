"""Commands that run SUMO: `run`, `scenarios`."""

from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import Format, Mode, Out, plain_errors, told_where


def run(
    scenario: Annotated[
        str,
        typer.Argument(
            help="Built-in name, FILE.toml, FILE.sumocfg, or a road: FILE.net.xml, .osm or .xodr.",
            metavar="SCENARIO",
        ),
    ] = "highway",
    out: Out = Path("out"),
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=2**31 - 1, metavar="N", help="Of traffic, drivers, sensors; else the scenario's."
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.1, max=86_400, metavar="S", help="Seconds; else the scenario's.")
    ] = None,
    equip: Annotated[
        float | None,
        typer.Option(
            min=0, max=1, metavar="FRACTION", help="Share of equipped vehicles; else the scenario's."
        ),
    ] = None,
    mode: Annotated[
        Mode | None,
        typer.Option(help="The published chain as it is, or the default one; else the scenario's."),
    ] = None,
    table_format: Annotated[Format, typer.Option("--format", help="Of the tables.")] = Format.CSV,
    compare_paper: Annotated[
        bool, typer.Option("--compare-paper", help="Also judge the published search on every frame.")
    ] = False,
    frames: Annotated[
        int | None,
        typer.Option(
            min=0, max=1000, metavar="N", help="Keep the camera frames of N vehicles, the first on the road."
        ),
    ] = None,
    gui: Annotated[
        bool, typer.Option("--gui", help="In SUMO's own window; the followed vehicle's camera in --out.")
    ] = False,
    delay: Annotated[
        int, typer.Option("--delay", min=0, max=10_000, metavar="MS", help="Of a step, with --gui.")
    ] = 100,
) -> None:
    """Run a scenario in SUMO, write the tables and print a summary.

    With --gui it runs in sumo-gui, in a process of its own that is spoken to over traci: libsumo, which runs
    SUMO inside this process, is built without a window. The tables are the same; docs/gui.md.
    """
    from analysis.simulate import Window, simulate
    from analysis.summary import print_summary

    with plain_errors(), told_where(out):
        directory = simulate(
            scenario,
            out,
            seed=seed,
            duration_s=duration,
            fraction=equip,
            mode=None if mode is None else mode.value,
            formats=("csv", "parquet") if table_format is Format.BOTH else (table_format.value,),
            compare_paper=compare_paper,
            frames=frames,
            window=Window(delay) if gui else None,
        )
        print_summary(directory)


def scenarios() -> None:
    """List the built-in scenarios."""
    from sumo_net.scenario import list_scenarios

    for name, title in list_scenarios():
        typer.echo(f"{name:14} {title}")
