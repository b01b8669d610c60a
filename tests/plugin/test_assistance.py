"""The whole chain in real SUMO runs, each in its own process, which can hold only one simulation."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from plugin.fleet import LEAST_PART
from plugin.record import read_table
from plugin.schema import TABLES
from tests.processes import in_process


def run(out: Path, options: dict[str, Any]) -> None:
    from analysis.simulate import simulate

    simulate("highway", out, quiet=True, **options)


def attach_in_a_loop(out: Path, through: str) -> list[str]:
    """The README's loop, through libsumo or traci."""
    import libsumo
    import sumolib
    import traci

    from analysis.simulate import settings_of
    from plugin import DriverAssistance
    from sumo_net.scenario import prepare

    prepared = prepare(settings_of("highway"), out)
    simulation = libsumo if through == "libsumo" else traci
    program = "sumo" if through == "libsumo" else sumolib.checkBinary("sumo")
    simulation.start([program, *prepared.arguments])
    with DriverAssistance.attach(simulation, equip=0.1, seed=7, threads=1) as adas:
        for _ in range(30):
            simulation.simulationStep()
            adas.step()
    simulation.close()
    return [adas.tables[name].to_csv(index=False) for name in adas.tables]


@pytest.fixture(scope="module")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    in_process(run, out, {"duration_s": 20.0, "fraction": 0.1, "seed": 3, "formats": ("csv", "parquet")})
    return out


def test_tables_have_the_documented_columns(short_run: Path) -> None:
    for name, columns in TABLES.items():
        table = pd.read_csv(short_run / f"{name}.csv")
        assert list(table.columns) == [column.name for column in columns]
        assert len(pd.read_parquet(short_run / f"{name}.parquet")) == len(table)


def test_every_step_of_every_vehicle_stands_once(short_run: Path) -> None:
    steps = read_table(short_run, "steps")
    assert not steps.duplicated(["vehicle_id", "time_s"]).any()
    assert steps["vehicle_id"].nunique() >= 10
    gaps = steps.sort_values("time_s").groupby("vehicle_id")["time_s"].diff().dropna()
    assert gaps.to_numpy() == pytest.approx(0.1, abs=1e-6)


def test_a_warning_is_where_its_vehicle_was_at_its_start(short_run: Path) -> None:
    place = ["lane_id", "true_x_m", "true_y_m"]
    warnings = read_table(short_run, "warnings")
    assert len(warnings) > 1
    steps = read_table(short_run, "steps").set_index(["vehicle_id", "time_s"])[place]
    there = steps.loc[list(zip(warnings["vehicle_id"], warnings["start_s"], strict=True))]
    assert there.to_numpy().tolist() == warnings[place].to_numpy().tolist()


def test_no_number_is_missing_without_the_flag_that_explains_it(short_run: Path) -> None:
    steps = read_table(short_run, "steps")
    assert steps[["speed_mps", "true_lateral_offset_m", "true_yaw_rate_rps"]].notna().all(axis=None)
    locked = steps[steps["lane_locked"]]
    assert len(locked) > 0.9 * len(steps)
    assert (
        locked[["lateral_offset_m", "heading_error_rad", "curvature_1pm", "lane_width_m"]]
        .notna()
        .all(axis=None)
    )
    assert steps.loc[~steps["lane_locked"], ["lateral_offset_m", "curvature_1pm"]].isna().all(axis=None)


def test_estimates_follow_the_truth(short_run: Path) -> None:
    steps = read_table(short_run, "steps")
    error = (steps["lateral_offset_m"] - steps["true_lateral_offset_m"]).abs()
    assert error.median() < 0.03
    assert np.corrcoef(steps["yaw_rate_rps"].fillna(0.0), steps["true_yaw_rate_rps"])[0, 1] > 0.95


def test_same_seed_same_bytes_whatever_the_threads_and_the_share_equipped(tmp_path: Path) -> None:
    options = {"duration_s": 6.0, "seed": 5, "threads": 1}
    in_process(run, tmp_path / "a", options | {"fraction": 0.1})
    in_process(run, tmp_path / "b", options | {"fraction": 0.4})
    in_process(run, tmp_path / "c", options | {"fraction": 0.4, "threads": 3})
    for name in TABLES:
        assert (tmp_path / "b" / f"{name}.csv").read_bytes() == (tmp_path / "c" / f"{name}.csv").read_bytes()
    few, many = (pd.read_csv(tmp_path / run / "steps.csv") for run in "ab")
    assert many.groupby("time_s").size().min() >= 2 * LEAST_PART  # or there is nothing to share
    assert few["vehicle_id"].nunique() < many["vehicle_id"].nunique()
    first = few["time_s"].min()
    shared = many[many["vehicle_id"].isin(few["vehicle_id"]) & (many["time_s"] == first)].reset_index(
        drop=True
    )
    alone = few[few["time_s"] == first].reset_index(drop=True)
    truth, sensed = ["vehicle_id", "true_lateral_offset_m"], ["lateral_offset_m", "lane_score"]
    assert alone[truth].equals(shared[truth])
    # a vehicle that is equipped drives a line of its own, which others see: most have none nearby
    assert (alone[sensed] == shared[sensed]).all(axis=1).mean() > 0.8


def test_attached_to_a_users_loop_libsumo_and_traci_agree(tmp_path: Path) -> None:
    through_libsumo = in_process(attach_in_a_loop, tmp_path / "a", "libsumo")
    through_traci = in_process(attach_in_a_loop, tmp_path / "b", "traci")
    assert through_libsumo == through_traci
    assert through_libsumo[0].count("\n") > 30
