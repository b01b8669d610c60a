"""Commands that show a drive: `video`."""

from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import errors, plain_errors


def video(
    directory: Annotated[Path, typer.Argument(help="Directory of a run's tables.", metavar="DIR")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="A video (.mp4, .webm, .mkv, .mov, .avi) or a still (.png, .jpg); default: DIR/drive.mp4.",
            metavar="FILE",
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option("--vehicle", help="SUMO's id; default: the vehicle with most departures.", metavar="ID"),
    ] = None,
    begin: Annotated[float | None, typer.Option("--from", help="SUMO time.", metavar="S")] = None,
    end: Annotated[float | None, typer.Option("--to", help="SUMO time.", metavar="S")] = None,
) -> None:
    """Show a drive: camera with borders and predicted path, warnings, bird's-eye view with radar tracks.

    If the run kept no frames (run --frames N), it is repeated to make them.
    """
    from analysis.video import make_video

    with plain_errors():
        file = out or directory / "drive.mp4"
        drive = make_video(directory, file, vehicle, begin, end, tell=errors.print)
        typer.echo(f"{drive.vehicle_id}: {file}")
