"""Lane changes of other vehicles: continuous, to the right side, in time, and not for equipped ones."""

from pathlib import Path

import numpy as np
import pytest

from sumo_net.lane_changes import CHANGE_S, LaneChanges
from sumo_net.lane_graph import Lane, LaneGraph
from sumo_net.snapshot import Snapshot

WIDTH = 3.75


def graph() -> LaneGraph:
    lanes = {
        name: Lane(name, edge, index, 500.0, WIDTH, 30.0, True, False, False, np.zeros((2, 2)))
        for name, edge, index in (("a_0", "a", 0), ("a_1", "a", 1), ("b_0", "b", 0))
    }
    return LaneGraph(Path("n.net.xml"), lanes=lanes)


def snapshot(lane: int, y: float, x: float = 0.0) -> Snapshot:
    ones = np.ones(1)
    return Snapshot(
        np.array([4]), x * ones, y * ones, 0.0 * ones, 25.0 * ones, np.array([lane], np.int32),
        x * ones, 4.5 * ones, 1.8 * ones, 1.5 * ones,
    )  # fmt: skip


def drive(lanes: list[int], equipped: bool = False) -> list[Snapshot]:
    changes = LaneChanges(graph(), ["a_0", "a_1", "b_0"])
    mask = np.array([equipped])
    return [changes.step(snapshot(lane, WIDTH * (lane % 2)), mask) for lane in lanes]


@pytest.mark.parametrize(("old", "new"), [(0, 1), (1, 0)])
def test_a_change_is_continuous_and_over_in_time(old: int, new: int) -> None:
    steps = round(10 * CHANGE_S)
    seen = drive([old] * 3 + [new] * (steps + 5))
    y = np.array([float(s.y_m[0]) for s in seen])
    assert np.abs(np.diff(y)).max() < 0.25
    assert y[:4] == pytest.approx(WIDTH * old, abs=1e-9)
    assert y[3 + steps :] == pytest.approx(WIDTH * new, abs=1e-9)
    heading = np.array([float(s.heading_rad[0]) for s in seen])
    assert (np.sign(new - old) * heading >= -1e-12).all()
    moved = np.diff(y) / (0.1 * 25.0)
    assert np.tan(heading[3:-1]) == pytest.approx(moved[3:], abs=0.02)


def test_who_turns_back_halfway_does_not_jump() -> None:
    y = np.array([float(s.y_m[0]) for s in drive([0] * 3 + [1] * 12 + [0] * 40)])
    assert np.abs(np.diff(y)).max() < 0.3
    assert y[-1] == pytest.approx(0.0, abs=1e-9)


def test_equipped_vehicles_and_new_edges_are_left_alone() -> None:
    assert [float(s.y_m[0]) for s in drive([0, 1, 1], equipped=True)] == [0.0, WIDTH, WIDTH]
    assert [float(s.y_m[0]) for s in drive([1, 2, 2])] == [WIDTH, 0.0, 0.0]
    assert [float(s.y_m[0]) for s in drive([0, -1, 0])] == [0.0, -WIDTH * -1.0, 0.0]
