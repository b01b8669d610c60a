"""SUMO's own window, on a virtual display."""

import ctypes.util
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from analysis.window import DANGER, INACTIVE, LANE_LEFT, NOT_SEEN, PAGE, PICTURE, STATES, states
from plugin.record import read_table
from plugin.warning import collision, departure
from tests.processes import in_process

OPTIONS: dict[str, Any] = {
    "duration_s": 2.0,
    "fraction": 0.05,
    "seed": 3,
    "threads": 1,
    "quiet": True,
    "changes": {"warm_up_s": 1.0},
}


@pytest.fixture(scope="module")
def display() -> Iterator[str]:
    if shutil.which("Xvfb") is None or ctypes.util.find_library("GL") is None:
        pytest.skip("needs Xvfb and libGL (apt-get install xvfb libgl1)")
    reading, writing = os.pipe()
    words = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1300x800x24", "-nolisten", "tcp"]
    server = subprocess.Popen(words, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as said:
        number = said.readline().strip()
    if not number:
        pytest.skip("Xvfb does not start here")
    yield f":{number}"
    server.terminate()
    server.wait()


def with_and_without(folder: Path, display: str) -> None:
    """With a window that is closed after 15 steps, and without; in one process, to load the kernels once."""
    from analysis.simulate import Window, simulate
    from analysis.window import FleetWindow

    os.environ["DISPLAY"] = display
    step = FleetWindow.step

    def closing(self: FleetWindow) -> None:
        step(self)
        if self._steps == 15:
            self._traffic._sumo._process.terminate()

    FleetWindow.step = closing  # type: ignore[method-assign]
    simulate("highway", folder / "window", window=Window(0), **OPTIONS)
    simulate("highway", folder / "none", **OPTIONS)


def test_the_window_changes_no_row_shows_a_camera_and_may_be_closed(display: str, tmp_path: Path) -> None:
    in_process(with_and_without, tmp_path, display)
    # what was simulated by then is kept; of its last seconds the future is not known
    kinds = "window", "none"
    seen, unseen = (read_table(tmp_path / kind, "steps").drop(columns="true_tlc_s") for kind in kinds)
    assert 15 <= seen["time_s"].nunique() <= 20
    assert seen.equals(unseen[unseen["time_s"] <= seen["time_s"].max()])
    picture = cv2.imread(str(tmp_path / "window" / PICTURE))
    assert picture is not None
    assert picture.shape == (720, 1280, 3)
    assert picture[:600, :800].std() > 10.0
    assert PICTURE in (tmp_path / "window" / PAGE).read_text()


def test_what_is_more_urgent_is_shown() -> None:
    lane = np.array([departure.CODES.index(name) for name in ("warning left", "lane not seen", "inactive")])
    ahead = np.array([collision.CODES.index(name) for name in ("danger", "ready", "inactive")])
    assert [STATES[one] for one in states(lane, ahead)] == [DANGER, NOT_SEEN, INACTIVE]
    calm = np.zeros(3, np.int64)
    assert STATES[states(lane, calm)[0]] == LANE_LEFT


def test_states_are_told_apart_by_colour() -> None:
    colours = [state[:3] for state in STATES]
    assert len(set(colours)) == len(STATES) - 1  # left and right share one, the label tells them apart
