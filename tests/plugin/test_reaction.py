"""Drivers that react to warnings: which do, and that this keeps vehicles in their lanes."""

from pathlib import Path

import numpy as np

from plugin.reaction import Listeners, Reaction
from plugin.record import read_table
from tests.plugin.test_assistance import run
from tests.processes import in_process


def test_who_listens_is_fixed_by_seed_and_vehicle() -> None:
    handles, warned = np.arange(1000), np.ones(1000, bool)
    some = Listeners(Reaction(on=True, compliance=0.7), 1, str)
    first = some.of(handles, warned)
    assert 640 < len(first) < 760
    assert some.of(handles, warned).tolist() == first.tolist()
    assert Listeners(Reaction(on=True, compliance=0.7), 2, str).of(handles, warned).tolist() != first.tolist()
    assert some.of(handles, np.zeros(1000, bool)).tolist() == []
    assert Listeners(Reaction(on=False), 1, str).of(handles, warned).tolist() == []


def test_drivers_who_react_depart_less_far(tmp_path: Path) -> None:
    """Same seed, same distractions: the steps that a wheel is over a border become fewer."""
    beyond = {}
    for name, on in (("without", False), ("with", True)):
        options = {
            "duration_s": 25.0,
            "fraction": 0.1,
            "seed": 3,
            "changes": {
                "driver": {"distraction_per_min": 12.0, "glance_mean_s": 2.5, "wake_beyond_border_m": 1.0},
                "reaction": {"on": on, "compliance": 1.0},
                "recording": {"tracks": False},
            },
        }
        in_process(run, tmp_path / name, options)
        steps = read_table(tmp_path / name, "steps")
        drifting = steps[steps["true_cause"] == "distraction"]
        beyond[name] = int((drifting["true_tlc_s"] == 0.0).sum())
    assert beyond["without"] > 50
    assert beyond["with"] < 0.8 * beyond["without"]
