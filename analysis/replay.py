"""Frames of a run that kept none: the run is repeated from its configuration.json as far as needed."""

import dataclasses
import json
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console

from analysis.drive import DriveError, check_vehicle
from analysis.simulate import between_steps, drive
from plugin.assistance import DriverAssistance
from plugin.capture import FRAMES, OWNER, Watch, folder_name, write_owner
from plugin.configuration import Configuration, RunSettings, read_configuration
from plugin.record import read_table
from sumo_net.scenario import prepare
from sumo_net.settings import SettingsError
from sumo_net.step import STEP_S
from sumo_net.traffic import Traffic


def replay(
    directory: Path, vehicle_ids: Sequence[str], *, threads: int | None = None, quiet: bool = True
) -> list[str]:
    """Repeat the run in `directory`, and keep the frames of some of its vehicles there.

    If no driver reacts to warnings, the other equipped vehicles drive but sense nothing: this does not change
    the rows of the vehicles asked for, and saves most of the time. The repeated rows are compared with the
    recorded ones; differences are returned (a line per vehicle, empty if all are equal) and added to the
    drive's notes.

    Raises DriveError, SettingsError or TrafficError; only one simulation can run in a process.
    """
    directory = Path(directory)
    for name in vehicle_ids:
        check_vehicle(directory, name)
    run = settings_to_repeat(directory)
    recorded = read_table(directory, "steps")
    recorded = recorded[recorded["vehicle_id"].isin(list(vehicle_ids))]
    repeated = _repeat(directory, run, vehicle_ids, float(recorded["time_s"].max()), threads, quiet)
    findings = []
    for name in vehicle_ids:
        difference = _difference(
            recorded[recorded["vehicle_id"] == name], repeated[repeated["vehicle_id"] == name]
        )
        if difference:
            finding = f"the repeated run differs from the recorded one: '{name}' {difference}"
            findings.append(f"{finding} (recorded with {run.versions})")
            folder = directory / FRAMES / folder_name(name)
            if (folder / OWNER).exists():
                about = json.loads((folder / OWNER).read_text(encoding="utf-8"))
                write_owner(folder, about | {"notes": [finding]})
    return findings


def settings_to_repeat(directory: Path) -> RunSettings:
    """What a run is repeated from. Raises DriveError where it cannot be."""
    try:
        run = read_configuration(directory)
    except SettingsError as error:
        raise DriveError(f"{error}: without it the run cannot be repeated, to make the frames") from None
    if not run.scenario:
        raise DriveError(
            f"{directory}: was run in a loop of your own, which cannot be repeated from its settings: "
            "name `watch` there, or set recording.frames"
        )
    return run


def _repeat(
    directory: Path, run: RunSettings, ids: Sequence[str], until_s: float, threads: int | None, quiet: bool
) -> pd.DataFrame:
    """The steps of the run, repeated up to `until_s`."""
    configuration = _for_replay(run.configuration)
    console = Console(stderr=True, highlight=False, quiet=quiet)
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        prepared = prepare(configuration, Path(work))
        watch = Watch(directory / FRAMES, ids=frozenset(ids), alone=not configuration.reaction.on)
        with (
            between_steps() as stop_here,
            Traffic.start(prepared.arguments) as traffic,
            DriverAssistance(
                traffic, configuration, prepared.network, run_id=run.run_id, threads=threads, watch=watch
            ) as adas,
        ):
            begin_s = traffic.time_s + prepared.warm_up_steps * STEP_S
            steps = min(prepared.recorded_steps, math.ceil((until_s - begin_s) / STEP_S - 1e-6))
            drive(traffic, adas, prepared.warm_up_steps, steps, f"{run.run_id}, again", console, stop_here)
        return adas.tables["steps"]


def _for_replay(configuration: Configuration) -> Configuration:
    # recording does not affect the simulation
    recording = dataclasses.replace(configuration.recording, tracks=False, frames=0)
    return dataclasses.replace(configuration, recording=recording)


def _difference(recorded: pd.DataFrame, repeated: pd.DataFrame) -> str:
    """Description of the differences of two tables of one vehicle's steps; '' if equal."""
    shared = [name for name in recorded if name in repeated and name != "paper_recognised"]
    both = recorded[shared].merge(repeated[shared], on="time_s", suffixes=("", "|again"))
    if len(both) < len(recorded):
        return f"has only {len(both)} of {len(recorded)} steps"
    differing: dict[str, float] = {}
    for name in map(str, shared):
        if name == "time_s":
            continue
        old, new = both[name], both[f"{name}|again"]
        equal = (old == new).fillna(False).to_numpy(bool) | (old.isna() & new.isna()).to_numpy(bool)
        if not equal.all():
            differing[name] = float(both["time_s"].to_numpy()[np.argmin(equal)])
    if not differing:
        return ""
    names = ", ".join(list(differing)[:4]) + (", …" if len(differing) > 4 else "")
    return f"differs from {min(differing.values()):.1f} s on ({names})"
