"""Vehicles that vanish, are moved, teleport or leave the road while they are equipped."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.plugin.test_truth import columns, score
from tests.processes import in_process

LANE = ["lateral_offset_m", "heading_error_rad", "curvature_1pm", "lane_width_m"]
MOTION = ["lateral_speed_mps", "yaw_rate_rps", "steer_rad"]
TRUTH = [
    "speed_mps", "true_lateral_offset_m", "true_heading_error_rad", "true_lateral_speed_mps",
    "true_yaw_rate_rps", "true_steer_rad", "true_curvature_here_1pm",
]  # fmt: skip
STEPS = 160


def upset_traffic(out: Path) -> dict[str, Any]:
    """Equipped vehicles are removed, moved, driven off the road, and jammed until they teleport."""
    import libsumo

    from analysis.simulate import settings_of
    from plugin import DriverAssistance
    from sumo_net.scenario import prepare

    changes = {"time_to_teleport_s": 2.0, "warm_up_s": 0.0}
    prepared = prepare(settings_of("highway", duration_s=STEPS / 10, changes=changes), out)
    libsumo.start(["sumo", *prepared.arguments])
    vehicle = libsumo.vehicle
    removed, moved, strayed, teleported = "", "", "", 0

    def way_left(name: str) -> float:
        """To the end of the lane; SUMO teleports the first vehicle of a lane."""
        left = libsumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        return left if left > 5.0 else np.inf

    with DriverAssistance.attach(libsumo, equip=0.5, seed=3, threads=1) as adas:
        for step in range(STEPS):
            libsumo.simulationStep()
            teleported += libsumo.simulation.getStartingTeleportNumber()
            if step == 20:
                removed, moved, strayed = adas.vehicles[:3]
                vehicle.remove(removed)
            if step == 30:
                edge, _, lane = vehicle.getLaneID(moved).rpartition("_")
                vehicle.moveTo(moved, f"{edge}_{(int(lane) + 1) % 2}", vehicle.getLanePosition(moved) / 2)
            if 40 <= step < 60 and strayed in vehicle.getIDList():
                x, y = vehicle.getPosition(strayed)
                vehicle.moveToXY(strayed, "", 0, x + 2.0, y + 25.0, keepRoute=2)
            if step == 50:
                jamming = min(adas.vehicles[3:], key=way_left)
                vehicle.setSpeedMode(jamming, 0)  # at once
                vehicle.setSpeed(jamming, 0.0)
            adas.step()
        seen = set(adas.vehicles)
    libsumo.close()
    tables = {name: adas.tables[name] for name in adas.tables}
    return tables | {
        "removed": removed, "moved": moved, "strayed": strayed, "teleported": teleported, "left": seen,
    }  # fmt: skip


@pytest.fixture(scope="module")
def upset(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return in_process(upset_traffic, tmp_path_factory.mktemp("upset"))


def test_what_was_meant_to_happen_did(upset: dict[str, Any]) -> None:
    steps = upset["steps"]
    assert upset["teleported"] > 0
    assert steps.loc[steps["vehicle_id"] == upset["removed"], "time_s"].max() == pytest.approx(2.0)
    assert upset["removed"] not in upset["left"]
    assert len(upset["left"]) > 5


def test_no_row_of_truth_has_a_hole(upset: dict[str, Any]) -> None:
    steps = upset["steps"]
    assert steps[TRUTH].notna().all(axis=None)
    assert not np.isinf(steps.select_dtypes("number")).any(axis=None)
    assert not steps.duplicated(["vehicle_id", "time_s"]).any()


def test_an_empty_estimate_has_the_flag_that_explains_it(upset: dict[str, Any]) -> None:
    steps = upset["steps"]
    locked = steps["lane_locked"].astype(bool)
    assert steps.loc[locked, LANE].notna().all(axis=None)
    assert steps.loc[~locked, LANE].isna().all(axis=None)
    unknown = steps[MOTION].isna().any(axis=1)
    # a warning that has begun is shown for a while, also where the lane is lost meanwhile
    goes_on = steps["ldw_active"] & steps.groupby("vehicle_id")["ldw_active"].shift(fill_value=False)
    assert (steps.loc[unknown, "ldw_state"].isin(["lane not seen", "inactive"]) | goes_on[unknown]).all()


@pytest.mark.parametrize("moved", [{"x_m": 540.0}, {"x_m": 80.0}, {"y_m": 3.75}])
def test_what_comes_after_a_move_is_not_scored_against_what_was_before(moved: dict[str, float]) -> None:
    rows = []
    for step in range(60):
        shift = {name: columns(step, 0.0, 0.0)[name][0] + by for name, by in moved.items()}
        rows.append(columns(step, 1.2 if step >= 30 else 0.0, 0.0, **(shift if step >= 30 else {})))
    recorder = score(rows)
    assert recorder.table("departures").empty
    predictions = recorder.table("predictions")
    assert predictions["longitudinal_error_m"].abs().max() < 1e-9
    assert predictions["lateral_error_m"].abs().max() < 1e-9
    assert len(predictions) == 2 * sum(30 - round(10 * horizon) for horizon in (0.5, 1.0, 1.5, 2.0))
    assert len(recorder.table("steps")) == 60


def test_a_jump_is_no_departure_and_no_prediction_spans_it(upset: dict[str, Any]) -> None:
    jump = 3.1  # seconds; the first step after the move
    departures: pd.DataFrame = upset["departures"]
    near = (departures["crossing_s"] - jump).abs() < 0.3
    assert not ((departures["vehicle_id"] == upset["moved"]) & near).any()
    predictions: pd.DataFrame = upset["predictions"]
    errors = predictions.loc[predictions["vehicle_id"] == upset["moved"], "longitudinal_error_m"]
    assert errors.abs().max() < 20.0
