"""The plan of a campaign: the file, its cells and runs, all checked before the first run."""

import difflib
import functools
import hashlib
import itertools
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from plugin.configuration import Configuration, configuration_from
from plugin.schema import TABLES
from sumo_net.configuration import writes
from sumo_net.randomness import generator
from sumo_net.scenario import laid_over, scenario_mapping
from sumo_net.settings import SettingsError, read, read_toml, settings

MOST_RUNS = 100_000  # all are checked before the first one begins
_OWN = ("seed", "duration_s")  # have keys of their own in the file


@settings
class Seeds:
    """Consecutive seeds."""

    first: int = Field(1, ge=0, lt=2**31)
    count: int = Field(gt=0, le=1_000_000)


@settings
class Draw:
    """A setting drawn for every seed; the same in all cells of a seed."""

    distribution: Literal["uniform", "normal", "lognormal", "choice"] = Field("uniform")
    low: float | None = Field(None, description="least value; smaller ones are drawn again")
    high: float | None = Field(None, description="greatest value; larger ones are drawn again")
    mean: float = Field(0.0, description="of normal; of the logarithm for lognormal")
    deviation: float = Field(1.0, gt=0, description="of normal; of the logarithm for lognormal")
    values: tuple[float | str | bool, ...] = Field((), description="of choice")

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "Draw":
        if self.distribution == "uniform" and (self.low is None or self.high is None):
            raise ValueError("uniform needs low and high")
        if self.distribution == "choice" and not self.values:
            raise ValueError("choice needs values")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low = {self.low}: must not be above high = {self.high}")
        return self

    def value(self, draw: np.random.Generator) -> float | str | bool:
        """One value."""
        if self.distribution == "choice":
            return self.values[int(draw.integers(len(self.values)))]
        low, high = (-np.inf if self.low is None else self.low), (np.inf if self.high is None else self.high)
        for _ in range(1000):
            value = float(
                draw.uniform(low, high + 0.0)  # + 0.0: numpy refuses the range 0.0 to -0.0
                if self.distribution == "uniform"
                else getattr(draw, self.distribution)(self.mean, self.deviation)
            )
            if low <= value <= high:
                return round(value, 6)
        raise ValueError(f"{self.distribution} with mean = {self.mean} hardly ever lies in {low} to {high}")


@settings
class Campaign:
    """A campaign file."""

    title: str = Field("", description="one line for the report")
    scenarios: tuple[str, ...] = Field(("highway",), min_length=1, description="built-in names or files")
    seeds: Annotated[
        Annotated[Seeds, pydantic.Tag("<range>")] | Annotated[tuple[int, ...], pydantic.Tag("<list>")],
        pydantic.Discriminator(lambda given: "<range>" if isinstance(given, dict | Seeds) else "<list>"),
    ] = Field(description="a list, or first and count")
    duration_s: float | None = Field(None, gt=0, le=86_400, description="of every run; else the scenario's")
    settings: dict[str, Any] = Field(default_factory=dict, description="of every run, by dotted name")
    grid: dict[str, tuple[Any, ...]] = Field(
        default_factory=dict, description="every combination of these is a cell, by dotted name"
    )
    random: dict[str, Draw] = Field(default_factory=dict, description="drawn for every seed, by dotted name")
    retries: int = Field(1, ge=0, le=100, description="how often a failed run is tried again")
    keep: tuple[str, ...] = Field((), description="tables kept of every run, as Parquet")

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> "Campaign":
        seeds = self.seeds
        if not isinstance(seeds, Seeds):
            if not seeds:
                raise ValueError("seeds = []: name at least one")
            twice = sorted({seed for seed in seeds if seeds.count(seed) > 1})
            if twice:
                raise ValueError(f"seeds: {', '.join(map(str, twice))} given twice")
        for name, values in self.grid.items():
            if not values:
                raise ValueError(f'grid."{name}" = []: name at least one value')
            if len({json.dumps(value, sort_keys=True, default=str) for value in values}) < len(values):
                raise ValueError(f'grid."{name}": a value is given twice')
        used = [*self.settings, *self.grid, *self.random]
        for name in used:
            if used.count(name) > 1:
                raise ValueError(f"{name}: is in more than one of settings, grid and random")
            if name in _OWN:
                raise ValueError(f"{name}: is a key of the campaign itself, not of settings, grid or random")
        for name in self.keep:
            if name not in TABLES:
                near = difflib.get_close_matches(name, TABLES, n=1)
                hint = f": did you mean '{near[0]}'?" if near else f"; there are {', '.join(TABLES)}"
                raise ValueError(f"keep: no table '{name}'{hint}")
        return self


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a campaign."""

    key: str  # name of its folder
    cell: int
    scenario: str
    seed: int
    changes: Mapping[str, Any]  # nested, laid over the scenario
    duration_s: float  # simulated time that is recorded


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs of a campaign, in the order of the report."""

    campaign: Campaign
    cells: tuple[Mapping[str, Any], ...]  # scenario and grid values by dotted name
    runs: tuple[Run, ...]
    settings: tuple[str, ...]  # hash of each run's settings, including the SUMO files that they name

    @property
    def hash(self) -> str:
        """Hash of everything that the results depend on, and of the tables to keep."""
        keys = [run.key for run in self.runs]
        text = json.dumps([keys, self.settings, sorted(set(self.campaign.keep))])
        return hashlib.sha256(text.encode()).hexdigest()


def run_key(cell: int, seed: int) -> str:
    """Name of a run's folder."""
    return f"{cell:04d}-{seed:010d}"


def load(file: Path | str, keep: tuple[str, ...] = ()) -> Plan:
    """Read a campaign file and check every run's settings. Raises SettingsError before anything runs.

    keep : tables to keep instead of those that the file names.
    """
    path = Path(file)
    mapping = read_toml(path)
    if keep:
        mapping["keep"] = list(keep)
    return plan(read(Campaign, mapping, str(path)), path.parent, str(path))


def in_words(run: Run) -> str:
    """A run's changes as text, by dotted name."""
    return ", ".join(f"{name} = {value}" for name, value in _flat(run.changes))


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def plan(campaign: Campaign, folder: Path = Path(), source: str = "campaign") -> Plan:
    """All runs of a campaign; scenario files are relative to `folder`. Raises SettingsError."""
    seeds = campaign.seeds
    numbers = range(seeds.first, seeds.first + seeds.count) if isinstance(seeds, Seeds) else seeds
    scenarios = [_scenario(name, folder) for name in campaign.scenarios]
    if len(set(scenarios)) < len(scenarios):
        raise SettingsError(f"{source}: scenarios: one is given twice")
    count = len(numbers) * math.prod(map(len, (scenarios, *campaign.grid.values())))
    if count > MOST_RUNS:
        raise SettingsError(f"{source}: asks for {count} runs: at most {MOST_RUNS}")
    cells: list[dict[str, Any]] = []
    runs, hashes = [], []
    contents, mapping = functools.cache(_contents), functools.cache(scenario_mapping)
    for scenario, values in itertools.product(scenarios, itertools.product(*campaign.grid.values())):
        cell = dict(zip(campaign.grid, values, strict=True))
        for seed in numbers:
            given = campaign.settings | cell | _drawn(campaign, seed)
            changes: dict[str, Any] = {"seed": seed}
            if campaign.duration_s is not None:
                changes["duration_s"] = campaign.duration_s
            for name, value in given.items():
                _put(changes, name, value, source)
            checked = _check(mapping, scenario, changes, source, cell)
            hashes.append(checked.hash + contents(checked.configuration, True) + contents(checked.net_file))
            key = run_key(len(cells), seed)
            runs.append(Run(key, len(cells), scenario, seed, changes, checked.duration_s))
        cells.append({"scenario": Path(scenario).name.split(".")[0]} | cell)
    return Plan(campaign, tuple(cells), tuple(runs), tuple(hashes))


def _contents(file: str, configures: bool = False) -> str:
    """Hash of a SUMO file and, where it `configures` SUMO, of the files it reads; '' if there is none."""
    path, whole = Path(file), hashlib.sha256()
    if not file or not path.is_file():
        return ""
    content = path.read_bytes()
    whole.update(content)
    if configures:
        for name in sorted(_read_by(content.decode("utf-8", "replace"))):
            named = path.parent / name
            if named.is_file():
                whole.update(name.encode())
                whole.update(named.read_bytes())
    return whole.hexdigest()


def _read_by(configuration: str) -> set[str]:
    """All values of a SUMO configuration that may name a file, without those that it writes."""
    sections = re.sub(r"(?s)<(output|report)>.*?</\1>", "", configuration)
    options = re.findall(r"""<([\w.-]+)\s(?:[^<>]*\s)?value\s*=\s*["']([^"'<>]+)["']""", sections)
    read = [value for option, value in options if not writes(option)]
    return {name.strip() for value in read for name in value.split(",") if name.strip()}


def _check(
    mapping: Callable[[str], tuple[dict[str, Any], Path]],
    scenario: str,
    changes: Mapping[str, Any],
    source: str,
    cell: Mapping[str, Any],
) -> Configuration:
    """As `load_configuration`, for a scenario read by `mapping`, which may cache it."""
    where = ", ".join(f"{name} = {value!r}" for name, value in cell.items())
    run = f"{source}: {scenario}{' with ' + where if where else ''}"
    try:
        base, path = mapping(scenario)
    except SettingsError as error:
        raise SettingsError(f"{run}: {error}") from None
    try:
        return configuration_from(laid_over(base, changes), run)
    except SettingsError:
        configuration_from(base, str(path))  # raises where the scenario itself is wrong
        raise


def _scenario(name: str, folder: Path) -> str:
    """A file's absolute path, or a built-in name unchanged."""
    path = folder / name
    return str(path.resolve()) if Path(name).suffix and path.is_file() else name


def _drawn(campaign: Campaign, seed: int) -> dict[str, Any]:
    return {name: draw.value(generator(seed, name, "campaign")) for name, draw in campaign.random.items()}


def _put(changes: dict[str, Any], name: str, value: Any, source: str) -> None:
    """Set a.b.c in a nested mapping. `condition` and `condition.preset` are the same."""
    *path, last = name.split(".")
    if name == "condition" and isinstance(value, str):
        path, last = ["condition"], "preset"
    here = changes
    for part in path:
        here = here.setdefault(part, {})
        if not isinstance(here, dict):
            raise SettingsError(f"{source}: {name}: '{part}' already has a value")
    here[last] = list(value) if isinstance(value, tuple) else value
