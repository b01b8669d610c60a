"""Settings compared in pairs of runs with the same seed."""

import numpy as np
import pandas as pd
import pytest

from analysis.campaign.differences import differences
from analysis.statistics import ratio_difference_intervals


def runs(*rows: tuple[int, int, int, float]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["cell", "seed", "departures", "km"])


CELLS = [
    {"scenario": "town", "condition": condition, "equipment.fraction": fraction}
    for condition in ("clear", "rain")
    for fraction in (0.1, 0.2)
]


def test_each_value_is_compared_with_the_first_where_all_else_is_equal() -> None:
    table = differences(
        CELLS,
        runs((0, 1, 2, 1.0), (0, 2, 4, 1.0), (2, 1, 5, 1.0), (2, 2, 7, 1.0), (2, 3, 99, 1.0), (1, 1, 1, 2.0)),
        {"departures": "km"},
    )
    rain = table[(table["key"] == "condition") & (table["equipment.fraction"] == "0.1")].iloc[0]
    assert (rain["from"], rain["to"], rain["pairs"]) == ("clear", "rain", 2)  # seed 3 has no partner
    assert (rain["count_from"], rain["count_to"]) == (6, 12)
    assert (rain["value_from"], rain["value_to"], rain["difference"]) == (3.0, 6.0, 3.0)
    assert (rain["difference_low"], rain["difference_high"]) == (3.0, 3.0)  # three more in each pair
    assert table.groupby("key").size().to_dict() == {"condition": 2, "equipment.fraction": 2}
    one = table[(table["key"] == "equipment.fraction") & (table["condition"] == "clear")].iloc[0]
    assert one["difference"] == pytest.approx(0.5 - 2.0)
    assert np.isnan(one["difference_low"])  # a single pair


def test_a_campaign_of_one_cell_compares_nothing() -> None:
    assert differences(CELLS[:1], runs((0, 1, 2, 1.0)), {"departures": "km"}).empty


def test_the_interval_covers_the_true_difference() -> None:
    random = np.random.default_rng(3)
    covered = 0
    for _ in range(100):
        common = random.normal(5.0, 3.0, (40, 1))  # what the seed brings, the same in both arms
        first, second = common + random.normal(0, 0.5, (40, 1)), common + random.normal(1.0, 0.5, (40, 1))
        _, low, high = ratio_difference_intervals((first, second), (np.ones((40, 1)),) * 2, 400)
        covered += bool(low[0] <= 1.0 <= high[0])
        assert high[0] - low[0] < 1.0  # unpaired it would be 2.6 wide
    assert covered >= 88


def test_nothing_driven_has_no_ratio() -> None:
    zeros = np.zeros((3, 1))
    ratios, low, high = ratio_difference_intervals((zeros, zeros), (zeros, zeros))
    assert np.isnan([*ratios.ravel(), *low, *high]).all()
