"""Scenarios: road, traffic and equipment; built in, or from the user's TOML or .sumocfg file."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

import pydantic
from pydantic import Field

from sumo_net.actors import actor_lines
from sumo_net.configuration import prepare_configuration
from sumo_net.demand import Demand, read_net, write_highway_demand, write_network_demand
from sumo_net.equipment import Equipment
from sumo_net.highway import Highway
from sumo_net.incidents import Incidents
from sumo_net.netconvert import BuildError
from sumo_net.network import BuiltNetwork, build
from sumo_net.road_import import ENDINGS, convert, format_of
from sumo_net.script import Actor, Manoeuvre, check_script
from sumo_net.settings import SettingsError, read_json, read_toml, settings

DEFAULT_SCENARIO = "highway"
_CONFIGURATION_ENDINGS = (".sumocfg", ".sumocfg.gz")
_SUMO_ENDINGS = (*_CONFIGURATION_ENDINGS, ".net.xml", ".net.xml.gz")
REGRESSION = ".scenario.toml"  # such a file names a scenario and the expected results


@settings
class Scenario:
    """The simulated world of a run. Its road is one of `highway` (default), `net_file`, `configuration`."""

    title: str = Field("", description="one line, shown in lists")
    purpose: str = Field("", description="what the scenario is for")
    duration_s: float = Field(
        120.0, gt=0, le=86_400, description="simulated time that is recorded, after the warm-up"
    )
    warm_up_s: float = Field(
        10.0, ge=0, le=86_400, description="time that SUMO simulates alone before the recorded time"
    )
    seed: int = Field(1, ge=0, lt=2**31, description="random seed of SUMO and of everything drawn here")
    configuration: str = Field("", description="path of a .sumocfg, which runs unchanged with its own demand")
    net_file: str = Field(
        "",
        description="path of a network on which the traffic of `demand` drives: a .net.xml, or an "
        "OpenStreetMap extract (.osm, .osm.xml) or OpenDRIVE file (.xodr), which is converted",
    )
    lefthand: bool = Field(
        False, description="traffic keeps left, where net_file is converted; SUMO's own networks state it"
    )
    highway: Highway = Field(default_factory=Highway, description="built where no file is named")
    demand: Demand = Field(default_factory=Demand)
    incidents: Incidents = Field(
        default_factory=Incidents, description="hard brakings and cut-ins in the traffic"
    )
    equipment: Equipment = Field(default_factory=Equipment)
    actors: tuple[Actor, ...] = Field((), description="scripted vehicles, one table each")
    script: tuple[Manoeuvre, ...] = Field((), description="their manoeuvres, one table each")
    time_to_teleport_s: float | None = Field(
        None,
        description="SUMO removes a vehicle that has been jammed for this long; -1: never; none: SUMO's "
        "default",
    )

    @pydantic.model_validator(mode="after")
    def _one_road(self) -> Self:
        if self.configuration and self.net_file:
            raise ValueError(
                f"configuration = '{self.configuration}' and net_file = '{self.net_file}': name only one"
            )
        if self.lefthand and format_of(Path(self.net_file)) is None:
            raise ValueError(
                f"lefthand = true: only with a net_file that is converted ({', '.join(ENDINGS)})"
            )
        return self

    @pydantic.model_validator(mode="after")
    def _script_fits(self) -> Self:
        if self.configuration and self.actors:
            raise ValueError(
                "actors: not allowed with a configuration, whose route files define its vehicles"
            )
        check_script(self.actors, self.script, others=bool(self.configuration))
        if any(actor.equipped for actor in self.actors) and not self.equipment.types_may_ask:
            raise ValueError("equipment.types_may_ask = false: must be true for equipped actors")
        return self


@dataclass(frozen=True, slots=True)
class PreparedRun:
    """What is needed to start a run: SUMO's arguments (for Traffic.start), network and step counts."""

    arguments: tuple[str, ...]
    network: BuiltNetwork | Path  # the built highway, or a .net.xml
    begin_s: float  # SUMO's time at the start
    warm_up_steps: int
    recorded_steps: int
    notes: tuple[str, ...]  # for the user, shown before the run


def scenario_files() -> dict[str, Path]:
    """The built-in scenarios' files by name, the default one first."""
    folder = resources.files("sumo_net") / "scenarios"
    found = {
        Path(str(file)).stem: Path(str(file)) for file in folder.iterdir() if file.name.endswith(".toml")
    }
    return dict(sorted(found.items(), key=lambda item: (item[0] != DEFAULT_SCENARIO, item[0])))


def list_scenarios() -> list[tuple[str, str]]:
    """(name, title) of the built-in scenarios."""
    return [(name, str(read_toml(path).get("title", ""))) for name, path in scenario_files().items()]


def scenario_mapping(source: str, within: tuple[Path, ...] = ()) -> tuple[dict[str, Any], Path]:
    """The settings that a source stands for, and the file they are from.

    `source`: a built-in name, a .toml, a .sumocfg, a road, or the configuration.json that a run wrote beside
    its tables. Paths in the settings are made absolute; in the file they are relative to it. `within`: files
    that are based on this one. Raises SettingsError.
    """
    path = Path(source)
    if "\0" in source:
        raise SettingsError(f"scenario {source!r}: is not a file name")
    if path.name.endswith(_SUMO_ENDINGS) or format_of(path) is not None:
        if not path.is_file():
            raise SettingsError(f"{source}: no such file")
        key = "configuration" if path.name.endswith(_CONFIGURATION_ENDINGS) else "net_file"
        return {"title": path.name, key: str(path.resolve()), "warm_up_s": 0.0}, path
    if path.suffix == ".json":
        content = read_json(path)
        mapping = content.get("settings", content)
        if not isinstance(mapping, dict):
            raise SettingsError(f"{path}: settings = {mapping!r}: must be a mapping")
        if content.get("scenario") == "":
            raise SettingsError(
                f"{path}: is of a loop of your own, whose network and traffic are not in it: run that again"
            )
        return mapping, path
    if path.suffix != ".toml":
        files = scenario_files()
        if source not in files:
            raise SettingsError(_no_scenario(path, list(files)))
        path = files[source]
    mapping = read_toml(path)
    if path.name.endswith(REGRESSION):
        if path.resolve() in within:
            raise SettingsError(f"{path}: scenario = {mapping.get('scenario')!r}: is based on itself")
        return _based_on(mapping, path, (*within, path.resolve()))
    for key in ("configuration", "net_file"):
        if isinstance(mapping.get(key), str) and mapping[key]:
            if "\0" in mapping[key]:
                raise SettingsError(f"{path}: {key} = {mapping[key]!r}: is not a file name")
            mapping[key] = str((path.parent / mapping[key]).resolve())
    return mapping, path


def _no_scenario(path: Path, names: Sequence[str]) -> str:
    if path.is_dir():
        return f"{path}: is a directory; {path / 'configuration.json'} repeats a run's"
    if path.is_file():
        return (
            f"{path}: a scenario is a .toml, .sumocfg, .net.xml, .osm or .xodr file by its name; for a SUMO "
            f"configuration of another name, write a .toml file with configuration = '{path.name}'"
        )
    near = difflib.get_close_matches(str(path), names, n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"built in are {', '.join(names)}"
    return f"no scenario '{path}': {hint} (or name a .toml, .sumocfg, .net.xml, .osm or .xodr file)"


def _based_on(mapping: dict[str, Any], path: Path, within: tuple[Path, ...]) -> tuple[dict[str, Any], Path]:
    """A regression's settings: its `settings` merged over the scenario that it names."""
    name = str(mapping.get("scenario", DEFAULT_SCENARIO))
    beside = path.parent / name
    base, _ = scenario_mapping(str(beside) if Path(name).suffix and beside.is_file() else name, within)
    changes = mapping.get("settings", {})
    if not isinstance(changes, dict):
        raise SettingsError(f"{path}: settings = {changes!r}: must be a table")
    return laid_over(base, changes), path


def laid_over(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The nested mapping `base` with `changes` merged over it."""
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            merged[key] = laid_over(old, value)
        else:
            merged[key] = value
    return merged


def prepare(scenario: Scenario, directory: Path) -> PreparedRun:
    """Write SUMO's input files into `directory` (created if missing), nowhere else. Raises SettingsError."""
    directory.mkdir(parents=True, exist_ok=True)
    directory = directory.resolve()
    warm_up, recorded = round(scenario.warm_up_s * 10), max(1, round(scenario.duration_s * 10))
    end = (warm_up + recorded) / 10
    options = {
        "step-length": "0.1",
        "seed": str(scenario.seed),
        "lateral-resolution": "-1",
        "lanechange.duration": "0",
        "no-step-log": "true",
        "no-warnings": "true",
        "duration-log.disable": "true",
    }
    if scenario.time_to_teleport_s is not None:
        options["time-to-teleport"] = f"{scenario.time_to_teleport_s:g}"
    if scenario.configuration:
        done = prepare_configuration(Path(scenario.configuration), directory, options, end)
        read_net(done.net_file)
        arguments: tuple[str, ...] = ("-c", str(done.file))
        return PreparedRun(arguments, done.net_file, done.begin_s, warm_up, recorded, done.notes)
    network = road(scenario, directory)
    routes = directory / "demand.rou.xml"
    placed = actor_lines(scenario.actors, network, warm_up / 10)
    if isinstance(network, BuiltNetwork):
        write_highway_demand(scenario.demand, network, end, scenario.seed, routes, placed)
        options |= {"net-file": str(network.net_file), "collision.action": "warn"}
        options.setdefault("time-to-teleport", "-1")
    else:
        write_network_demand(scenario.demand, network, end, scenario.seed, routes, placed)
        options["net-file"] = str(network)
    options |= {"route-files": str(routes), "begin": "0", "end": f"{end:.1f}", "max-depart-delay": "10"}
    arguments = tuple(word for name, value in options.items() for word in (f"--{name}", value))
    return PreparedRun(arguments, network, 0.0, warm_up, recorded, ())


def road(scenario: Scenario, directory: Path) -> BuiltNetwork | Path:
    """The road of a scenario without a configuration: its net_file, or a network built in `directory`.

    Raises SettingsError.
    """
    if not scenario.net_file:
        try:
            return build(scenario.highway, directory)
        except BuildError as error:
            raise SettingsError(str(error)) from None
    file = Path(scenario.net_file)
    return file if format_of(file) is None else convert(file, scenario.lefthand, directory)
