"""The command `sumo-adas`."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
_errors = Console(stderr=True, highlight=False, markup=False)

Out = Annotated[Path, typer.Option("--out", help="Directory for the tables.", file_okay=False)]
Seed = Annotated[int, typer.Option("--seed", help="Seed of traffic, drivers and sensors.", min=0)]


def main() -> None:
    """Entry point: every expected error is one line on standard error and exit status 2."""
    try:
        app(standalone_mode=True)
    except KeyboardInterrupt:
        raise SystemExit(130) from None


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
        _errors.print(f"interrupted: the rows so far are in {out}")
        raise typer.Exit(130) from None


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(help="Built-in name, FILE.toml or FILE.sumocfg.")] = "highway",
    out: Out = Path("out"),
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Default: the scenario's.")] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", help="Seconds. Default: the scenario's.")
    ] = None,
    equip: Annotated[
        float | None, typer.Option("--equip", help="Share of equipped vehicles, 0 to 1.")
    ] = None,
    mode: Annotated[str | None, typer.Option("--mode", help="paper or refined.")] = None,
    table_format: Annotated[str, typer.Option("--format", help="csv, parquet or both.")] = "csv",
    compare_paper: Annotated[
        bool, typer.Option(help="Also judge the published search on every frame.")
    ] = False,
) -> None:
    """Run a scenario in SUMO and write the tables."""
    from analysis.simulate import simulate
    from analysis.summary import print_summary

    with _plain_errors(), _told_where(out):
        directory = simulate(
            scenario,
            out,
            seed=seed,
            duration_s=duration,
            fraction=equip,
            mode=mode,
            formats=_formats(table_format),
            compare_paper=compare_paper,
        )
        print_summary(directory)


@app.command()
def scenarios() -> None:
    """List the built-in scenarios."""
    from sumo_net.scenario import list_scenarios

    console = Console(highlight=False)
    for name, title in list_scenarios():
        console.print(f"{name:14} {title}")


@app.command()
def detect(
    source: Annotated[Path, typer.Argument(help="A video, a folder of images, or an image.")],
    camera: Annotated[Path, typer.Option("--camera", help="Camera file, as `calibrate` proposes it.")],
    out: Out = Path("out"),
    overlay: Annotated[
        Path | None, typer.Option("--overlay", help="Video with borders and predicted path.")
    ] = None,
    mode: Annotated[str, typer.Option("--mode", help="paper or refined.")] = "refined",
    speed: Annotated[float, typer.Option("--speed", help="Speed of the vehicle in m/s.", min=0)] = 25.0,
) -> None:
    """Find the lane in recorded footage."""
    from analysis.recorded import detect as detect_lanes

    with _plain_errors():
        detect_lanes(source, camera, out, overlay=overlay, mode=mode, speed_mps=speed)


@app.command()
def calibrate(
    images: Annotated[list[Path], typer.Argument(help="One or more images of a straight road.")],
    lane_width: Annotated[float, typer.Option("--lane-width", help="Width of the ego lane in m.")] = 3.7,
    height: Annotated[float, typer.Option("--height", help="Height of the camera in m.")] = 1.3,
) -> None:
    """Propose a camera file, as TOML on standard output."""
    from analysis.calibrate import calibrate as propose

    with _plain_errors():
        typer.echo(propose(images, lane_width_m=lane_width, height_m=height))


@app.command()
def evaluate(
    out: Out = Path("out/evaluation"),
    seeds: Annotated[int, typer.Option("--seeds", help="How many seeds.", min=1)] = 10,
    first_seed: Annotated[int, typer.Option("--first-seed", min=0)] = 100,
    duration: Annotated[float, typer.Option("--duration", help="Seconds simulated a run.")] = 60.0,
    equip: Annotated[float, typer.Option("--equip", help="Share of equipped vehicles.")] = 0.2,
    workers: Annotated[int, typer.Option("--workers", help="Runs at once.", min=1)] = 2,
    scenario: Annotated[str, typer.Option("--scenario")] = "highway",
) -> None:
    """Measure accuracy over many seeds, in clear and complex conditions, against the stated targets."""
    from analysis.evaluation import evaluate as measure

    with _plain_errors():
        measure(out, scenario, range(first_seed, first_seed + seeds), duration, equip, workers)


def _formats(name: str) -> tuple[str, ...]:
    formats = {"csv": ("csv",), "parquet": ("parquet",), "both": ("csv", "parquet")}
    if name not in formats:
        raise SettingsError(f"--format = '{name}': allowed are {', '.join(formats)}")
    return formats[name]
