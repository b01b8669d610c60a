"""The functions that the benchmark's stopwatch times by name exist."""

import importlib.util
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_every_function_that_the_benchmark_times_exists() -> None:
    specification = importlib.util.spec_from_file_location("stages", BENCHMARKS / "stages.py")
    assert specification is not None
    assert specification.loader is not None
    stages = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(stages)
    timed = stages.functions()
    missing = [f"{owner.__name__}.{name}" for owner, name, _ in timed if not hasattr(owner, name)]
    assert not missing
    assert {stage for _, _, stage in timed} <= set(stages.STAGES)
