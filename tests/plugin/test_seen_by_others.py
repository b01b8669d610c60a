"""Position at which another vehicle sees an equipped one: where it drives, not SUMO's lane position."""

from pathlib import Path

import numpy as np
import pytest

from sumo_net.arrays import Array
from tests.processes import in_process


def change_lane_ahead(out: Path) -> tuple[Array, Array]:
    """(steps, 3) forward, left and heading of the one that changes lanes: as the other sees it, and truly."""
    import libsumo

    from analysis.simulate import settings_of
    from plugin import DriverAssistance
    from sumo_net.scenario import prepare

    ego = {"id": "ego", "lane": 1, "position_m": 100.0, "speed_mps": 25.0, "equipped": True}
    changes = {
        "warm_up_s": 0.0,
        "demand": {"flow_per_lane_vph": 0.0},
        "equipment": {"fraction": 0.0},
        "actors": [ego, {**ego, "id": "other", "lane": 0, "position_m": 135.0}],
        "script": [{"who": "other", "at_s": 2.0, "do": "change_lane", "side": "left"}],
    }
    configuration = settings_of("straight", seed=4, duration_s=8.0, changes=changes)
    prepared = prepare(configuration, out)
    libsumo.start(["sumo", *prepared.arguments])
    seen, driven = [], []
    with DriverAssistance.attach(libsumo, settings=configuration, threads=1) as adas:
        for _ in range(80):
            libsumo.simulationStep()
            adas.step()
            if len(adas.vehicles) < 2:
                continue
            (moment,) = adas.latest.moments
            scene = moment.scene
            row, other = adas.vehicles.index("ego"), adas.vehicles.index("other")
            place = np.flatnonzero(scene.objects.handle[row] == moment.handle[other])[0]
            parts = (scene.objects.forward_m, scene.objects.left_m, scene.objects.heading_rad)
            seen.append([part[row, place] for part in parts])
            pose = scene.pose
            dx, dy = pose.x_m[other] - pose.x_m[row], pose.y_m[other] - pose.y_m[row]
            c, s = np.cos(pose.heading_rad[row]), np.sin(pose.heading_rad[row])
            turn = pose.heading_rad[other] - pose.heading_rad[row]
            driven.append([c * dx + s * dy, c * dy - s * dx, turn])
    libsumo.close()
    return np.array(seen), np.array(driven)


def test_a_lane_change_is_seen_as_it_is_driven(tmp_path: Path) -> None:
    seen, driven = in_process(change_lane_ahead, tmp_path)
    assert np.ptp(driven[:, 1]) > 3.0  # a lane's width
    assert np.abs(np.diff(seen[:, 1])).max() < 0.25
    assert seen[:, 2] == pytest.approx(driven[:, 2], abs=1e-9)
    # the body's centre is on its axis, as far behind the centre of gravity throughout
    behind = seen[:, :2] - driven[:, :2]
    along = np.column_stack((np.cos(driven[:, 2]), np.sin(driven[:, 2])))
    assert behind == pytest.approx(behind[0] @ along[0] * along, abs=1e-6)
