"""Commands that draw tables: `report`, `plot`."""

from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import errors, plain_errors


def report(
    directory: Annotated[
        Path, typer.Argument(help="Directory of a run, a campaign or a recorded drive.", metavar="DIR")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="The page; default: DIR/report.html.", metavar="FILE")
    ] = None,
    vehicle: Annotated[
        list[str] | None,
        typer.Option(
            "--vehicle",
            help="Vehicle that the viewer shows (may be repeated); by default those with frames, else "
            "the one with most events.",
            metavar="ID",
        ),
    ] = None,
    frames: Annotated[
        bool,
        typer.Option(
            "--frames/--no-frames",
            help="With the drive viewer; a run that kept no frames is repeated, which takes time.",
        ),
    ] = True,
) -> None:
    """Write one HTML page, for any browser and offline, that shows the contents of DIR."""
    from analysis.report import write_report

    with plain_errors():
        page = write_report(directory, out, vehicles=vehicle or (), frames=frames, tell=errors.print)
        typer.echo(f"Page: {page} ({page.stat().st_size / 1e6:.1f} MB)")


def plot(
    directory: Annotated[
        Path | None, typer.Argument(help="Directory of the tables.", metavar="DIR", show_default=False)
    ] = None,
    name: Annotated[
        str, typer.Argument(help="Name of the figure, see --list.", metavar="NAME", show_default=False)
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="A .png, .svg or .pdf; default: NAME.png.", metavar="FILE"),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle", help="Vehicle of the timeline; by default the one with most events.", metavar="ID"
        ),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the figures and exit.")] = False,
) -> None:
    """Draw one figure of a run, a campaign, a recorded drive, or of the published sources."""
    from analysis.plots.catalogue import PLOTS, draw, write

    with plain_errors():
        if listed:
            for source in dict.fromkeys(one.source for one in PLOTS.values()):
                typer.echo(f"{source}:")
                for key, one in PLOTS.items():
                    if one.source == source:
                        typer.echo(f"  {key:17} {one.title}")
            return
        if directory is None or not name:
            raise ValueError("plot needs DIR and NAME: `sumo-adas plot --list` lists the names")
        target = out if out is not None else Path(f"{name}.png")
        typer.echo(f"Figure: {write(draw(directory, name, vehicle), target)}")
