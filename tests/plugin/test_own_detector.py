"""A lane detector of the user's own in place of the default one."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from camera_synth.camera import Camera, image_from_vehicle, projection
from plugin.lane.detector import Found, Glance, LaneTracker, PublishedSearch, TrackedLane, found_lane
from plugin.lane.estimate import BORDER_Y
from tests.processes import in_process


class Counted(NamedTuple):
    frames: Any  # (n,) so far


class Believer:
    """Takes every vehicle to be 0.5 m left of the centre of a straight lane, from its second frame on."""

    def init(self, keys: Any) -> Counted:
        return Counted(np.zeros(len(keys), np.int64))

    def step(self, glance: Glance, state: Counted) -> tuple[Counted, Found]:
        assert glance.frames.shape == (len(state.frames), 240, 320)
        assert glance.frames[:, 120:].any()
        offset, nothing = np.full(len(state.frames), 0.5), np.zeros(len(state.frames))
        lane = found_lane(Camera(), state.frames > 0, offset, nothing, nothing, nothing + 3.75)
        return Counted(state.frames + 1), lane


class Wrapped:
    """The default tracker, in a class that the project does not know."""

    def __init__(self, configuration: Any) -> None:
        c = configuration
        self._inner = LaneTracker(c.refine, PublishedSearch(c.search, c.camera, c.plausibility), c.camera)

    def init(self, keys: Any) -> TrackedLane:
        return self._inner.init(keys)

    def step(self, glance: Glance, state: TrackedLane) -> tuple[TrackedLane, Found]:
        return self._inner.step(glance, state)


def run(detector: str, threads: int, out: Path | None = None) -> Any:
    """Table `steps` of 6 s with a fleet that two threads share."""
    import tempfile

    from plugin import DriverAssistance
    from plugin.configuration import load_configuration
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    changes = {"duration_s": 6.0, "equipment": {"fraction": 0.6}, "seed": 5}
    configuration = load_configuration("highway", changes)
    made: Any = {"default": None, "believer": Believer(), "wrapped": Wrapped(configuration)}[detector]
    with tempfile.TemporaryDirectory() as work:
        prepared = prepare(configuration, Path(work))
        with Traffic.start(prepared.arguments) as traffic:
            with DriverAssistance(
                traffic, configuration, prepared.network, threads=threads, detector=made, out=out
            ) as adas:
                for _ in range(60):
                    traffic.step()
                    adas.step()
            return adas.tables["steps"]


def test_the_default_tracker_given_as_an_own_detector_changes_nothing() -> None:
    ordinary, wrapped = in_process(run, "default", 1), in_process(run, "wrapped", 2)
    assert len(ordinary) > 500
    assert ordinary.equals(wrapped)


def test_what_an_own_detector_finds_is_in_the_table(tmp_path: Path) -> None:
    steps = in_process(run, "believer", 2, tmp_path)
    first = ~steps.duplicated("vehicle_id")
    assert first.sum() > 10
    assert not steps.loc[first, "lane_locked"].any()
    assert steps.loc[~first, "lane_locked"].all()
    assert (steps.loc[~first, "lateral_offset_m"] == 0.5).all()
    assert '"detector": "Believer"' in (tmp_path / "configuration.json").read_text()


@pytest.mark.parametrize("yaw_rad", [0.0, 0.02])
@pytest.mark.parametrize(("heading_rad", "curvature_1pm"), [(0.0, 0.0), (0.02, 0.0), (-0.01, 1 / 400)])
def test_a_lane_on_the_ground_is_seen_where_the_camera_sees_it(
    heading_rad: float, curvature_1pm: float, yaw_rad: float
) -> None:
    camera = Camera(yaw_rad=yaw_rad)
    one = np.ones(1)
    found = found_lane(camera, one > 0, 0.3 * one, heading_rad * one, curvature_1pm * one, 3.6 * one)
    d = camera.preview_m
    s = np.linspace(2.0, 50.0, 4000)  # along the lane's centre, which the vehicle is 0.3 m left of
    turned = curvature_1pm * s - heading_rad
    step = np.diff(s, prepend=0.0)
    x, y = np.cumsum(np.cos(turned) * step), -0.3 + np.cumsum(np.sin(turned) * step)
    x, y = x - 0.3 * np.sin(heading_rad), y + 0.3 * (1.0 - np.cos(heading_rad))
    for side, half in enumerate((1.8, -1.8)):
        ahead, left = x - half * np.sin(turned), y + half * np.cos(turned)
        seen = np.array(
            [image_from_vehicle(a, b, 0.0, projection(camera))[:2] for a, b in zip(ahead, left, strict=True)]
        )
        inside = (seen[:, 0] > 0) & (seen[:, 0] < 319)
        rows = (seen[inside, 1].min() < BORDER_Y) & (seen[inside, 1].max() > BORDER_Y)
        assert rows.sum() > 15
        expected = np.interp(BORDER_Y[rows], seen[:, 1], seen[:, 0])
        np.testing.assert_allclose(found.columns[0, side, rows], expected, atol=0.7)
    centre = np.interp(d, x, y)
    assert found.lane.preview_offset_m[0] == pytest.approx(centre, abs=0.03)
    assert found.lane.preview_heading_rad[0] == pytest.approx(np.interp(d, x, turned), abs=2e-3)
