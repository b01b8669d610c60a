"""Commands on recorded input: `detect`, `calibrate`, `track`."""

import enum
import math
from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import Mode, Out, plain_errors, refuse_to_mix, told_of_compiling, told_where


class LogFormat(enum.StrEnum):
    """Readable radar log formats."""

    CSV = "csv"
    COMMA2K19 = "comma2k19"
    UDACITY = "udacity"


def detect(
    source: Annotated[
        Path, typer.Argument(help="A video, a folder of images, or an image.", metavar="SOURCE")
    ],
    camera: Annotated[
        Path, typer.Option("--camera", help="Camera file, as written by `calibrate`.", metavar="FILE")
    ],
    out: Out = Path("out"),
    overlay: Annotated[
        Path | None,
        typer.Option("--overlay", help="Write a video with borders and predicted path.", metavar="FILE"),
    ] = None,
    mode: Annotated[
        Mode, typer.Option(help="paper: the published search; refined: the default tracker.")
    ] = Mode.REFINED,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            help="Speed of the vehicle in m/s; adds times to lane crossing and warnings.",
            min=0,
            max=100,
            metavar="V",
        ),
    ] = None,
    frame_rate: Annotated[
        float,
        typer.Option(
            "--frame-rate",
            help="Images of a folder per second; of a video, where its file does not say.",
            min=1,
            max=1000,
            metavar="HZ",
        ),
    ] = 10.0,
) -> None:
    """Find the lane in recorded footage."""
    from analysis.footage import open_footage
    from analysis.recorded import detect as detect_lanes
    from analysis.recorded import summary

    with plain_errors(), told_where(out), told_of_compiling():
        refuse_to_mix(out, "run", "campaign")
        detect_lanes(source, camera, out, overlay, mode.value, speed, 1.0 / frame_rate)
        for line in summary(out, open_footage(source)):
            typer.echo(line)
        typer.echo(f"Tables: {out}")


def calibrate(
    images: Annotated[
        list[Path], typer.Argument(help="One or more images of a straight road.", metavar="IMAGE...")
    ],
    lane_width: Annotated[
        float, typer.Option("--lane-width", help="Width of the ego lane in m.", metavar="M")
    ] = 3.7,
    height: Annotated[
        float | None,
        typer.Option(
            "--height", help="Height of the camera in m, if known; else from the lane width.", metavar="M"
        ),
    ] = None,
    field_of_view: Annotated[
        float,
        typer.Option(
            "--field-of-view",
            help="Horizontal field of view in degrees, which no picture shows.",
            min=6,
            max=140,
            metavar="DEG",
        ),
    ] = 60.0,
) -> None:
    """Propose a camera file, as TOML on standard output."""
    from analysis.calibrate import calibrate as propose

    with plain_errors(), told_of_compiling():
        typer.echo(propose(images, lane_width, height, math.radians(field_of_view)))


def track(
    log: Annotated[
        Path, typer.Argument(help="One detection per row, or as the format requires.", metavar="LOG")
    ],
    out: Out = Path("out"),
    filter_name: Annotated[
        str, typer.Option("--filter", help="Tracking filter: imm, adaptive, patent, cv, ca.", metavar="NAME")
    ] = "imm",
    log_format: Annotated[LogFormat, typer.Option("--format", help="Format of the log.")] = LogFormat.CSV,
    own_association: Annotated[
        bool,
        typer.Option("--own-association", help="Associate detections even where the log gives the targets."),
    ] = False,
) -> None:
    """Track the objects of a recorded radar log."""
    from analysis.radar_formats import track_recording
    from analysis.radar_log import rmse

    with plain_errors(), told_where(out), told_of_compiling():
        refuse_to_mix(out, "run", "campaign")
        table = track_recording(log, out, filter_name, log_format.value, own_association)
        typer.echo(f"{'tracks':21} {table['track_id'].nunique()}")
        if table.empty:
            typer.echo("note: no object was seen in scans that follow one another closely enough")
        for name, value in rmse(table).items():
            typer.echo(f"RMSE {name:16} {value:.4f}")
        typer.echo(f"Tables: {out}")
