"""The radar's figures on a processor without AVX and fused multiply-adds."""

import numpy as np
import pytest

from plugin.tracking.tracker import Tracker, TrackerSettings
from tests.other_machine import there
from tests.plugin.radar_scene import Scene

RELATIVE = 1e-9  # of a figure; see docs/trust.md
POSITION = np.array([[60.0, 0.0], [190.0, 5.0], [110.0, 8.0], [90.0, -6.0], [70.0, 3.75]])
VELOCITY = np.array([[25.0, 0.0], [-25.0, 0.0], [0.0, 0.0], [0.0, 0.0], [20.0, 0.0]])


def followed() -> dict[str, float]:
    """Figures of 8 vehicles' trackers over 4 s, with false and missing detections, in a bend."""
    place = POSITION + np.random.default_rng(3).normal(0.0, 2.0, (8, 5, 2))
    scene = Scene(place, np.tile(VELOCITY, (8, 1, 1)), yaw_rate=0.02, detection=0.9, clutter=1.0)
    tracker = Tracker(TrackerSettings())
    state = tracker.init(8)
    errors, confirmed = [], 0
    for scan in scene.scans(np.random.default_rng(5), [0.1] * 40):
        state, tracks = tracker.step(state, scan.detections, scan.ego, scan.dt)
        confirmed += int(tracks.confirmed.sum())
        taken = np.flatnonzero(tracks.confirmed & (tracks.detection >= 0))
        body = scan.source[tracks.detection[taken]]
        taken, body = taken[body >= 0], body[body >= 0]
        owner, estimate = scan.detections.owner[tracks.detection[taken]], tracks.estimate
        polar = np.stack([estimate.range_m, estimate.range_rate_mps, estimate.azimuth_rad], axis=1)
        ground = np.stack([estimate.vx_mps, estimate.vy_mps], axis=1)
        errors.append(
            np.hstack(
                [polar[taken] - scan.polar[owner, body], ground[taken] - scan.velocity[owner, body]],
            )
        )
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    names = ("range_m", "range_rate_mps", "azimuth_rad", "vx_mps", "vy_mps")
    return {"confirmed": confirmed, **dict(zip(names, rms.tolist(), strict=True))}


def test_figures_of_the_radar_are_those_of_this_machine() -> None:
    here, other = followed(), there(followed)
    assert here["confirmed"] > 1000
    assert here["range_m"] < 1.0
    assert other["confirmed"] == here["confirmed"]
    assert other == pytest.approx(here, rel=RELATIVE)
