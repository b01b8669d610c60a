"""Figures of tables that can be checked by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from analysis import evaluation_text, metrics
from analysis.evaluation import tlc_ratio

CAUSES = ["lane_keeping", "distraction", "microsleep", "lane_change_signalled", "lane_change_unsignalled"]


def steps_table(n: int, **columns: object) -> pd.DataFrame:
    table = pd.DataFrame(
        {
            "run_id": "r",
            "vehicle_id": "a",
            "time_s": np.round(0.1 * np.arange(n), 1),
            "speed_mps": 20.0,
            "true_cause": "lane_keeping",
            "on_marked_road": True,
            "lane_locked": True,
            "recognised": True,
            "paper_recognised": pd.NA,
        }
    )
    for name in ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "lateral_speed_mps",
                 "yaw_rate_rps", "steer_rad", "curvature_here_1pm"):  # fmt: skip
        table[f"true_{name}"] = 0.0
        table[name] = 0.0
    table["lane_width_m"] = 3.75
    for name in (
        "true_tlc_s",
        "tlc_s",
        "tlc_true_state_s",
        "tlc_constant_velocity_s",
        "tlc_constant_radius_s",
    ):
        table[name] = np.nan
    table = table.assign(**columns)
    return table.astype(dict.fromkeys(("on_marked_road", "lane_locked", "recognised"), "boolean"))


def predictions_table(steps: pd.DataFrame, **columns: object) -> pd.DataFrame:
    table = steps[["run_id", "vehicle_id", "time_s"]].merge(
        pd.DataFrame({"horizon_s": metrics.HORIZONS_S}), how="cross"
    )
    return table.assign(**dict.fromkeys(metrics.ERRORS.values(), 0.0)).assign(**columns)


def departures_table(rows: list[tuple[str, object, float]]) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=["cause", "warned", "lead_time_s"])
    return table.assign(in_zone=pd.array([True] * len(rows), "boolean")).astype({"warned": "boolean"})


def warnings_table(*outcomes: str) -> pd.DataFrame:
    return pd.DataFrame({"kind": "ldw", "outcome": list(outcomes)})


def test_distance() -> None:
    assert metrics.distance_km(steps_table(500)) == pytest.approx(1.0)  # 20 m/s for 50 s


def test_category_is_what_the_driver_does_then_the_road() -> None:
    steps = steps_table(7, true_cause=[*CAUSES, "lane_keeping", "lane_keeping"])
    steps.loc[[2, 3, 5], "true_curvature_1pm"] = -0.001  # a bend ahead
    steps.loc[6, "true_curvature_here_1pm"] = 0.001
    steps.loc[0, "true_curvature_1pm"] = np.nan  # the road ends before the preview point
    assert metrics.category(steps).tolist() == [
        "straight", "distraction", "distraction", "lane_change", "lane_change", "curve", "curve",
    ]  # fmt: skip


def test_lane_accuracy() -> None:
    steps = steps_table(8)
    steps["lateral_offset_m"] = [0.03, -0.04, 3.75, np.nan, 0.0, 0.0, 9.0, 0.0]
    steps["lane_locked"] = pd.array([True, True, True, False, False, False, True, False], "boolean")
    steps["recognised"] = pd.array([True, True, False, False, pd.NA, True, False, True], "boolean")
    steps["paper_recognised"] = pd.array([True, False, *[pd.NA] * 6], "boolean")
    steps.loc[6, "on_marked_road"] = False  # does not count at all
    found = metrics.lane_accuracy(steps)
    assert found["recognition_rate"] == pytest.approx(4 / 6)  # of seven on marked road one shows no marking
    assert found["paper_recognition_rate"] == pytest.approx(0.5)
    assert found["locked_rate"] == pytest.approx(3 / 7)
    assert found["other_lane_rate"] == pytest.approx(1 / 3)
    # near the middle of the own lane, an offset in another lane counts in full
    assert found["lateral_offset_rmse_m"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2 + 3.75**2) / 3))
    assert found["yaw_rate_rmse_rps"] == 0.0


def test_on_a_border_either_lane_may_be_meant() -> None:
    steps = steps_table(2)
    steps["true_lateral_offset_m"] = [1.8, -1.6]
    steps["lateral_offset_m"] = [1.8 - 3.75 + 0.03, -1.6 + 3.75 + 0.04]
    found = metrics.lane_accuracy(steps)
    assert found["other_lane_rate"] == 0.0
    assert found["lateral_offset_rmse_m"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2))


def test_lane_accuracy_of_nothing_is_not_a_number_and_no_warning() -> None:
    found = metrics.lane_accuracy(steps_table(3, lane_locked=False, recognised=pd.NA))
    assert math.isnan(found["recognition_rate"])
    assert math.isnan(found["lateral_offset_rmse_m"])
    assert found["locked_rate"] == 0.0
    blind = steps_table(3, yaw_rate_rps=np.nan)  # locked, but the observer has not settled
    assert math.isnan(metrics.lane_accuracy(blind)["yaw_rate_rmse_rps"])


def test_prediction_errors_by_horizon_and_category() -> None:
    steps = steps_table(101, true_cause=["lane_keeping"] * 100 + ["microsleep"])
    predictions = predictions_table(steps)
    size = np.repeat(np.arange(101) / 100.0, 4)
    predictions["lateral_error_m"] = np.where(np.arange(404) % 2, 1.0, -1.0) * size  # signs do not matter
    predictions["true_state_lateral_error_m"] = 0.5 * size
    table = metrics.prediction_errors(predictions, steps).set_index(["category", "horizon_s"])
    assert table.index.get_level_values(0).unique().tolist() == ["all", *metrics.CATEGORIES]
    row = table.loc[("all", 1.5)]
    assert (row["count"], row["predicted_median_m"]) == (101, pytest.approx(0.5))
    assert row["predicted_p95_m"] == pytest.approx(0.95)
    assert row["true_state_p95_m"] == pytest.approx(0.475)
    assert row["constant_radius_median_m"] == 0.0
    asleep = table.loc[("distraction", 2.0)]
    assert (asleep["count"], asleep["predicted_median_m"]) == (1, 1.0)
    assert table.loc[("curve", 0.5), "count"] == 0
    assert math.isnan(table.loc[("curve", 0.5), "predicted_median_m"])


def fleet(vehicles: int, n: int = 20) -> pd.DataFrame:
    return pd.concat([steps_table(n, vehicle_id=f"v{k}") for k in range(vehicles)], ignore_index=True)


def test_paired_gain_is_the_mean_difference_within_its_interval() -> None:
    steps = fleet(30)
    predictions = predictions_table(steps)
    noise = np.random.default_rng(1).normal(size=len(predictions))
    predictions["lateral_error_m"] = -0.1 - 0.01 * np.abs(noise)
    predictions["constant_velocity_lateral_error_m"] = 0.3 + 0.01 * np.abs(noise[::-1])
    table = metrics.paired_gain(predictions, steps, "constant_velocity")
    assert table["category"].tolist() == ["straight"] * 4
    for row in table.itertuples():
        part = predictions[predictions["horizon_s"] == row.horizon_s]
        by_hand = (part["constant_velocity_lateral_error_m"].abs() - part["lateral_error_m"].abs()).mean()
        assert row.gain_m == pytest.approx(by_hand)
        assert row.low_m < row.gain_m < row.high_m
        assert 0.19 < row.low_m < row.high_m < 0.21


def test_paired_gain_of_equal_errors_is_zero_and_of_alike_ones_covers_it() -> None:
    steps = fleet(25)
    predictions = predictions_table(steps, lateral_error_m=0.2, constant_radius_lateral_error_m=-0.2)
    equal = metrics.paired_gain(predictions, steps, "constant_radius")
    assert equal[["gain_m", "low_m", "high_m"]].to_numpy() == pytest.approx(np.zeros((4, 3)))
    draws = np.random.default_rng(7).normal(size=(2, len(predictions)))
    predictions["lateral_error_m"], predictions["constant_radius_lateral_error_m"] = 0.2 * draws
    alike = metrics.paired_gain(predictions, steps, "constant_radius")
    assert ((alike["low_m"] < 0.0) & (alike["high_m"] > 0.0)).all()


def test_paired_gain_takes_a_vehicles_steps_for_one() -> None:
    """Twenty equal steps per vehicle carry no more information than one: the interval must not shrink."""
    few, many = fleet(12, 1), fleet(12, 20)
    widths = []
    for steps in (few, many):
        predictions = predictions_table(steps)
        by_vehicle = predictions["vehicle_id"].str[1:].astype(float)
        predictions["constant_velocity_lateral_error_m"] = 0.1 * by_vehicle
        table = metrics.paired_gain(predictions, steps, "constant_velocity")
        widths.append((table["high_m"] - table["low_m"]).to_numpy())
    assert widths[1] == pytest.approx(widths[0], rel=0.02)


def test_paired_gain_of_one_vehicle_has_no_interval() -> None:
    steps = steps_table(10)
    table = metrics.paired_gain(predictions_table(steps), steps, "constant_velocity")
    assert table["gain_m"].eq(0.0).all()
    assert table[["low_m", "high_m"]].isna().all(axis=None)


def test_tlc_errors_count_what_was_not_foreseen_as_infinite() -> None:
    steps = steps_table(6)
    steps["true_tlc_s"] = [0.0, 0.2, 0.5, 1.0, 1.1, np.nan]  # the middle three count
    steps["tlc_s"] = [9.0, 0.3, 0.5, np.nan, 9.0, 9.0]
    steps["tlc_true_state_s"] = steps["true_tlc_s"]
    steps.loc[:, "on_marked_road"] = True
    found = metrics.tlc_errors(steps)
    assert found["tlc_steps"] == 3
    assert found["tlc_error_median_s"] == pytest.approx(0.1)
    assert math.isinf(found["tlc_error_p95_s"])
    assert found["tlc_unforeseen_rate"] == pytest.approx(1 / 3)
    assert found["tlc_true_state_error_p95_s"] == 0.0
    assert math.isinf(found["tlc_constant_radius_error_median_s"])


def approaches(errors: list[float], vehicles: int) -> pd.DataFrame:
    """Each vehicle's ten steps before its crossing have equal errors: true state 0.1 s, estimate as given."""
    tables = []
    for k in range(vehicles):
        truth = np.linspace(1.0, 0.1, 10)
        error = errors[k % len(errors)]
        columns = {"true_tlc_s": truth, "tlc_s": truth + error, "tlc_true_state_s": truth + 0.1}
        tables.append(steps_table(10, vehicle_id=f"v{k}", **columns))
    return pd.concat(tables, ignore_index=True)


def test_tlc_ratio_lies_within_its_interval_which_knows_that_steps_of_a_vehicle_are_alike() -> None:
    one = tlc_ratio(approaches([0.2], 30))
    assert [*one.values()] == pytest.approx([2.0, 2.0, 2.0])
    # 3 of 60 have five times the error: whether they are the 95th percentile depends on the draws
    few = tlc_ratio(approaches([0.1] * 19 + [0.5], 60))
    assert few["tlc_error_p95_ratio_low"] == pytest.approx(1.0)
    assert few["tlc_error_p95_ratio_high"] == pytest.approx(5.0)


def test_tlc_ratio_of_approaches_that_are_not_foreseen_is_open_above() -> None:
    ratio = tlc_ratio(approaches([0.1] * 19 + [np.inf], 60).replace(np.inf, np.nan))
    assert ratio["tlc_error_p95_ratio_low"] == pytest.approx(1.0)
    assert ratio["tlc_error_p95_ratio_high"] == math.inf


@pytest.mark.parametrize("vehicles", [0, 1])
def test_tlc_ratio_of_fewer_than_two_vehicles_has_no_interval(vehicles: int) -> None:
    ratio = tlc_ratio(approaches([0.2], 2).iloc[: 10 * vehicles])
    assert math.isnan(ratio["tlc_error_p95_ratio_low"])
    assert math.isnan(ratio["tlc_error_p95_ratio_high"])


def test_warning_counts_per_100_km() -> None:
    departures = departures_table(
        [
            ("lane_keeping", True, 0.8),
            ("distraction", True, 1.2),
            ("microsleep", False, -0.3),  # warned too late is missed
            ("lane_change_unsignalled", False, np.nan),
            ("lane_change_signalled", pd.NA, np.nan),  # intended: does not count
            ("distraction", pd.NA, np.nan),  # slow: counts, but no warning was due
        ]
    )
    found = metrics.warning_counts(
        departures=departures, warnings=warnings_table("true", "true", "nuisance", "false"), km=50.0
    )
    assert (found["departures"], found["departures_due"]) == (5, 4)
    assert (found["departures_warned"], found["departures_missed"]) == (2, 2)
    assert found["warned_rate"] == 0.5
    assert found["median_lead_time_s"] == pytest.approx(1.0)
    assert found["departures_per_100km"] == 10.0
    assert (found["warnings_true"], found["warnings_nuisance"], found["warnings_false"]) == (2, 1, 1)
    assert found["false_per_100km"] == 2.0
    assert found["false_per_100km_low"] == pytest.approx(2 * 0.025318, abs=1e-4)
    assert found["false_per_100km_high"] == pytest.approx(2 * 5.571643, abs=1e-4)


def test_no_road_driven_has_no_rate() -> None:
    found = metrics.warning_counts(warnings_table(), departures_table([]), 0.0)
    assert math.isnan(found["false_per_100km"])
    assert math.isnan(found["warned_rate"])


@pytest.mark.parametrize(
    ("count", "low", "high"),
    # Garwood (1936), table of 95 % limits
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (2, 0.2422, 7.2247), (5, 1.6235, 11.6683),
     (10, 4.7954, 18.3904), (30, 20.2409, 42.8269)],
)  # fmt: skip
def test_poisson_interval_is_garwoods(count: int, low: float, high: float) -> None:
    assert metrics.poisson_interval(count) == pytest.approx((low, high), abs=1e-4)


def test_poisson_interval_from_its_definition() -> None:
    from scipy.stats import poisson

    low, high = metrics.poisson_interval(7, 0.9)
    assert poisson.sf(6, low) == pytest.approx(0.05)
    assert poisson.cdf(7, high) == pytest.approx(0.05)


def test_summary_of_two_runs_keeps_vehicles_of_the_same_name_apart() -> None:
    steps = pd.concat([steps_table(50), steps_table(50, run_id="s")], ignore_index=True)
    found = metrics.summary(steps, predictions_table(steps), warnings_table(), departures_table([]))
    assert (found["vehicles"], found["vehicle_steps"]) == (2, 100)
    assert found["distance_km"] == pytest.approx(0.2)
    assert found["predicted_error_2.0s_p95_m"] == 0.0


def test_figures_are_printed_beside_their_targets() -> None:
    rows = [
        {"condition": condition, "figure": line.figure, "measured": 0.5}
        for condition in ("clear", "complex")
        for line in evaluation_text.LINES
    ]
    results = pd.DataFrame(rows).assign(wanted=np.nan, at_least=False, reached=False)
    # a figure without anything to judge is neither reached nor missed
    for figure, measured, reached in (
        ("lateral_offset_rmse_m", 0.01, True),
        ("ttc_error_p95_s", 2.0, False),
        ("conflicts_due_warned_rate", np.nan, False),
    ):
        which = (results["figure"] == figure) & (results["condition"] == "clear")
        results.loc[which, ["measured", "wanted", "reached"]] = [measured, 0.03, reached]
    cells = {
        line.figure: tuple(column._cells[k] for column in evaluation_text.figures(results).columns[1:])
        for k, line in enumerate(evaluation_text.LINES)
    }
    assert cells["lateral_offset_rmse_m"] == ("1.0", "≤ 3", "50.0", "")
    assert cells["ttc_error_p95_s"] == ("2.00", "[bold]≤ 0.03 NOT[/bold]", "0.50", "")
    assert cells["conflicts_due_warned_rate"] == ("–", "≤ 3", "50.0", "")
    assert evaluation_text.verdict(results) == "1 of 2 targets reached; not: ttc_error_p95_s (clear)"
