"""Contents of a protocol file. Every value of a test is data; units are in the names."""

import difflib
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from sumo_net.settings import SettingsError, read, read_toml, settings

LineName = Literal["solid", "dashed", "dots"]
SideName = Literal["left", "right"]


@settings
class Procedure:
    """Common fields of all tests."""

    name: str = Field(min_length=1, pattern=r"^[\w.-]+$", description="of the test, unique in the protocol")
    title: str = Field("", description="one line")
    clause: str = Field("", description="of the standard, where known")
    speed_kmh: float = Field(gt=0, le=200, description="of the vehicle under test")
    speed_tolerance_kmh: float = Field(gt=0, description="a trial that deviates more is invalid")
    radius_m: tuple[float, ...] = Field(
        (0.0,), min_length=1, description="of the road: positive left, negative right, 0 straight"
    )
    trials: int = Field(ge=1, le=100, description="per cell: one radius, side, rate of drift")
    least_passed: int = Field(ge=1, description="of a cell's trials")
    settle_s: float = Field(4.0, ge=1, le=60, description="driven before the manoeuvre")
    spacing_m: float = Field(150.0, ge=30, description="between trials driven at the same time")
    settings: dict[str, Any] = Field(default_factory=dict, description="override those of the protocol")


@settings
class DepartureTest(Procedure):
    """The vehicle drifts out of its lane: the alert must begin between two lines near the border."""

    line: LineName = Field(description="the line crossed")
    sides: tuple[SideName, ...] = Field(("left", "right"), min_length=1)
    drift_mps: tuple[float, ...] = Field(min_length=1, description="rates of departure")
    drift_tolerance_mps: float = Field(gt=0, description="a trial that deviates more is invalid")
    drift_tolerance_share: float = Field(0.0, ge=0, le=1, description="or this share of the rate, if more")
    drift_window_s: float = Field(0.5, gt=0, description="before the alert, to average the rate")
    ramp_s: float = Field(1.0, gt=0, le=5, description="until the drift reaches its rate")
    run_up_s: float = Field(0.5, ge=0, description="at the rate, before the earliest line")
    earliest_m: float = Field(description="tyre inside the border; no alert may begin before")
    earliest_time_s: float = Field(0.0, ge=0, description="or this times the rate, if more …")
    earliest_most_m: float = Field(1.5, description="… but at most this")
    latest_m: float = Field(description="tyre outside the border; the alert must have begun by then")
    spread_most_m: float | None = Field(None, gt=0, description="largest spread of a cell's alerts")

    def earliest_at(self, drift_mps: float) -> float:
        """The earliest line for a rate of departure, m inside the border."""
        timed = min(self.earliest_time_s * drift_mps, self.earliest_most_m)
        return max(self.earliest_m, timed)


@settings
class QuietTest(Procedure):
    """The vehicle keeps its lane: there must be no alert."""

    distance_m: float = Field(gt=0, le=20_000, description="of one trial")
    line: LineName = Field("solid")
    inside_m: float = Field(description="a trial with a tyre nearer to a border than this is invalid")


@settings
class CollisionTest(Procedure):
    """The vehicle approaches another one: the alert must come in time, or not at all."""

    expect: Literal["alert", "none"] = Field("alert")
    leader_kmh: float = Field(ge=0, le=200)
    leader_lane: Literal["own", "left", "right"] = Field("own")
    gap_m: float = Field(gt=1, le=300, description="bumper to bumper at the start")
    gap_tolerance_m: float | None = Field(None, gt=0, description="of gap_m, when the leader brakes")
    brake_mps2: float | None = Field(None, gt=0, le=10, description="of the leader, from settle_s on")
    brake_tolerance_share: float = Field(0.1, gt=0, le=1)
    ttc_least_s: float | None = Field(None, gt=0, description="least TTC when the alert begins")
    ttc: Literal["constant", "accelerated"] = Field(
        "constant", description="TTC at constant speeds, or with the leader's braking continued"
    )
    latest_reaction_s: float | None = Field(
        None, ge=0, description="T of the least gap v·T + v²/2a at the alert, v the closing speed"
    )
    latest_mps2: float | None = Field(None, gt=0, description="its a")
    detect_reaction_s: float | None = Field(
        None, ge=0, description="T of the gap v·T + v²/2a from which the radar must follow the leader"
    )
    detect_mps2: float | None = Field(None, gt=0, description="its a")

    @model_validator(mode="after")
    def _comes_nearer(self) -> "CollisionTest":
        if self.brake_mps2 is None and self.leader_kmh >= self.speed_kmh:
            raise ValueError(
                f"leader_kmh = {self.leader_kmh}: below speed_kmh = {self.speed_kmh}, or with brake_mps2"
            )
        for name in ("latest", "detect"):
            pair = getattr(self, f"{name}_reaction_s"), getattr(self, f"{name}_mps2")
            if (pair[0] is None) != (pair[1] is None):
                raise ValueError(f"{name}_reaction_s and {name}_mps2: both or none")
        return self

    def latest_range_m(self, closing_mps: float) -> float | None:
        """Least gap at the alert, None if not required."""
        return _stopping_m(closing_mps, self.latest_reaction_s, self.latest_mps2)

    def detection_range_m(self, closing_mps: float) -> float | None:
        """Gap from which the leader must be followed, None if not required."""
        return _stopping_m(closing_mps, self.detect_reaction_s, self.detect_mps2)


def _stopping_m(speed_mps: float, reaction_s: float | None, braking_mps2: float | None) -> float | None:
    if reaction_s is None or braking_mps2 is None:
        return None
    return speed_mps * reaction_s + speed_mps**2 / (2.0 * braking_mps2)


@settings
class Protocol:
    """A protocol file."""

    title: str
    source: str = Field(description="standard and edition")
    from_memory: bool = Field(description="the values were written down without the text at hand")
    notes: str = Field("", description="how it was interpreted or changed")
    overall_share: float = Field(
        0.0, ge=0, le=1, description="share of all trials that must pass, besides the cells"
    )
    attempts: int = Field(3, ge=1, le=10, description="attempts at a trial while it is invalid")
    settings: dict[str, Any] = Field(default_factory=dict, description="of all runs, as in a scenario file")
    departure: tuple[DepartureTest, ...] = Field(())
    quiet: tuple[QuietTest, ...] = Field(())
    collision: tuple[CollisionTest, ...] = Field(())


def protocols() -> dict[str, Path]:
    """The protocols' files by name."""
    folder = resources.files("analysis.protocol") / "standards"
    return {
        Path(str(file)).stem.replace("_", "-"): Path(str(file))
        for file in sorted(folder.iterdir(), key=str)
        if file.name.endswith(".toml")
    }


def load(name: str) -> Protocol:
    """A protocol by its name, or a .toml file of the user's. Raises SettingsError."""
    known = protocols()
    path = Path(name) if name.endswith(".toml") else known.get(name)
    if path is None:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(known)}"
        raise SettingsError(f"no protocol '{name}': {hint} (or name a .toml file)")
    protocol = read(Protocol, read_toml(path), str(path))
    tests = [*protocol.departure, *protocol.quiet, *protocol.collision]
    if len({test.name for test in tests}) < len(tests):
        raise SettingsError(f"{path}: two tests have the same name")
    for test in tests:
        if test.least_passed > test.trials:
            raise SettingsError(
                f"{path}: {test.name}: least_passed = {test.least_passed}: at most trials = {test.trials}"
            )
    return protocol
