"""Turns that no car can make: SUMO turns on the spot and corners at any speed; the ego follows."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.road_networks import netgenerate
from sumo_net.driver import Driver, numbers
from sumo_net.ego_kernels import guidance
from sumo_net.ego_road_kernels import outer_share
from sumo_net.vehicle import Vehicle
from tests.true_drives import all_equipped

CAR = Vehicle()
C = numbers(Driver(), CAR)
TRIPS = (("A0B0", "B0A0"), ("A1B1", "B1A1"), ("A0A1", "A1B1"), ("B0B1", "B1C1"), ("A1B1", "B1B0"))


@pytest.fixture(scope="module", params=[1, 2], ids=["one_lane", "two_lanes"])
def turns(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Truth of motorcycles that turn back, and round corners at 7 m/s, beside SUMO's speed (`sumo_mps`)."""
    net_file: Path = tmp_path_factory.mktemp("grid") / "grid.net.xml"
    netgenerate("--grid", "--grid.number", "3", "--grid.length", "110", "-L", str(request.param))(net_file)
    trips = "".join(
        f'<trip id="{k}" type="m" depart="{5 * k}" from="{a}" to="{b}" departPos="30" departLane="best" '
        'departSpeed="max"/>'
        for k, (a, b) in enumerate(TRIPS)
    )
    return all_equipped(net_file, f'<vType id="m" vClass="motorcycle"/>{trips}', 450)


def test_there_are_turns_that_no_car_can_make(turns: pd.DataFrame) -> None:
    assert turns["handle"].nunique() == len(TRIPS)
    assert (turns["curvature_1pm"].abs() > 0.6 / CAR.wheelbase_m).sum() > 5  # tighter than full lock
    assert (turns["curvature_1pm"].abs() * turns["sumo_mps"] ** 2 > 9.0).sum() > 5  # faster than tyres bear


def test_the_vehicle_stays_on_its_path(turns: pd.DataFrame) -> None:
    assert turns["path_offset_m"].abs().max() < 1.5
    assert turns["path_heading_rad"].abs().max() < 0.9


def test_it_is_no_faster_than_sumo_s_vehicle(turns: pd.DataFrame) -> None:
    faster = turns["speed_mps"] - turns["sumo_mps"]
    assert faster.max() < 0.5
    assert faster.min() > -3.0  # on the inner side of a turn the way is shorter


def test_nothing_jumps(turns: pd.DataFrame) -> None:
    for _, one in turns.groupby("handle"):
        way = np.hypot(one["x_m"].diff(), one["y_m"].diff()).to_numpy()[1:]
        speed = np.hypot(one["speed_mps"], one["lateral_speed_mps"]).to_numpy()
        assert np.abs(way - 0.05 * (speed[1:] + speed[:-1])).max() < 0.3


@pytest.mark.parametrize(
    ("bend_1pm", "speed_mps", "heading_rad", "odd_yaw_rate_rps"),
    [(1 / 250, 36.0, 0.1, 0.1), (1 / 12, 7.0, 0.2, -0.2), (1 / 6, 4.0, -0.3, 0.3), (0.0, 3.0, 0.45, 0.3)],
)
def test_what_cars_can_do_is_not_guided(
    bend_1pm: float, speed_mps: float, heading_rad: float, odd_yaw_rate_rps: float
) -> None:
    assert guidance(bend_1pm, speed_mps, heading_rad, odd_yaw_rate_rps, C) == 0.0


@pytest.mark.parametrize(
    ("bend_1pm", "speed_mps", "heading_rad", "odd_yaw_rate_rps", "share"),
    [
        (1 / 5, 7.5, 0.0, 0.0, 0.4),  # 11 m/s²
        (1 / 3.2, 2.0, 0.0, 0.0, 0.4),  # full lock makes R = 3.27 m
        (0.0, 8.0, 0.0, -0.9, 0.4),  # what a turn has left
        (0.0, 5.0, -0.8, 0.0, 0.4),
        (0.7, 2.0, 0.0, 0.0, 1.0),  # more than twice the lock: put on the path
    ],
)
def test_what_they_cannot_is(
    bend_1pm: float, speed_mps: float, heading_rad: float, odd_yaw_rate_rps: float, share: float
) -> None:
    assert guidance(bend_1pm, speed_mps, heading_rad, odd_yaw_rate_rps, C) == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize(
    ("curvature_1pm", "offset_m", "behind_m", "share"),
    [
        (0.2, 1.0, 0.0, 1.0),  # the inner side
        (1 / 400, -3.75, 0.0, 1.0),
        (0.2, -5.0, 0.0, 0.6),  # R 10 m where SUMO has 5 m: 1.2 times its speed over ground
        (-0.2, 5.0, 3.5, 0.8),  # half as slow, having fallen behind
        (0.2, -5.0, 4.0, 1.0),
    ],
)
def test_on_the_outer_side_of_a_turn_the_way_is_longer(
    curvature_1pm: float, offset_m: float, behind_m: float, share: float
) -> None:
    assert outer_share(curvature_1pm, offset_m, behind_m) == pytest.approx(share)
