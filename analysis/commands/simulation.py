"""Commands that run SUMO: `run`, `scenarios`."""

from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import Format, Mode, Out, plain_errors, refuse_to_mix, told_where


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
            min=0,
            max=2**31 - 1,
            metavar="N",
            help="Random seed of traffic, drivers and sensors; default: the scenario's.",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.1, max=86_400, metavar="S", help="Simulated seconds; default: the scenario's."),
    ] = None,
    equip: Annotated[
        float | None,
        typer.Option(
            min=0, max=1, metavar="FRACTION", help="Share of equipped vehicles; default: the scenario's."
        ),
    ] = None,
    mode: Annotated[
        Mode | None,
        typer.Option(help="paper: the published chain; refined: the default one. Default: the scenario's."),
    ] = None,
    table_format: Annotated[Format, typer.Option("--format", help="Format of the tables.")] = Format.CSV,
    compare_paper: Annotated[
        bool, typer.Option("--compare-paper", help="Also evaluate the published search on every frame.")
    ] = False,
    frames: Annotated[
        int | None,
        typer.Option(
            min=0, max=1000, metavar="N", help="Keep the camera frames of the first N vehicles on the road."
        ),
    ] = None,
    gui: Annotated[
        bool,
        typer.Option(
            "--gui", help="Show SUMO's own window; the followed vehicle's camera is written to --out."
        ),
    ] = False,
    delay: Annotated[
        int,
        typer.Option(
            "--delay", min=0, max=10_000, metavar="MS", help="Delay of each step in ms, with --gui."
        ),
    ] = 100,
) -> None:
    """Run a scenario in SUMO, write the tables and print a summary.

    With --gui it runs in sumo-gui, as a process of its own that is controlled through traci, because libsumo,
    which runs SUMO inside this process, has no window. The tables are the same; see docs/gui.md.
    """
    from analysis.simulate import Window, simulate
    from analysis.summary import print_summary

    with plain_errors(), told_where(out):
        refuse_to_mix(out, "campaign")
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
