"""The command `sumo-adas`."""

import contextlib
import enum
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

app = typer.Typer(
    invoke_without_command=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
)
_errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
# typer has a copy of click in its newer releases: this class is where both have it
_UsageError: Any = typer.BadParameter.__base__


class Mode(enum.StrEnum):
    """Which chain runs."""

    PAPER = "paper"
    REFINED = "refined"


class Filter(enum.StrEnum):
    """The radar tracker's filters."""

    IMM = "imm"
    ADAPTIVE = "adaptive"
    PATENT = "patent"
    CV = "cv"
    CA = "ca"


class Experiment(enum.StrEnum):
    """Published experiments."""

    IMM = "imm"
    ADAPTIVE = "adaptive"


class LogFormat(enum.StrEnum):
    """Radar logs that can be read."""

    CSV = "csv"
    COMMA2K19 = "comma2k19"
    UDACITY = "udacity"


class Format(enum.StrEnum):
    """How tables are written."""

    CSV = "csv"
    PARQUET = "parquet"
    BOTH = "both"


Out = Annotated[Path, typer.Option("--out", help="Directory for the tables.", file_okay=False, metavar="DIR")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: every expected error is one line on standard error and exit status 2."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ended by a batch system: rows are kept, too
    try:
        status = app(arguments, standalone_mode=False)
    except _UsageError as error:
        where = error.ctx.command_path if error.ctx else "sumo-adas"
        _errors.print(f"error: {_one_line(error.format_message())} (see {where} --help)")
        raise SystemExit(2) from None
    except (KeyboardInterrupt, typer.Abort):
        raise SystemExit(130) from None
    raise SystemExit(status)


@app.callback()
def about(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the versions and leave.")] = False,
) -> None:
    """Lane-departure warning for whole fleets in SUMO: runs, recorded footage, evaluation."""
    if version:
        from plugin.configuration import versions

        typer.echo(versions())
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@contextlib.contextmanager
def _plain_errors() -> Iterator[None]:
    try:
        yield
    except (SettingsError, TrafficError, ValueError, OSError) as error:
        _errors.print(f"error: {error}")
        raise typer.Exit(2) from None


@contextlib.contextmanager
def _told_where(out: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        _errors.print(f"interrupted: the rows so far are in {out}" if out.exists() else "interrupted")
        raise typer.Exit(130) from None


@app.command()
def run(
    scenario: Annotated[
        str, typer.Argument(help="Built-in name, FILE.toml or FILE.sumocfg.", metavar="SCENARIO")
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
) -> None:
    """Run a scenario in SUMO, write the tables and print a summary."""
    from analysis.simulate import simulate
    from analysis.summary import print_summary

    with _plain_errors(), _told_where(out):
        directory = simulate(
            scenario,
            out,
            seed=seed,
            duration_s=duration,
            fraction=equip,
            mode=None if mode is None else mode.value,
            formats=("csv", "parquet") if table_format is Format.BOTH else (table_format.value,),
            compare_paper=compare_paper,
        )
        print_summary(directory)


@app.command()
def scenarios() -> None:
    """List the built-in scenarios."""
    from sumo_net.scenario import list_scenarios

    for name, title in list_scenarios():
        typer.echo(f"{name:14} {title}")


@app.command()
def detect(
    source: Annotated[
        Path, typer.Argument(help="A video, a folder of images, or an image.", metavar="SOURCE")
    ],
    camera: Annotated[
        Path, typer.Option("--camera", help="Camera file, as `calibrate` proposes it.", metavar="FILE")
    ],
    out: Out = Path("out"),
    overlay: Annotated[
        Path | None,
        typer.Option("--overlay", help="Video with borders and predicted path.", metavar="FILE"),
    ] = None,
    mode: Annotated[Mode, typer.Option(help="The published search, or the default tracker.")] = Mode.REFINED,
    speed: Annotated[
        float, typer.Option("--speed", help="Speed of the vehicle in m/s.", min=0, max=100, metavar="V")
    ] = 25.0,
) -> None:
    """Find the lane in recorded footage."""
    from analysis.recorded import detect as detect_lanes

    with _plain_errors(), _told_where(out):
        detect_lanes(source, camera, out, overlay=overlay, mode=mode.value, speed_mps=speed)


@app.command()
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
            "--height", help="Height of the camera in m, where known; else from the lane width.", metavar="M"
        ),
    ] = None,
) -> None:
    """Propose a camera file, as TOML on standard output."""
    from analysis.calibrate import calibrate as propose

    with _plain_errors():
        typer.echo(propose(images, lane_width_m=lane_width, height_m=height))


@app.command()
def track(
    log: Annotated[Path, typer.Argument(help="A row a detection, or what the format says.", metavar="LOG")],
    out: Out = Path("out"),
    filter_name: Annotated[Filter, typer.Option("--filter", help="Of the tracker.")] = Filter.IMM,
    log_format: Annotated[LogFormat, typer.Option("--format", help="Of the log.")] = LogFormat.CSV,
    own_association: Annotated[
        bool, typer.Option("--own-association", help="Associate also where the log gives the targets.")
    ] = False,
) -> None:
    """Track the objects of a recorded radar log."""
    from analysis.radar_formats import track_recording
    from analysis.radar_log import rmse

    with _plain_errors(), _told_where(out):
        table = track_recording(log, out, filter_name.value, log_format.value, own_association)
        typer.echo(f"{'tracks':21} {table['track_id'].nunique()}")
        for name, value in rmse(table).items():
            typer.echo(f"RMSE {name:16} {value:.4f}")
        typer.echo(f"Tables: {out}")


@app.command()
def reproduce(
    experiment: Annotated[Experiment, typer.Argument(help="Of the sources.", metavar="NAME")],
    out: Out = Path("out/reproduce"),
) -> None:
    """Run a published experiment, imm or adaptive: its table, curves and plot."""
    import importlib

    with _plain_errors(), _told_where(out):
        table = importlib.import_module(f"analysis.published.{experiment.value}").reproduce(out)
        typer.echo(table.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
        typer.echo(f"Tables and plot: {out}")


@app.command(short_help="Measure accuracy over many seeds against the stated targets.")
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

    with _plain_errors():
        measure(out, scenario, range(first_seed, first_seed + seeds), duration, equip, workers)


def _one_line(text: str) -> str:
    return " ".join(text.replace("Value error, ", "").split())
