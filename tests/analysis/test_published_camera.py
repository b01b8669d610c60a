"""The published camera experiments: their truth against independent integrators, and their results."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.linalg import expm

from analysis.cli import main
from analysis.published import (
    comparison,
    correction,
    recognition,
    road,
    road_drives,
    search_times,
    simulation,
)
from analysis.published.experiments import EXPERIMENTS, reproduce_all
from analysis.published.manoeuvre import drive, world_path
from sumo_net.plain_road import PlainRoad, road_ahead
from sumo_net.vehicle import Vehicle, single_track, steady_state

# --- the truth of the runs


def test_drive_is_the_closed_form_step_response() -> None:
    """x(t) = (I − e^{At}) x_∞ at constant speed and steer."""
    vehicle, v = Vehicle(), 88.0 / 3.6
    made = drive(vehicle, lambda *_: 0.01, lambda t: v, duration_s=2.0)
    A, _ = single_track(vehicle, v)
    end = steady_state(vehicle, v, 0.01)
    for k in (1, 5, 20):
        expected = end - expm(A * made.time_s[k]) @ end
        assert [made.lateral_speed_mps[k], made.yaw_rate_rps[k]] == pytest.approx(expected, rel=1e-6)


def test_drive_on_a_clothoid_is_that_of_an_independent_integrator() -> None:
    """scipy's solve_ivp on the matrices of eq. 11 in the world, the speed changing; then put on the road."""
    vehicle = Vehicle(mass_kg=1460.0)

    def speed(t: float) -> float:
        return 20.0 + 0.5 * t

    made = drive(vehicle, lambda *_: 0.006, speed, lambda s: 1e-3 + 1e-5 * s, duration_s=4.0, each=1)

    def in_world(t: float, x: np.ndarray) -> np.ndarray:
        v, (v_y, yaw, _, _, heading) = speed(t), x
        A, B = single_track(vehicle, v)
        moved = A @ x[:2] + B[:, 0] * 0.006
        cos, sin = np.cos(heading), np.sin(heading)
        return np.array([*moved, v * cos - v_y * sin, v * sin + v_y * cos, yaw])

    done = solve_ivp(in_world, (0.0, 4.0), np.zeros(5), t_eval=made.time_s, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(made.lateral_speed_mps, done[0], atol=1e-5)
    np.testing.assert_allclose(made.yaw_rate_rps, done[1], atol=1e-5)
    x, y, heading = world_path(made)
    np.testing.assert_allclose([x, y, heading], done[2:], atol=1e-3)
    # road coordinates: the foot's place on the clothoid, by its own integral, and d to its left
    s, d, last = made.station_m[-1], made.offset_m[-1], done[:, -1]
    along = np.linspace(0.0, s, 20_001)
    direction = 1e-3 * along + 0.5e-5 * along**2
    foot = np.trapezoid(np.cos(direction), along), np.trapezoid(np.sin(direction), along)
    assert foot[0] - d * np.sin(direction[-1]) == pytest.approx(last[2], abs=1e-3)
    assert foot[1] + d * np.cos(direction[-1]) == pytest.approx(last[3], abs=1e-3)


def test_plain_road_is_the_closed_form_where_there_is_one() -> None:
    clothoid = PlainRoad(np.array([-500.0, 1500.0]), np.array([-0.5e-3, 1.5e-3]))
    along = clothoid.ahead([0.0, 40.0], [0.2, -0.3], [0.01, 0.0])
    closed = road_ahead([0.0, 4e-5], 1e-6, [0.2, -0.3], [0.01, 0.0], [0.0, 40.0])
    for got, want in zip(along, closed, strict=True):
        np.testing.assert_allclose(got, want, atol=1e-9)


def test_plain_road_turns_by_the_integral_of_its_curvature() -> None:
    made, s = road_drives.ROAD, np.linspace(-100.0, 700.0, 8001)
    summed = cumulative_trapezoid(made.curvature(s), s, initial=0.0)
    np.testing.assert_allclose(made.heading(s) - made.heading(s[0]), summed, atol=1e-6)


# --- results of the experiments


def test_a_comparison_says_where_its_number_is_from() -> None:
    with pytest.raises(ValueError, match="basis = ''"):
        comparison.row("run", "figure", "m", 1.0, 2.0)
    table = comparison.table([comparison.claim("r", "f", "%", 95.0, 90.0, at_most=False)])
    assert table.loc[0, "holds"] == "yes"
    assert table.loc[0, "difference"] == 5.0
    assert "f (at least)" in comparison.text(table)
    assert comparison.markdown(table).count("\n") == 2


@pytest.fixture(scope="module")
def of_simulation() -> pd.DataFrame:
    return simulation.compare(simulation.curves()).set_index(["run", "figure"])


def test_simulation_runs_keep_the_sources_claim_where_the_load_is_known(of_simulation: pd.DataFrame) -> None:
    claims = of_simulation[of_simulation["basis"] == "claim"]
    for (run, figure), row in claims.iterrows():
        expected = "no" if "assumed" in figure else "yes"  # full load taken for half: see docs/published.md
        assert row["holds"] == expected, (run, figure)


def test_steady_turn_is_near_the_print(of_simulation: pd.DataFrame) -> None:
    turn = of_simulation.loc["steady turn, 0.05 rad"]
    assert (turn["difference"].abs() < 0.02).all()
    assert len(turn) == 8


def test_correction_is_the_printed_curve() -> None:
    curve = correction.curves()
    np.testing.assert_allclose(curve["factor"], curve["factor_of_steady_turn"], rtol=1e-9)
    table = correction.compare(curve).dropna(subset="published")
    assert (table["difference"].abs() < 5e-4).all()


def test_search_is_faster_than_published_in_every_class() -> None:
    measured = search_times.times(search_times.SearchTimes(vehicles=4, later_frames=4, repeats=1))
    table = search_times.compare(measured)
    ours = table[table["unit"] == "ms"]
    assert (ours["difference"] < 0).all()
    assert (table[table["unit"] == ""]["difference"] == 0).all()


def test_recognition_compares_good_by_value_and_complex_by_bound() -> None:
    rate = pd.DataFrame(
        [
            {"scenario": "straight", "condition": condition, "chain": chain, "recognised_percent": percent}
            for condition, chain, percent in (("clear", "paper", 91.0), ("complex", "refined", 99.0))
        ]
    )
    table = recognition.compare(rate)
    assert list(table["holds"]) == ["", "yes"]
    assert list(table["difference"]) == [-9.0, 9.0]


def test_road_runs_observe_and_predict(tmp_path: Path) -> None:
    experiment = road_drives.RoadRuns(cars=1, duration_s=4.2)
    table = road.reproduce(tmp_path, experiment).set_index(["run", "figure"])["measured"]
    for run in road_drives.RUNS:
        of_run = table.loc[run.title]
        assert of_run["lane locked, refined"] == 100.0
        assert of_run["borders recognised, refined"] == 100.0
        assert of_run["observed offset, RMSE, refined"] < 0.03
        assert of_run["path 2 s ahead, median, refined"] < 0.15
        assert of_run["path 2 s ahead, median, refined"] < of_run["path 2 s ahead, median, paper"]
    for name in ("road.png", "road_frames.png"):
        assert (tmp_path / name).stat().st_size > 10_000
    paths = pd.read_csv(tmp_path / "road_paths.csv")
    assert set(paths["path"]) == {"driven", "paper", "refined"}


# --- the command


def test_reproduce_lists_and_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["reproduce", "--list"])
    assert list(EXPERIMENTS) == [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    with pytest.raises(SystemExit):
        main(["reproduce", "correction", "--out", str(tmp_path)])
    assert "0.000843" in capsys.readouterr().out
    assert (tmp_path / "correction.png").stat().st_size > 10_000
    assert len(pd.read_csv(tmp_path / "correction_comparison.csv")) == 9


def test_reproduce_all_gathers(tmp_path: Path) -> None:
    table = reproduce_all(tmp_path, ("correction", "simulation"))
    assert list(table["experiment"].unique()) == ["correction", "simulation"]
    assert len(pd.read_csv(tmp_path / "comparison.csv")) == len(table)
    assert (tmp_path / "comparison.md").read_text().startswith("## correction")
    assert (tmp_path / "simulation" / "simulation.png").exists()


@pytest.mark.parametrize("words", [["reproduce"], ["reproduce", "immm"]])
def test_reproduce_names_the_experiments(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert "known are simulation, road" in capsys.readouterr().err.lower()
