"""Gate and global nearest neighbour against scipy's dense assignment, vehicle by vehicle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from plugin.tracking import association
from plugin.tracking.association import assign
from plugin.tracking.association_kernels import gate_pairs

GATE = 16.0
NO_ANGLE = np.zeros(3, np.bool_)


def fleet(rng: np.random.Generator, vehicles: int, crowd: float) -> tuple:
    """Random tracks and detections of some vehicles, crowded into a box of `crowd` metres."""
    track_owner = np.sort(rng.integers(0, vehicles, rng.integers(0, 8 * vehicles)))
    owner = np.sort(rng.integers(0, vehicles, rng.integers(0, 8 * vehicles)))
    z_pred, z = rng.uniform(0, crowd, (len(track_owner), 3)), rng.uniform(0, crowd, (len(owner), 3))
    root = rng.standard_normal((len(track_owner), 3, 3))
    S = root @ root.transpose(0, 2, 1) + 0.5 * np.eye(3)
    return track_owner, owner, z_pred, S, z


def pairs(track_owner, owner, z_pred, S, z, label=None, track_label=None, angle=NO_ANGLE):  # type: ignore[no-untyped-def]
    none = np.full(len(z_pred), -1) if track_label is None else track_label
    label = np.full(len(z), -1) if label is None else label
    return gate_pairs(z_pred, S, none, track_owner, z, label, owner, angle, GATE, 100.0)[:3]


@given(seed=st.integers(0, 2**32 - 1), crowd=st.sampled_from([3.0, 10.0, 40.0]))
@settings(max_examples=40)
def test_equals_dense_assignment_of_each_vehicle(seed: int, crowd: float) -> None:
    rng, vehicles = np.random.default_rng(seed), 4
    track_owner, owner, z_pred, S, z = fleet(rng, vehicles, crowd)
    cost = GATE * rng.choice([1.0, 2.0], len(track_owner))
    track, detection, distance = pairs(track_owner, owner, z_pred, S, z)
    chosen = assign(track, detection, distance, len(z), cost)
    taken = chosen[chosen >= 0]
    assert len(set(taken)) == len(taken)
    dense = np.full((len(z_pred), len(z)), np.inf)
    for t in range(len(z_pred)):
        for d in np.flatnonzero(owner == track_owner[t]):
            y = z[d] - z_pred[t]
            squared = y @ np.linalg.solve(S[t], y)
            if squared <= GATE:
                dense[t, d] = squared
    np.testing.assert_allclose(dense[track, detection], distance, rtol=1e-9)
    assert np.isfinite(dense).sum() == len(track)
    best = 0.0
    for v in range(vehicles):
        mine = np.flatnonzero(track_owner == v)
        own = np.where(np.eye(len(mine), dtype=bool), cost[mine][:, None], 1e9)
        block = np.concatenate([np.where(np.isfinite(dense[mine]), dense[mine], 1e9), own], axis=1)
        r, c = linear_sum_assignment(block)
        best += block[r, c].sum()
    ours = np.where(chosen >= 0, dense[np.arange(len(z_pred)), chosen] if len(z) else 0.0, cost).sum()
    assert ours == pytest.approx(best, rel=1e-9, abs=1e-9)


def test_a_global_choice_beats_the_greedy_one() -> None:
    """Track 0 is nearer to detection 0, but only track 1 can take nothing else."""
    track, detection = np.array([0, 0, 1]), np.array([0, 1, 0])
    chosen = assign(track, detection, np.array([1.0, 4.0, 2.0]), 2, np.full(2, GATE))
    assert chosen.tolist() == [1, 0]


def test_where_two_compete_the_costlier_track_goes_first() -> None:
    track, detection = np.array([0, 1]), np.array([0, 0])
    assert assign(track, detection, np.array([1.0, 9.0]), 1, np.array([GATE, 2 * GATE])).tolist() == [
        -1,
        0,
    ]
    assert assign(track, detection, np.array([1.0, 9.0]), 1, np.array([GATE, GATE])).tolist() == [0, -1]


def test_exact_hits_are_assigned() -> None:
    """A distance of 0 in a conflict is an edge like any other."""
    track, detection = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    assert assign(track, detection, np.array([0.0, 5.0, 5.0, 0.0]), 2, np.full(2, GATE)).tolist() == [0, 1]


def test_equals_scipys_sparse_matching_of_a_whole_crowd() -> None:
    """Pairs of forty vehicles in one problem, long chains of competitors among them."""
    rng, vehicles = np.random.default_rng(7), 40
    track_owner, owner, z_pred, S, z = fleet(rng, vehicles, 6.0)
    track, detection, distance = pairs(track_owner, owner, z_pred, S, z)
    cost = GATE * rng.choice([1.0, 2.0], len(z_pred))
    chosen = assign(track, detection, distance, len(z), cost)
    own = np.arange(len(z_pred))
    weights = csr_array(  # 1 keeps every weight off zero, which a sparse matrix would not hold
        (
            1.0 + np.concatenate([distance, cost]),
            (np.concatenate([track, own]), np.concatenate([detection, len(z) + own])),
        )
    )
    _, best = min_weight_full_bipartite_matching(weights)
    assert np.unique(track, return_counts=True)[1].max() > 3
    np.testing.assert_array_equal(chosen, np.where(best < len(z), best, -1))


@pytest.mark.parametrize("call", [1, 3, 1000])
def test_the_cuts_of_the_problem_change_nothing(monkeypatch: pytest.MonkeyPatch, call: int) -> None:
    rng, vehicles = np.random.default_rng(7), 40
    found = pairs(*fleet(rng, vehicles, 6.0))
    detections, cost = found[1].max() + 1, np.full(found[0].max() + 1, GATE)
    whole = association.assign(*found, detections, cost)
    assert len(np.unique(found[0])) > 50
    monkeypatch.setattr(association, "_TRACKS_A_CALL", call)
    np.testing.assert_array_equal(association.assign(*found, detections, cost), whole)


def test_nothing_to_assign() -> None:
    nothing = np.zeros(0, np.int64)
    assert assign(nothing, nothing, np.zeros(0), 0, np.full(3, GATE)).tolist() == [-1] * 3
    assert assign(nothing, nothing, np.zeros(0), 2, np.zeros(0)).tolist() == []


def test_angles_wrap_in_the_gate() -> None:
    z_pred, z = np.array([[10.0, 0.0, 3.13]]), np.array([[10.0, 0.0, -3.13]])
    S, zero = np.eye(3)[None] * 0.01, np.zeros(1, np.int64)
    assert len(pairs(zero, zero, z_pred, S, z)[0]) == 0
    assert len(pairs(zero, zero, z_pred, S, z, angle=np.array([False, False, True]))[0]) == 1


def test_labels_pair_with_their_own_only_and_in_the_wider_gate() -> None:
    z_pred, z = np.zeros((2, 3)), np.full((2, 3), [5.0, 0.0, 0.0])
    S, zero = np.tile(np.eye(3), (2, 1, 1)), np.zeros(2, np.int64)
    track, detection, _ = pairs(
        zero, zero, z_pred, S, z, label=np.array([7, 8]), track_label=np.array([8, 9])
    )
    assert track.tolist() == [0]
    assert detection.tolist() == [1]


def test_a_covariance_that_is_not_definite_pairs_with_nothing() -> None:
    zero = np.zeros(1, np.int64)
    assert len(pairs(zero, zero, np.zeros((1, 3)), -np.eye(3)[None], np.zeros((1, 3)))[0]) == 0
