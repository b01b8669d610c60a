"""One run: SUMO, the equipped fleet, the tables."""

import contextlib
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from analysis.warm_up import compiling
from plugin.assistance import DriverAssistance
from plugin.configuration import CONFIGURATION, Configuration, load_configuration, read_configuration
from sumo_net.scenario import PreparedRun, prepare
from sumo_net.traffic import Traffic, TrafficError


class Window(NamedTuple):
    """Options of SUMO's own window."""

    delay_ms: int = 100  # least time per step; 100: at most real time


def settings_of(
    scenario: str,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    fraction: float | None = None,
    mode: str | None = None,
    condition: str | None = None,
    frames: int | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Configuration:
    """The settings of a scenario (name, .toml or .sumocfg) with the given changes. Raises SettingsError."""
    given: dict[str, Any] = dict(changes or {})
    options = {"seed": seed, "duration_s": duration_s, "mode": mode, "condition": condition}
    given |= {name: value for name, value in options.items() if value is not None}
    if fraction is not None:
        given["equipment"] = {**given.get("equipment", {}), "fraction": fraction}
    if frames is not None:
        given["recording"] = {**given.get("recording", {}), "frames": frames}
    return load_configuration(scenario, given)


def simulate(
    scenario: str,
    out: Path,
    *,
    formats: Iterable[str] = ("csv",),
    compare_paper: bool = False,
    threads: int | None = None,
    quiet: bool = False,
    window: Window | None = None,
    **options: Any,
) -> Path:
    """Run `scenario` and write its tables into `out`; `options` are those of `settings_of`.

    `window`: run in SUMO's own window, a separate process (traci); the tables are the same.

    An interrupted run also writes what it has computed. Raises SettingsError or TrafficError.
    """
    configuration = settings_of(scenario, **options)
    scenario, compared_paper = repeated(scenario)
    name = name_of(scenario)
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        prepared = prepare(configuration, Path(work))
        console = Console(stderr=True, highlight=False, quiet=quiet)
        for note in prepared.notes:
            console.print(f"note: {note}", markup=False)
        with (
            between_steps() as stop_here,
            Traffic.start(_arguments(prepared, window), gui=window is not None) as traffic,
            DriverAssistance(
                traffic,
                configuration,
                prepared.network,
                out=out,
                formats=formats,
                run_id=f"{name}-{configuration.seed}",
                threads=threads,
                compare_paper=compare_paper or compared_paper,
                scenario=scenario,
            ) as adas,
        ):
            after_step = _in_window(traffic, adas, out) if window is not None else lambda: None
            try:
                drive(
                    traffic,
                    adas,
                    prepared.warm_up_steps,
                    prepared.recorded_steps,
                    name,
                    console,
                    stop_here,
                    after_step,
                )
            except TrafficError as error:
                if window is None:
                    raise
                console.print(f"the window was closed: the rows so far are kept ({error})", markup=False)
    return out


def _arguments(prepared: PreparedRun, window: Window | None) -> tuple[str, ...]:
    if window is None:
        return prepared.arguments
    from analysis.window import VIEW_SETTINGS

    shown = ("--gui-settings-file", str(VIEW_SETTINGS), "--window-size", "1280,720")
    return (*prepared.arguments, *shown, "--delay", str(window.delay_ms))


def _in_window(traffic: Traffic, adas: DriverAssistance, out: Path) -> Callable[[], None]:
    from analysis.window import FleetWindow

    return FleetWindow(traffic, adas, out).step


def repeated(scenario: str) -> tuple[str, bool]:
    """The scenario of the run that wrote the configuration.json `scenario`, and its `compare_paper`.

    Any other scenario: itself, and False.
    """
    path = Path(scenario)
    if path.name != CONFIGURATION:
        return scenario, False
    run = read_configuration(path.parent)
    return run.scenario or scenario, run.compare_paper


def name_of(scenario: str) -> str:
    """Name of a run of `scenario`: a built-in name, or the file's name without suffixes."""
    return Path(scenario).name.split(".")[0] or "run"


def drive(
    traffic: Traffic,
    adas: DriverAssistance,
    warm_up_steps: int,
    steps: int,
    name: str,
    console: Console,
    stop_here: Callable[[], None],
    after_step: Callable[[], None] = lambda: None,
) -> None:
    """SUMO alone for the warm-up, then with the assistance; `stop_here` is called where the run may end."""

    def tell(kernels: int) -> None:
        text = f"{name}: compiling, once, about a minute"
        progress.update(task, description=f"{text}: {kernels} kernels")
        if progress.disable and not kernels:  # without a terminal: a line instead of the bar
            console.print(text, markup=False)

    progress = _progress(console)
    task = progress.add_task(f"{name}: starting", total=steps, vehicles=0)
    with progress, compiling(tell) as meet:
        for _ in range(warm_up_steps):
            traffic.step()
            stop_here()
        meet()
        for _ in range(steps):
            traffic.step()
            adas.step()
            after_step()
            progress.update(task, description=name, advance=1, vehicles=len(adas.vehicles))
            stop_here()


@contextlib.contextmanager
def between_steps() -> Iterator[Callable[[], None]]:
    """Defers Ctrl-C until the function that it yields is called, so that no step or table is left incomplete.

    A second Ctrl-C interrupts at once. Works only in the main thread, which alone receives signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    asked: list[int] = []

    def ask(number: int, frame: Any) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    def stop_here() -> None:
        if asked:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop_here
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _progress(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[vehicles]} equipped"),
        TimeRemainingColumn(),
    )
    hidden = console.quiet or not console.is_terminal
    return Progress(*columns, console=console, transient=True, disable=hidden)
