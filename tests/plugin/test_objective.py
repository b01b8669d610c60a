"""The published objective against a plain transcription, block by block."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as examples
from hypothesis import strategies as st

from camera_synth.camera import Camera
from plugin.lane.objective import Objective, blocks_below_horizon, objective

ROAD = (120, 200, 60)


def block_by_block(frame, border, side, minimum=20):
    """Eqs. 2, 3 as one reads them; tables 1, 2."""
    a, b, c = border
    upright = frame[::-1].astype(float)  # row y counts from the bottom
    road = np.mean(upright[0:60:3, 120:200])
    slope = b if side == "left" else -b
    alpha, beta, beta_3, beta_4 = (
        (0.2, 0.5, 0.3, 0.0) if slope > 2 else (0.2, 0.5, 0.0, 0.3) if slope < 0.5 else (0.4, 0.6, 0.0, 0.0)
    )
    values = []
    for y in range(1, 149, 3):
        x = int(np.floor(a * y**2 + b * y + c + 0.5))
        if not 2 <= x + 1 <= 319:
            continue
        block = upright[y - 1 : y + 2, x - 1 : x + 2][::-1]  # upper row first
        if side == "right":
            block = block[:, ::-1]
        t_diagonal = (block[0, 0] + block[0, 1] + block[1, 0] - block[2, 2] - block[2, 1] - block[1, 2]) / 3
        t_3 = block[0].mean() - block[2].mean()
        t_4 = block[:, 0].mean() - block[:, 2].mean()
        values.append(alpha * (block.mean() - road) + beta * t_diagonal + beta_3 * t_3 + beta_4 * t_4)
    if not values:
        return -1000.0
    return min(np.sum(values) / len(values), np.sum(values) / max(len(values), minimum))


def between_columns(a, b, c):
    """Least distance in px of a block's centre from the middle between two columns."""
    y = 1.0 + 3.0 * np.arange(50)
    return np.abs(np.mod(a * y**2 + b * y + c, 1.0) - 0.5).min()


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.floats(-0.005, 0.005), st.floats(-3.0, 3.0), st.floats(-200, 500)),
    st.tuples(st.floats(-0.005, 0.005), st.floats(-3.0, 3.0), st.floats(-200, 500)),
)
@examples(max_examples=60)
def test_equals_the_transcription(seed, left, right):
    assume(between_columns(*left) > 1e-6 and between_columns(*right) > 1e-6)  # else rounding decides
    frame = np.random.default_rng(seed).integers(0, 256, (1, 240, 320)).astype(np.uint8)
    score = objective(frame, np.array([left]), np.array([right]))
    assert score[0, 0] == pytest.approx(block_by_block(frame[0], left, "left"), abs=2e-4)
    assert score[0, 1] == pytest.approx(block_by_block(frame[0], right, "right"), abs=2e-4)


@given(st.integers(0, 2**32 - 1), st.floats(-0.004, 0.004), st.floats(0.1, 2.5), st.floats(-60, 120))
@examples(max_examples=30)
def test_mirroring_the_frame_swaps_the_borders(seed, a, b, c):
    assume(between_columns(a, b, c) > 1e-6)  # a centre exactly between two columns rounds up in both images
    frame = np.random.default_rng(seed).integers(0, 256, (1, 240, 320)).astype(np.uint8)
    border, mirrored = np.array([[a, b, c]]), np.array([[-a, -b, 319.0 - c]])
    score = objective(frame, border, mirrored)
    again = objective(frame[:, :, ::-1].copy(), border, mirrored)
    assert score[0] == pytest.approx(again[0, ::-1], abs=1e-3)


def test_an_ideal_edge_scores_as_by_hand():
    """A white field left of x = y: half-bright blocks on the diagonal; T₁ is the full contrast of 100."""
    y, x = np.meshgrid(239 - np.arange(240), np.arange(320), indexing="ij")
    frame = np.where(x < y + 100, 150, np.where(x > y + 100, 50, 100)).astype(np.uint8)
    road = frame[::-1][0:60:3, 120:200].mean()
    score = objective(frame[None], np.array([[0.0, 1.0, 100.0]]), np.array([[0.0, -1.0, 300.0]]))
    assert score[0, 0] == pytest.approx(0.4 * (100.0 - road) + 0.6 * 100.0, abs=1e-3)


def test_few_blocks_cannot_win():
    """A candidate that touches one bright spot at the image's edge loses to a whole faint border."""
    frame = np.full((1, 240, 320), 80, np.uint8)
    frame[0, 237:240, 310:320] = 255
    touching = np.array([[0.0, 2.2, 315.0]])  # leaves the image after two blocks
    alone = objective(frame, touching, touching, Objective(minimum_blocks=1))[0, 0]
    guarded = objective(frame, touching, touching)[0, 0]
    assert alone > 30.0
    assert guarded < alone / 9


def test_blocks_end_at_the_horizon():
    assert blocks_below_horizon(Camera()) == 50
    assert blocks_below_horizon(Camera(pitch_rad=-0.03)) == 30  # horizon at y = 92, last block up to 89
    with pytest.raises(ValueError, match="leaves 5 blocks: at least 10 are needed"):
        blocks_below_horizon(Camera(pitch_rad=-0.11))
    frame = np.full((1, 240, 320), 80, np.uint8)
    frame[0, : 240 - 90] = 255  # only above the 30th block
    border = np.array([[0.0, 1.0, 20.0]])
    assert objective(frame, border, border, Objective(blocks=30))[0, 0] == pytest.approx(0.0)


def test_wrong_frames_are_refused():
    with pytest.raises(ValueError, match=r"must be uint8 \(n, 240, 320\)"):
        objective(np.zeros((1, 320, 240), np.uint8), np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(ValueError, match=r"left has shape \(3,\)"):
        objective(np.zeros((1, 240, 320), np.uint8), np.zeros(3), np.zeros((1, 3)))
    with pytest.raises(ValueError, match="road_right_px = 100: must be above road_left_px = 120"):
        Objective(road_right_px=100)
