"""The filters by name, behind one interface."""

from typing import Any, Literal, Protocol

from pydantic import Field

from plugin.tracking.adaptive import Adaptation
from plugin.tracking.detections import Detections, SensorMotion
from plugin.tracking.ground import GroundFilter
from plugin.tracking.imm import markov_of
from plugin.tracking.models import GroundMotion, PolarMotion, RadarNoise
from plugin.tracking.polar import PolarFilter, StartSpread
from sumo_net.arrays import Array
from sumo_net.settings import settings

FilterName = Literal["imm", "adaptive", "patent", "cv", "ca"]
FILTERS: tuple[FilterName, ...] = ("imm", "adaptive", "patent", "cv", "ca")


class Filter(Protocol):
    """T tracks of a fleet of n vehicles at once; `owner` (T,) names each track's vehicle.

    A state is a NamedTuple of arrays with at least a row for each track. Rows are moved only in `predict`,
    which writes them all anyway: covariances are large. z (D, 3) is the filter's own form of a detection;
    `angle` (3,) says which of its components are angles.
    """

    angle: Array

    def start(self, detections: Detections, sensor: SensorMotion) -> Any:
        """States of new tracks, one for each detection."""

    def join(self, state: Any, tracks: int, new: Any) -> Any:
        """The first `tracks` rows of a state and those of new tracks after them; `state` is used up."""

    def predict(
        self, state: Any, rows: Array, owner: Array, dt: Array, sensor: SensorMotion, room: int
    ) -> tuple[Any, Array]:
        """States dt (n,) later, with the ego's motion taken out, of `rows` (T,) of `state`.

        Up to `room` tracks may be added before the next prediction. Also returns which tracks (T,) have
        covariances that are not positive definite or not finite.
        """

    def expect(self, state: Any, owner: Array, sensor: SensorMotion) -> tuple[Array, Array]:
        """Predicted measurement (T, 3) and its covariance S (T, 3, 3)."""

    def measure(self, detections: Detections) -> Array:
        """The detections as z (D, 3)."""

    def update(self, state: Any, z: Array, chosen: Array, owner: Array, sensor: SensorMotion) -> Any:
        """States after the detection chosen (T,) of z (D, 3), -1 for none; `state` is used up."""

    def restart(self, state: Any, lost: Array) -> Any:
        """The state with covariances (and noise estimates) of the tracks `lost` (T,) bool reset."""

    def estimate(self, state: Any, owner: Array, sensor: SensorMotion) -> Array:
        """Estimates from the first T states, polar and over ground: the parts of an Estimate, (10, T)."""


@settings
class FilterSettings:
    """Settings of the tracking filters."""

    noise: RadarNoise = Field(default_factory=RadarNoise)
    polar: PolarMotion = Field(default_factory=PolarMotion)
    ground: GroundMotion = Field(default_factory=GroundMotion)
    adaptation: Adaptation = Field(default_factory=Adaptation)
    start: StartSpread = Field(default_factory=StartSpread)
    imm_models: tuple[Literal["cv", "ca"], ...] = Field(("cv", "ca"), min_length=1)
    imm_stay: float = Field(
        0.98,
        gt=0,
        lt=1,
        description="diagonal of the transition matrix Π (inferred); the other models share the rest equally",
    )
    mount_forward_m: float = Field(
        0.0, description="distance of the radar ahead of the centre of gravity; in a run that of `radar`"
    )


def make(name: str, options: FilterSettings) -> Filter:
    """The filter `name`. Raises ValueError for an unknown name."""
    if name in ("adaptive", "patent"):
        return GroundFilter(
            name == "patent",
            options.adaptation,
            options.ground,
            options.noise,
            options.start,
            options.mount_forward_m,
        )
    kinds: dict[str, tuple[str, ...]] = {"imm": options.imm_models, "cv": ("cv",), "ca": ("ca",)}
    if name not in kinds:
        raise ValueError(f"filter = {name!r}: allowed are {', '.join(FILTERS)}")
    markov = markov_of(options.imm_stay, len(kinds[name]))
    return PolarFilter(
        kinds[name], markov, options.polar, options.noise, options.start, options.mount_forward_m
    )
