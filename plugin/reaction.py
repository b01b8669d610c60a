"""Drivers that react to their warnings, to measure the benefit of the warnings."""

from collections.abc import Callable

import numpy as np
from pydantic import Field

from sumo_net.arrays import Array
from sumo_net.randomness import stream_key, uniform
from sumo_net.settings import settings

_REMEMBERED = 10_000  # drivers


@settings
class Reaction:
    """Whether drivers react. Reaction times: `driver.reaction_mean_s` (lane departure), `rear_end_s`."""

    on: bool = Field(
        False, description="drivers react to warnings; false: warnings change nothing in the traffic"
    )
    compliance: float = Field(0.9, ge=0, le=1, description="share of drivers that react at all")
    rear_end_s: float = Field(
        0.8,
        gt=0,
        le=5,
        description="time after a rear-end warning at which a driver who looked away looks ahead again",
    )


class Listeners:
    """Which drivers react to their warnings; fixed by the seed and the vehicle's id."""

    def __init__(self, options: Reaction, seed: int, name: Callable[[int], str]) -> None:
        self._options, self._seed, self._name = options, seed, name
        self._listens: dict[int, bool] = {}

    def of(self, handle: Array, warned: Array) -> Array:
        """Handles of the vehicles `warned` (n,) whose drivers react; none while `on` is false."""
        if not self._options.on:
            return np.zeros(0, np.int64)
        return np.array([one for one in handle[warned].tolist() if self._one(one)], np.int64)

    def _one(self, handle: int) -> bool:
        if handle not in self._listens:
            if len(self._listens) >= _REMEMBERED:
                self._listens.clear()  # drawing again gives the same values
            key = stream_key(self._seed, self._name(handle), "compliance")
            self._listens[handle] = bool(uniform(key, 0) < self._options.compliance)
        return self._listens[handle]
