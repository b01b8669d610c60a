"""A scenario with expectations: run its seeds, compare figures with bounds and golden values."""

import atexit
import difflib
import json
import shlex
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field

from analysis.fork_server import ForkServer
from analysis.metrics import TABLES, figure_names, summary
from analysis.simulate import settings_of, simulate
from plugin.record import read_table
from sumo_net.settings import SettingsError, read, read_toml, settings

_processes = ForkServer()  # shared by all files of a session
atexit.register(_processes.close)


class ExpectationError(AssertionError):
    """Expected and measured figures, where they are worst, and how to see it."""


@settings
class Golden:
    """Figures stored beside the file, from which later ones may not deviate."""

    figures: tuple[str, ...] = Field((), description="dotted names, as in expect")
    tolerance: float = Field(0.1, ge=0, description="share of the golden value")
    slack: float = Field(0.0, ge=0, description="absolute tolerance in addition")


@settings
class Regression:
    """A `*.scenario.toml` file."""

    title: str = Field("")
    purpose: str = Field("")
    scenario: str = Field("highway", description="a built-in name, or a file beside this one")
    seeds: tuple[int, ...] = Field((1,), min_length=1)
    settings: dict[str, Any] = Field(default_factory=dict, description="laid over the scenario")
    expect: dict[str, Any] = Field(default_factory=dict, description="figure = value, or .min and .max")
    golden: Golden = Field(default_factory=Golden)


def check(file: Path, mode: str | None = None, update: bool = False) -> dict[str, float]:
    """Run the file's seeds; returns the figures over all of them.

    Raises ExpectationError if they are not as expected, SettingsError for an invalid file.
    """
    wanted, bounds = expectations(file)
    options: dict[str, Any] = {} if mode is None else {"mode": mode}
    settings_of(str(file), **options)  # raises before anything is run
    if not bounds and not wanted.golden.figures:
        raise SettingsError(f"{file}: expects nothing: add [expect], for example departures.missed = 0")
    keys = {name: _figure(name, f"{file}: expect.{name}") for name in bounds}
    golden_keys = {name: _figure(name, f"{file}: golden.figures: {name}") for name in wanted.golden.figures}
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        tables = _run(str(file), wanted.seeds, options, Path(work))
    figures = dict.fromkeys([*keys.values(), *golden_keys.values()], np.nan) | summary(**tables)
    faults = []
    for name, bound in bounds.items():
        key = keys[name]
        for rule, limit in bound.items():
            if not _kept(figures[key], rule, limit):
                faults.append(_fault(name, key, figures[key], rule, limit, tables, file, wanted, mode))
    now = {name: float(f"{figures[key]:.6g}") for name, key in golden_keys.items()}
    faults += _golden(file, wanted.golden, now, update)
    if faults:
        raise ExpectationError("\n".join(faults))
    return figures


def expectations(file: Path) -> tuple[Regression, dict[str, dict[str, float]]]:
    """Contents of the file, and its bounds by figure and rule. Raises SettingsError."""
    wanted = read(Regression, read_toml(file), str(file))
    return wanted, dict(_bounds(wanted.expect))


def _run(
    scenario: str, seeds: tuple[int, ...], options: dict[str, Any], work: Path
) -> dict[str, pd.DataFrame]:
    """All seeds, one after the other, each in a separate process: only one simulation fits in a process."""
    for seed in seeds:
        _processes.result(_one, scenario, work / str(seed), seed, options)
    return {
        name: pd.concat([read_table(work / str(seed), name) for seed in seeds], ignore_index=True)
        for name in TABLES
    }


def _one(scenario: str, out: Path, seed: int, options: dict[str, Any]) -> None:
    simulate(scenario, out, seed=seed, formats=("parquet",), threads=1, quiet=True, **options)


def _bounds(expect: Mapping[str, Any], prefix: str = "") -> Any:
    """(dotted name, {rule: limit}) of a nested mapping."""
    for name, value in expect.items():
        whole = f"{prefix}{name}"
        if isinstance(value, Mapping) and set(value) <= {"min", "max"} and value:
            yield whole, {rule: _number(f"{whole}.{rule}", limit) for rule, limit in value.items()}
        elif isinstance(value, Mapping):
            yield from _bounds(value, f"{whole}.")
        else:
            yield whole, {"is": _number(whole, value)}


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SettingsError(f"expect.{name} = {value!r}: must be a number")
    return float(value)


def _figure(name: str, where: str) -> str:
    """Full name: `departures.missed` is departures_missed, `tracks.class_accuracy` is class_accuracy."""
    figures = figure_names()
    for key in (name.replace(".", "_"), name.split(".", 1)[-1].replace(".", "_")):
        if key in figures:
            return key
    near = difflib.get_close_matches(name.replace(".", "_"), figures, n=3, cutoff=0.4)
    hint = f": did you mean {' or '.join(near)}?" if near else ""
    raise SettingsError(f"{where}: there is no such figure{hint}")


def _kept(value: float, rule: str, limit: float) -> bool:
    if rule == "min":
        return value >= limit
    if rule == "max":
        return value <= limit
    return value == limit


def _fault(
    name: str,
    key: str,
    value: float,
    rule: str,
    limit: float,
    tables: Mapping[str, pd.DataFrame],
    file: Path,
    wanted: Regression,
    mode: str | None,
) -> str:
    bound = {"min": "at least", "max": "at most", "is": "exactly"}[rule]
    lines = [f"{name} is {value:.6g}, expected {bound} {limit:g}"]
    worst = worst_moment(key, tables)
    if worst is not None:
        lines.append(f"  worst: run {worst.run_id} vehicle {worst.vehicle_id} at {worst.time_s:.1f} s")
    seed = wanted.seeds[0] if worst is None else worst.run_id.rsplit("-", 1)[-1]
    words = ["sumo-adas", "run", str(file), "--seed", str(seed), *(() if mode is None else ("--mode", mode))]
    words += ["--out", f"out/{file.name.split('.')[0]}"]
    lines.append(f"  see it: {shlex.join(words)}")
    return "\n".join(lines)


class Moment(NamedTuple):
    """Where to look."""

    run_id: str
    vehicle_id: str
    time_s: float


def worst_moment(figure: str, tables: Mapping[str, pd.DataFrame]) -> Moment | None:
    """When a figure was worst; None if there is no single moment."""
    steps = tables["steps"]
    found: tuple[pd.DataFrame, str, pd.Series] | None = None
    if figure.startswith(("departures", "warned")):
        rows = tables["departures"]
        rows = rows[rows["warned"].notna()]
        found = rows, "crossing_s", (~rows["warned"].astype(bool)).astype(float)
    elif figure.startswith(("warnings", "false", "nuisance", "fcw")):
        rows = tables["warnings"]
        rows = rows[rows["kind"] == ("fcw" if figure.startswith("fcw") else "ldw")]
        found = rows, "start_s", rows["outcome"].map({"false": 2.0, "nuisance": 1.0}).fillna(0.0)
    elif figure.startswith("conflict"):
        rows = tables["conflicts"]
        found = rows, "start_s", -rows["min_ttc_s"]
    elif figure.startswith("class"):
        rows = tables["tracks"]
        found = rows, "time_s", (rows["motion_state"] != rows["true_motion_state"]).astype(float)
    else:
        for begin, estimate in (
            ("tlc", "tlc_s"),
            ("lateral_offset", "lateral_offset_m"),
            ("heading", "heading_error_rad"),
            ("curvature", "curvature_1pm"),
            ("yaw_rate", "yaw_rate_rps"),
            ("lateral_speed", "lateral_speed_mps"),
        ):
            if figure.startswith(begin):
                found = steps, "time_s", (steps[estimate] - steps[f"true_{estimate}"]).abs()
        if figure.startswith(("recognition", "locked")):
            found = steps, "time_s", (steps["recognised"] == False).fillna(False).astype(float)  # noqa: E712
    if found is None or not len(found[2].dropna()):
        return None
    rows, time, badness = found
    row = rows.iloc[int(np.nanargmax(badness.to_numpy(np.float64, na_value=np.nan)))]
    return Moment(row["run_id"], row["vehicle_id"], float(row[time]))


def _golden(file: Path, golden: Golden, now: dict[str, float], update: bool) -> list[str]:
    place = file.with_name(file.name.removesuffix(".toml") + ".golden.json")
    if not now:
        return []
    if update or not place.exists():
        place.write_text(json.dumps(now, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return [] if update else [f"{place.name} did not exist: written now, check it and run again"]
    before = json.loads(place.read_text(encoding="utf-8"))
    faults = []
    for name, value in now.items():
        if name not in before:
            faults.append(f"{name}: has no golden value: run with --adas-update")
        elif not abs(value - before[name]) <= golden.tolerance * abs(before[name]) + golden.slack:
            faults.append(f"{name} is {value:g}, golden {before[name]:g} ± {golden.tolerance:.0%}")
    return faults
