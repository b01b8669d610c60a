"""Drivers and vehicles on a processor without AVX and fused multiply-adds: the last bits differ, no more."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.machines import PLAIN
from sumo_net.driver import Driver
from tests.sumo_net.bench_road import Bench, motorway

TOLERANCE = 1e-9  # m, rad, m/s, rad/s; see docs/trust.md


def driven() -> dict[str, list[float]]:
    """Where 16 drivers with all their weaknesses are after 30 s."""
    bench = Bench(Driver(), 16, 30.0, motorway, seed=4)
    for _ in range(300):
        bench.step()
    return {name: getattr(bench.motion, name).tolist() for name in bench.motion._fields[5:10]}


def test_after_half_a_minute_the_vehicles_are_where_they_are_here() -> None:
    words = "import json; from tests.sumo_net.test_machines import driven; print(json.dumps(driven()))"
    done = subprocess.run(
        [sys.executable, "-c", words],
        env={**os.environ, **PLAIN},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    here, there = driven(), json.loads(done.stdout)
    assert np.abs(here["offset_m"]).max() > 0.2
    for name, values in here.items():
        assert there[name] == pytest.approx(values, abs=TOLERANCE), name
