"""Every reader with broken and hostile input, the same in every run: it takes it or says in words why not.

`make fuzz` does the same a thousand times longer. What it has found stands in `test_findings.py`.
"""

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fuzz import ALL, fuzz
from benchmarks.fuzz_readers import READERS, attempt

SLOW = {"radar_csv": 25, "udacity": 25, "comma2k19": 25, "network": 40, "campaign": 40, "video": 15}


@pytest.mark.parametrize("name", ALL)
def test_input_made_from_valid_one(name: str, tmp_path: Path) -> None:
    count = SLOW.get(name, 60)
    report = fuzz(name, count, seed=11, out=tmp_path, most_s=60.0)
    assert report["findings"] == {}
    assert report["inputs"] == count
    assert report["taken"]  # at least the valid one that all begin with


@pytest.mark.parametrize("name", list(READERS))
def test_the_inputs_they_begin_with_are_taken(name: str, tmp_path: Path) -> None:
    for content in READERS[name].seeds:
        assert attempt(READERS[name], content, tmp_path).taken


def test_a_reader_that_breaks_is_found_out(tmp_path: Path) -> None:
    def breaks(file: Path) -> object:
        return {}[file.read_bytes()]

    broken = READERS["camera"]._replace(read=breaks)
    assert attempt(broken, b"x", tmp_path).finding.startswith("KeyError")


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
_KEYS = st.sampled_from(
    (
        "duration_s",
        "seed",
        "title",
        "condition",
        "equipment",
        "highway",
        "driver",
        "actors",
        "script",
        "net_file",
    )
)


@settings(max_examples=60, derandomize=True, database=None)
@given(st.dictionaries(_KEYS | st.text(max_size=10), _VALUES, max_size=4))
def test_any_mapping_is_a_configuration_or_refused(mapping: dict[str, object]) -> None:
    from plugin.configuration import Configuration, configuration_from
    from sumo_net.settings import SettingsError

    with contextlib.suppress(SettingsError):
        assert isinstance(configuration_from(mapping), Configuration)
