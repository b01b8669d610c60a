"""Scripted traffic: vehicles that a scenario places, and their manoeuvres.

`[[actors]]` are the vehicles, `[[script]]` their manoeuvres. Times are seconds from the start of recording.
Scripted speeds and lane changes are carried out regardless of other vehicles.
"""

from collections.abc import Sequence
from typing import Literal

import pydantic
from pydantic import Field

from sumo_net.settings import settings

BodyName = Literal["car", "van", "truck"]


@settings
class Actor:
    """A vehicle placed on the road."""

    id: str = Field(min_length=1, pattern=r"^[^\s<>&\"']+$", description="SUMO's id of the vehicle")
    direction: Literal["forward", "backward"] = Field(
        "forward", description="direction on the built-in highway"
    )
    edges: tuple[str, ...] = Field((), description="route, on the user's own network")
    lane: int = Field(0, ge=0, le=20, description="index of the lane; 0 is the rightmost")
    position_m: float = Field(
        ge=0,
        description="position of the front bumper along the lane: of the whole highway, or of the first edge",
    )
    speed_mps: float = Field(ge=0, le=60)
    body: BodyName = Field("car", description="one of the demand's vehicle types: car, van, truck")
    equipped: bool = Field(False, description="has the assistance and a lateral driver model")
    offset_m: float | None = Field(
        None,
        ge=-2,
        le=2,
        description="lateral position of its driver, left of the lane's centre; none: drawn at random",
    )
    held: bool = Field(
        True, description="keeps speed and lane until commanded otherwise; false: drives like other vehicles"
    )
    at_s: float = Field(0.0, ge=0, description="time at which it is placed")

    @pydantic.model_validator(mode="after")
    def _has_a_driver(self) -> "Actor":
        if self.offset_m is not None and not self.equipped:
            raise ValueError(f"actor '{self.id}': offset_m = {self.offset_m}: needs equipped = true")
        return self


_NEEDED = {
    "speed": ("speed_mps",),
    "free": (),
    "veer": ("drift_mps", "for_s"),
    "change_lane": ("side",),
}
_ALLOWED = {
    "speed": ("speed_mps", "rate_mps2"),
    "free": (),
    "veer": ("drift_mps", "for_s", "ramp_s"),
    "change_lane": ("side", "signal", "over_s"),
}


@settings
class Manoeuvre:
    """A command to one vehicle, from one time on."""

    who: str = Field(
        min_length=1, description="id of an actor, or SUMO's id of any vehicle of a configuration"
    )
    at_s: float = Field(ge=0, description="time of the command")
    do: Literal["speed", "free", "veer", "change_lane"] = Field(
        description="speed: change to speed_mps at rate_mps2 and hold it; free: drive like other vehicles "
        "from now on; veer: drift off at drift_mps for for_s, then steer back; change_lane: "
        "change to `side` at once"
    )
    speed_mps: float | None = Field(None, ge=0, le=60, description="for `speed`: the speed to reach")
    rate_mps2: float | None = Field(
        None, gt=0, le=12, description="for `speed`: acceleration or deceleration; none: 3"
    )
    drift_mps: float | None = Field(
        None, ge=-1.5, le=1.5, description="for `veer`: lateral speed of the drift, left positive"
    )
    ramp_s: float | None = Field(
        None, gt=0, le=10, description="for `veer`: time in which the drift grows; none: 1.5"
    )
    for_s: float | None = Field(None, gt=0, le=600, description="for `veer`: duration, ramp included")
    side: Literal["left", "right"] | None = Field(None, description="for `change_lane`: the side")
    signal: bool | None = Field(None, description="for `change_lane`: use the turn signal; none: yes")
    over_s: float | None = Field(
        None,
        ge=2,
        le=20,
        description="for `change_lane`: duration of an equipped vehicle's change; none: its driver's",
    )

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "Manoeuvre":
        where = f"'{self.who}' at {self.at_s:g} s"
        for name in _NEEDED[self.do]:
            if getattr(self, name) is None:
                raise ValueError(f"{where}: do = '{self.do}' needs {name}")
        every = {name for names in _ALLOWED.values() for name in names}
        for name in sorted(every - set(_ALLOWED[self.do])):
            if getattr(self, name) is not None:
                allowed = ", ".join(_ALLOWED[self.do]) or "nothing"
                raise ValueError(f"{where}: do = '{self.do}' has no {name}, only {allowed}")
        return self


def check_script(actors: Sequence[Actor], script: Sequence[Manoeuvre], others: bool) -> None:
    """Check a script against its actors; `others`: it may also name vehicles of the user's own demand.

    Raises ValueError.
    """
    known = {actor.id: actor for actor in actors}
    if len(known) < len(actors):
        twice = next(a.id for k, a in enumerate(actors) if a.id in {b.id for b in actors[:k]})
        raise ValueError(f"actors: id = '{twice}' is used twice")
    for manoeuvre in script:
        actor = known.get(manoeuvre.who)
        if actor is None:
            if not others:
                names = ", ".join(known) or "none"
                raise ValueError(f"script: who = '{manoeuvre.who}' is not an actor: actors are {names}")
            continue
        if manoeuvre.at_s < actor.at_s:
            raise ValueError(
                f"script: at_s = {manoeuvre.at_s:g}: '{actor.id}' is placed only at {actor.at_s:g} s"
            )
        lateral = manoeuvre.do == "veer" or manoeuvre.over_s is not None or manoeuvre.signal is not None
        if lateral and not actor.equipped:
            raise ValueError(
                f"script: '{actor.id}' at {manoeuvre.at_s:g} s: veer, signal and over_s need equipped = true"
            )
