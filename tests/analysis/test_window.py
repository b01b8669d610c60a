"""SUMO's own window, on a display that is only in memory."""

import ctypes.util
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.window import DANGER, INACTIVE, LANE_LEFT, NOT_SEEN, PAGE, PICTURE, STATES, states
from plugin.warning import collision, departure
from tests.plugin.test_assistance import in_process

OPTIONS = {"duration_s": 3.0, "fraction": 0.05, "seed": 3, "threads": 1}


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


def run(out: Path, display: str) -> None:
    from analysis.simulate import Window, simulate

    os.environ["DISPLAY"] = display
    simulate("highway", out, quiet=True, window=Window(0) if display else None, **OPTIONS)


def closed_by_the_user(out: Path, display: str) -> None:
    from analysis.simulate import Window, simulate
    from analysis.window import FleetWindow

    os.environ["DISPLAY"] = display
    step = FleetWindow.step

    def closing(self: FleetWindow) -> None:
        step(self)
        if self._steps == 12:
            self._traffic._sumo._process.terminate()

    FleetWindow.step = closing  # type: ignore[method-assign]
    simulate("highway", out, quiet=True, window=Window(0), **OPTIONS)


def test_the_window_changes_no_table_and_the_camera_is_in_a_file(display: str, tmp_path: Path) -> None:
    in_process(run, tmp_path / "window", display)
    in_process(run, tmp_path / "none", "")
    for name in ("steps", "tracks", "runs"):
        seen, unseen = (tmp_path / kind / f"{name}.csv" for kind in ("window", "none"))
        assert seen.read_bytes() == unseen.read_bytes()
    picture = cv2.imread(str(tmp_path / "window" / PICTURE))
    assert picture is not None
    assert picture.shape == (720, 1280, 3)
    assert picture[:600, :800].std() > 10.0
    assert PICTURE in (tmp_path / "window" / PAGE).read_text()


def test_a_closed_window_keeps_the_rows(display: str, tmp_path: Path) -> None:
    in_process(closed_by_the_user, tmp_path, display)
    times = {line.split(",")[1] for line in (tmp_path / "steps.csv").read_text().splitlines()[1:]}
    assert 10 <= len(times) <= 20


def test_what_is_more_urgent_is_shown() -> None:
    lane = np.array([departure.CODES.index(name) for name in ("warning left", "lane not seen", "inactive")])
    ahead = np.array([collision.CODES.index(name) for name in ("danger", "ready", "inactive")])
    assert [STATES[one] for one in states(lane, ahead)] == [DANGER, NOT_SEEN, INACTIVE]
    calm = np.zeros(3, np.int64)
    assert STATES[states(lane, calm)[0]] == LANE_LEFT


def test_states_are_told_apart_by_colour() -> None:
    colours = [state[:3] for state in STATES]
    assert len(set(colours)) == len(STATES) - 1  # left and right share one, the label tells them apart
