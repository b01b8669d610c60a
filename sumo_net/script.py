"""Scripted traffic: who is placed where, and what each does when.

`[[actors]]` are vehicles that a scenario places itself, `[[script]]` says what they are told. Times are
seconds from the beginning of what is recorded. What is told here is held, whatever is in the way.
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

    id: str = Field(min_length=1, pattern=r"^[^\s<>&\"']+$", description="SUMO's id of it")
    direction: Literal["forward", "backward"] = Field("forward", description="on the built-in highway")
    edges: tuple[str, ...] = Field((), description="its route, on a network of the user's")
    lane: int = Field(0, ge=0, le=20, description="0 is the rightmost")
    position_m: float = Field(
        ge=0, description="of its front bumper along its lane: the whole highway's, or the first edge's"
    )
    speed_mps: float = Field(ge=0, le=60)
    body: BodyName = Field("car", description="one of the demand's vehicle types: car, van, truck")
    equipped: bool = Field(False, description="has the assistance, and a lateral driver to be told")
    offset_m: float | None = Field(
        None, ge=-2, le=2, description="left of the lane's centre, where its driver keeps; none: drawn"
    )
    held: bool = Field(
        True, description="keeps speed and lane until told otherwise; else drives as others do"
    )
    at_s: float = Field(0.0, ge=0, description="when it is placed")

    @pydantic.model_validator(mode="after")
    def _has_a_driver(self) -> "Actor":
        if self.offset_m is not None and not self.equipped:
            raise ValueError(
                f"actor '{self.id}': offset_m = {self.offset_m}: only an equipped one has a line"
            )
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
    """What one vehicle does from one time on."""

    who: str = Field(min_length=1, description="an actor, or any vehicle of a configuration by its SUMO id")
    at_s: float = Field(ge=0, description="when")
    do: Literal["speed", "free", "veer", "change_lane"] = Field(
        description="speed: go over to speed_mps at rate_mps2 and hold it; free: drive as others do from "
        "now on; veer: drift off at drift_mps for for_s, then steer back; change_lane: to the side, at once"
    )
    speed_mps: float | None = Field(None, ge=0, le=60, description="of `speed`")
    rate_mps2: float | None = Field(None, gt=0, le=12, description="of `speed`, up or down; none: 3")
    drift_mps: float | None = Field(None, ge=-1.5, le=1.5, description="of `veer`, left positive")
    ramp_s: float | None = Field(None, gt=0, le=10, description="in which the drift grows; none: 1.5")
    for_s: float | None = Field(None, gt=0, le=600, description="of `veer`, with its ramp")
    side: Literal["left", "right"] | None = Field(None, description="of `change_lane`")
    signal: bool | None = Field(None, description="with the turn signal; none: yes")
    over_s: float | None = Field(
        None, ge=2, le=20, description="duration of an equipped vehicle's change; none: its driver's"
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
    """Whether the script fits its actors; `others`: it may speak of vehicles of the user's demand, too.

    Raises ValueError.
    """
    known = {actor.id: actor for actor in actors}
    if len(known) < len(actors):
        twice = next(a.id for k, a in enumerate(actors) if a.id in {b.id for b in actors[:k]})
        raise ValueError(f"actors: id = '{twice}' is there twice")
    for manoeuvre in script:
        actor = known.get(manoeuvre.who)
        if actor is None:
            if not others:
                names = ", ".join(known) or "none"
                raise ValueError(f"script: who = '{manoeuvre.who}' is no actor: actors are {names}")
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
