"""One run: SUMO, the equipped fleet, the tables."""

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from plugin.assistance import DriverAssistance
from plugin.configuration import Configuration, load_configuration
from sumo_net.scenario import prepare
from sumo_net.traffic import Traffic


def settings_of(
    scenario: str,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    fraction: float | None = None,
    mode: str | None = None,
    condition: str | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Configuration:
    """The settings of a scenario (name, .toml or .sumocfg) with what else was given. Raises SettingsError."""
    given: dict[str, Any] = dict(changes or {})
    options = {"seed": seed, "duration_s": duration_s, "mode": mode, "condition": condition}
    given |= {name: value for name, value in options.items() if value is not None}
    if fraction is not None:
        given["equipment"] = {**given.get("equipment", {}), "fraction": fraction}
    return load_configuration(scenario, given)


def simulate(
    scenario: str,
    out: Path,
    *,
    formats: Iterable[str] = ("csv",),
    compare_paper: bool = False,
    threads: int | None = None,
    quiet: bool = False,
    **options: Any,
) -> Path:
    """Run `scenario` and write its tables into `out`; `options` are those of `settings_of`.

    What has been computed is written also when the run is interrupted. Raises SettingsError or TrafficError.
    """
    configuration = settings_of(scenario, **options)
    name = Path(scenario).name.split(".")[0]
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        prepared = prepare(configuration, Path(work))
        console = Console(stderr=True, highlight=False, quiet=quiet)
        for note in prepared.notes:
            console.print(f"note: {note}", markup=False)
        with (
            Traffic.start(prepared.arguments) as traffic,
            DriverAssistance(
                traffic,
                configuration,
                prepared.network,
                out=out,
                formats=formats,
                run_id=f"{name}-{configuration.seed}",
                threads=threads,
                compare_paper=compare_paper,
            ) as adas,
            _progress(console) as progress,
        ):
            for _ in range(prepared.warm_up_steps):
                traffic.step()
            task = progress.add_task(name, total=prepared.recorded_steps, vehicles=0)
            for _ in range(prepared.recorded_steps):
                traffic.step()
                adas.step()
                progress.update(task, advance=1, vehicles=len(adas.vehicles))
    return out


def _progress(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[vehicles]} equipped"),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console, transient=True, disable=console.quiet)
