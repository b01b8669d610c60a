"""All settings of a run: the scenario, and the equipped vehicles' drivers, sensors and assistance."""

import contextlib
import dataclasses
import functools
import hashlib
import json
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field, TypeAdapter, model_validator

from camera_synth.camera import Camera
from camera_synth.condition import PRESETS, Condition, preset_settings
from ego_synth.sensors import EgoSensors
from plugin.conflicts import ConflictSettings
from plugin.events import Matching
from plugin.lane.detector import LaneDetector
from plugin.lane.genetic import GeneticSearch
from plugin.lane.geometry import Plausibility
from plugin.lane.refine import Refine, on_vehicle
from plugin.motion.observer import ObserverSettings
from plugin.motion.prediction import PredictionSettings
from plugin.reaction import Reaction
from plugin.record import Recording
from plugin.tracking.closing import Closing
from plugin.tracking.tracker import TrackerSettings
from plugin.warning.collision import Collision
from plugin.warning.departure import DepartureSettings
from radar_synth.radar import Radar
from sumo_net.driver import Driver
from sumo_net.roadside import Roadside
from sumo_net.scenario import Scenario, laid_over, scenario_mapping
from sumo_net.settings import SettingsError, read, read_json, read_toml, settings
from sumo_net.step import STEP_S
from sumo_net.vehicle import Vehicle


@settings
class Configuration(Scenario):
    """A scenario with its drivers, cameras and assistance. TOML files hold the same keys."""

    mode: Literal["paper", "refined"] = Field(
        "refined", description="paper: the published chain; refined: the default chain, which starts from it"
    )
    driver: Driver = Field(default_factory=Driver, description="how equipped vehicles are steered")
    vehicle: Vehicle = Field(default_factory=Vehicle, description="single-track model of equipped vehicles")
    camera: Camera = Field(default_factory=Camera)
    condition: Condition = Field(
        default_factory=Condition, description="light, weather, paint; in TOML also `preset`"
    )
    ego_sensors: EgoSensors = Field(default_factory=EgoSensors, description="gyroscope, steering, wheels")
    search: GeneticSearch = Field(default_factory=GeneticSearch, description="the published lane search")
    plausibility: Plausibility = Field(default_factory=Plausibility, description="of the published search")
    refine: Refine = Field(default_factory=Refine, description="the default lane tracker")
    observer: ObserverSettings = Field(default_factory=ObserverSettings)
    prediction: PredictionSettings = Field(default_factory=PredictionSettings)
    departure: DepartureSettings = Field(default_factory=DepartureSettings)
    radar: Radar = Field(default_factory=Radar)
    roadside: Roadside = Field(default_factory=Roadside, description="what stands beside the road")
    tracker: TrackerSettings = Field(default_factory=TrackerSettings, description="of the radar")
    closing: Closing = Field(default_factory=Closing, description="range and speed of the vehicle in path")
    collision: Collision = Field(default_factory=Collision, description="the rear-end warning")
    conflicts: ConflictSettings = Field(
        default_factory=ConflictSettings, description="which rear-end conflicts count and what matches them"
    )
    reaction: Reaction = Field(default_factory=Reaction, description="drivers that react to warnings")
    recording: Recording = Field(default_factory=Recording)
    matching: Matching = Field(default_factory=Matching, description="of departure warnings to crossings")

    @model_validator(mode="after")
    def _lanes_step(self) -> "Configuration":
        if self.refine.step_s != STEP_S:
            raise ValueError(
                f"refine.step_s = {self.refine.step_s}: must be {STEP_S:g}, the step of a run; "
                "footage has a step of its own"
            )
        return self

    @property
    def hash(self) -> str:
        """SHA-256 over all settings, the same for equal settings on every machine."""
        text = json.dumps(_adapter().dump_python(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def observing(self) -> ObserverSettings:
        """The observer's settings in this run's mode."""
        return dataclasses.replace(self.observer, mode=self.mode)

    @property
    def tracking_lanes(self) -> Refine:
        """The lane tracker's settings on this run's vehicle."""
        return on_vehicle(self.refine, self.vehicle)

    @property
    def following(self) -> Closing:
        """How vehicles in path are followed in this run's mode: in `paper` mode by their tracks alone."""
        return dataclasses.replace(self.closing, enabled=self.closing.enabled and self.mode != "paper")

    @property
    def predicting(self) -> PredictionSettings:
        """The predictor's settings in this run's mode."""
        return dataclasses.replace(self.prediction, mode=self.mode)


@functools.cache
def _adapter() -> TypeAdapter[Configuration]:
    return TypeAdapter(Configuration)


def load_configuration(source: str, changes: Mapping[str, Any] | None = None) -> Configuration:
    """The settings behind a built-in name, a .toml or a .sumocfg, with `changes` laid over them.

    `changes` is nested like the file. Raises SettingsError.
    """
    mapping, path = scenario_mapping(source)
    return configuration_from(laid_over(mapping, changes or {}), str(path))


def configuration_from(mapping: Mapping[str, Any], source: str = "settings") -> Configuration:
    """Settings from a nested mapping; `condition` may be a preset's name, or hold one as `preset`."""
    mapping = dict(mapping)
    condition = mapping.get("condition")
    if isinstance(condition, str):
        condition = {"preset": condition}
    if isinstance(condition, Mapping) and "preset" in condition:
        condition = dict(condition)
        name = condition.pop("preset")
        if name not in PRESETS:
            raise SettingsError(f"{source}: condition.preset = {name!r}: known are {', '.join(PRESETS)}")
        mapping["condition"] = {**preset_settings(name), **condition}
    return read(Configuration, mapping, source)


CONFIGURATION = "configuration.json"


class RunSettings(NamedTuple):
    """Contents of `configuration.json` beside a run's tables."""

    configuration: Configuration
    run_id: str
    scenario: str  # as it was named; '' in a loop of the user's own
    compare_paper: bool
    versions: str


def write_configuration(
    directory: Path,
    configuration: Configuration,
    run_id: str,
    scenario: str,
    compare_paper: bool,
    detector: LaneDetector[Any] | None = None,
) -> None:
    """Write the settings of a run beside its tables; `sumo-adas run DIR/configuration.json` repeats it."""
    content = {
        "run_id": run_id,
        "scenario": scenario,
        "compare_paper": compare_paper,
        "detector": None if detector is None else type(detector).__name__,
        "configuration_hash": configuration.hash,
        "versions": versions(),
        "settings": dataclasses.asdict(configuration),
    }
    text = json.dumps(content, indent=1, ensure_ascii=False)
    (directory / CONFIGURATION).write_text(text + "\n", encoding="utf-8")


def read_configuration(directory: Path) -> RunSettings:
    """The settings of the run whose tables lie in `directory`. Raises SettingsError."""
    content = read_json(directory / CONFIGURATION)
    settings = content.get("settings")
    if not isinstance(settings, dict):
        raise SettingsError(f"{directory / CONFIGURATION}: not the settings of a run")
    return RunSettings(
        configuration_from(settings, str(directory / CONFIGURATION)),
        str(content.get("run_id", "")),
        str(content.get("scenario", "")),
        bool(content.get("compare_paper", False)),
        str(content.get("versions", "")),
    )


def versions() -> str:
    """The versions that a result may depend on."""
    parts = [f"python {platform.python_version()}"]
    for name in ("sumo-adas", "libsumo", "numpy", "numba", "opencv-python-headless"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            parts.append(f"{name} {metadata.version(name)}")
    return "; ".join(parts)  # no comma, so that the CSV table needs no quotation marks


def read_camera(path: Path) -> Camera:
    """A camera file, as `sumo-adas calibrate` writes it. Raises SettingsError."""
    mapping = read_toml(path)
    beside = [name for name in mapping if name != "camera"]
    if "camera" in mapping and beside:
        raise SettingsError(f"{path}: unknown key '{beside[0]}': a camera file has [camera] alone")
    return read(Camera, mapping.get("camera", mapping), str(path))
