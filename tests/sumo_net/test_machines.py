"""Drivers and vehicles on a processor without AVX and fused multiply-adds: only the last bits differ."""

import numpy as np
import pytest

from sumo_net.driver import Driver
from tests.other_machine import there
from tests.sumo_net.bench_road import Bench, motorway

TOLERANCE = 1e-9  # m, rad, m/s, rad/s; see docs/trust.md


def driven() -> dict[str, list[float]]:
    """Where 16 drivers with all their weaknesses are after 30 s."""
    bench = Bench(Driver(), 16, 30.0, motorway, seed=4)
    for _ in range(300):
        bench.step()
    return {name: getattr(bench.motion, name).tolist() for name in bench.motion._fields[5:10]}


def test_after_half_a_minute_the_vehicles_are_where_they_are_here() -> None:
    here, other = driven(), there(driven)
    assert np.abs(here["offset_m"]).max() > 0.2
    for name, values in here.items():
        assert other[name] == pytest.approx(values, abs=TOLERANCE), name
