"""The published search: its printed examples, its properties, and roads drawn with known borders."""

import numpy as np
import pytest
from drawn_road import draw
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from camera_synth.camera import Camera
from plugin.lane.genetic import (
    GeneticSearch,
    Region,
    Restart,
    bits_needed,
    fitted_to,
    init,
    search,
    search_numbers,
)
from plugin.lane.genetic_kernels import (
    cross,
    crossover_points,
    decode,
    mutate,
    plausible,
    roulette_weights,
    search_border,
    spin,
    stage_of,
    swapped_bits,
)
from plugin.lane.geometry import lane_estimate_from_borders
from plugin.lane.objective import objective
from sumo_net.batch import join, select
from sumo_net.randomness import bits, stream_key
from sumo_net.settings import SettingsError, read

PAPER = search_numbers(GeneticSearch())


def random_bits(seed, counter):
    """The kernel's word; numba hands large ones to Python as int."""
    return np.uint64(bits(np.uint64(seed), np.uint64(counter)))


def keys(n, seed=0):
    return np.array([stream_key(seed, f"v{i}", "lane") for i in range(n)], np.uint64)


def run(frames, count, state=None, numbers=PAPER):
    """`count` frames alike; the last state and borders."""
    state = init(keys(len(frames))) if state is None else state
    for _ in range(count):
        state, borders = search(frames, state, numbers)
    return state, borders


# --- the printed examples


def test_bits_of_table_3():
    """Eq. 4: 7 + 8 + 8, 6 + 7 + 7, 5 + 5 + 5."""
    assert PAPER.bits.tolist() == [[[7, 8, 8], [6, 7, 7], [5, 5, 5]]] * 2


def test_bits_at_a_power_of_two():
    assert bits_needed(0.0128, 4) == 7
    assert bits_needed(0.0129, 4) == 8


def test_the_printed_chromosome_decodes():
    border = np.empty(3)
    chromosome = np.uint64(int("01010100011100001011101", 2))
    decode(chromosome, PAPER.first[0, :, 0], PAPER.first[0, :, 1], PAPER.bits[0, 0], border)
    assert np.round(border, 4)[0] == -0.0017
    assert np.round(border, 2)[1] == 0.74
    assert np.round(border)[2] == -9


@given(st.integers(0, 2**23 - 1))
@examples(max_examples=50)
def test_decoding_stays_in_the_region_and_reaches_its_bounds(number):
    border = np.empty(3)
    low, high = PAPER.first[1, :, 0], PAPER.first[1, :, 1]
    decode(np.uint64(number), low, high, PAPER.bits[1, 0], border)
    assert (border >= low - 1e-12).all()
    assert (border <= high + 1e-12).all()
    decode(np.uint64(0), low, high, PAPER.bits[1, 0], border)
    assert border == pytest.approx(low)
    decode(np.uint64(2**23 - 1), low, high, PAPER.bits[1, 0], border)
    assert border == pytest.approx(high)


def test_the_printed_crossover():
    """Points 4, 13, 18; the print lost a bit of the second parent."""
    first, second = int("10101001010001011010", 2), int("10110001001101111100", 2)
    mask = swapped_bits(20, 4, 13, 18)
    assert f"{mask:020b}" == "00001111111110000011"
    children = cross(np.uint64(first), np.uint64(second), mask)
    assert [f"{child:020b}" for child in children] == ["10100001001101011000", "10111001010001111110"]


def test_the_printed_mutation():
    """Bit 9, counted from 0."""
    assert f"{mutate(np.uint64(int('011001000100110', 2)), 15, 9):015b}" == "011001000000110"


# --- the operators


@given(st.integers(0, 2**62), st.integers(4, 62))
@examples(max_examples=60)
def test_crossover_points_are_three_in_order(number, length):
    p1, p2, p3 = crossover_points(random_bits(number, 0), length)
    assert 1 <= p1 < p2 < p3 < length


def test_every_triple_of_points_is_alike_likely():
    count = {}
    for i in range(20_000):
        points = crossover_points(random_bits(5, i), 6)
        count[points] = count.get(points, 0) + 1
    assert len(count) == 10  # 5 choose 3
    assert min(count.values()) > 1800
    assert max(count.values()) < 2200


def test_crossing_back_gives_the_parents():
    for i in range(50):
        first, second = (random_bits(9, 2 * i + j) >> np.uint64(41) for j in range(2))
        mask = swapped_bits(23, *crossover_points(random_bits(8, i), 23))
        assert cross(*cross(first, second, mask), mask) == (first, second)


@given(st.lists(st.floats(-50.0, 100.0), min_size=4, max_size=50))
@examples(max_examples=60)
def test_roulette_weights_are_the_shifted_fitness(values):
    fitness = np.array(values)
    weights = np.empty(len(values))
    roulette_weights(fitness, weights)
    expected = fitness - min(0.0, fitness.min())
    if expected.max() <= 0.0:
        expected = np.ones_like(expected)
    assert weights / weights.max() == pytest.approx(expected / expected.max())


def test_roulette_gives_the_published_probabilities():
    """Eq. 7: each individual's share of the sum; one without blocks is never chosen."""
    fitness = np.array([10.0, 30.0, -1000.0, 60.0])
    weights, counter, count = np.empty(4), np.uint64(0), np.zeros(4)
    roulette_weights(fitness, weights)
    for _ in range(40_000):
        index, counter = spin(weights, np.uint64(3), np.uint64(counter))
        count[index] += 1
    assert count[2] == 0
    assert count / 40_000 == pytest.approx([0.1, 0.3, 0.0, 0.6], abs=0.01)  # four standard deviations


# --- the search


def test_stages_are_those_of_table_4():
    """The first frame; frames 2 to 6; all later ones."""
    assert [stage_of(age, PAPER.transition_frames) for age in range(8)] == [0, 1, 1, 1, 1, 1, 2, 2]


@given(st.integers(0, 2**32), st.integers(0, 2), st.booleans())
@examples(max_examples=15)
def test_the_best_individual_never_worsens(seed, stage, drawn):
    rng = np.random.default_rng(seed)
    frame = draw(seed=seed) if drawn else rng.integers(0, 256, (240, 320)).astype(np.uint8)
    maps, best, history = np.zeros((3, 50, 320), np.int32), np.empty(3), np.empty(26)
    last = np.array([0.0, 1.4, -50.0])
    score = search_border(
        frame, 0, stage, last, 90.0, np.uint64(seed), np.uint64(0), PAPER, maps, best, history
    )
    assert (np.diff(history) >= 0.0).all()
    assert score >= history[-1]


def test_selection_makes_the_search_quicker():
    """Best individual after five generations, mean of 200 searches: 33, and 29 with selection left out."""
    numbers = search_numbers(GeneticSearch(generations=(5, 5, 5)))
    frame, best, nothing = draw(seed=1), np.empty(3), np.empty(0)
    maps, last = np.zeros((3, 50, 320), np.int32), np.zeros(3)
    scores = [
        search_border(frame, 0, 0, last, 90.0, np.uint64(key), np.uint64(0), numbers, maps, best, nothing)
        for key in keys(200)
    ]
    assert np.mean(scores) > 31.0


@given(st.integers(0, 2**32))
@examples(max_examples=10)
def test_the_score_is_the_objective_of_the_borders(seed):
    """The maps the search looks up hold what the objective says, in all three stages."""
    frames = np.random.default_rng(seed).integers(0, 256, (3, 240, 320)).astype(np.uint8)
    state = init(keys(3, seed))
    for _ in range(8):
        state, borders = search(frames, state, PAPER)
        assert borders.score == pytest.approx(objective(frames, borders.left, borders.right), abs=1e-9)


def test_each_vehicle_searches_alone():
    """Order, fleet and slicing change nothing; the same key gives the same bytes."""
    frames = np.stack([draw(curvature=k, seed=i) for i, k in enumerate((0.0, 1e-3, -1e-3, 5e-4))])
    whole = init(keys(4))
    parts = [select(whole, slice(0, 1)), select(whole, slice(1, 4))]
    for _ in range(8):
        whole, _ = search(frames, whole, PAPER)
        parts[0], _ = search(frames[:1], parts[0], PAPER)
        parts[1], _ = search(frames[1:], parts[1], PAPER)
    for part, other in zip(whole, join(*parts), strict=True):
        np.testing.assert_array_equal(part, other)


def row_errors(border, offset, curvature=0.0, slope=0.0):
    """Horizontal distance times cos θ to the true curve, per processed row from 8 to 60 m in the image."""
    y = np.arange(0.0, 135.0)
    u = 157.06 - y
    x = 160 - offset * u / 1.34 - slope * 925 - curvature * 1.34 * 925**2 / (2 * u)
    cos = 1 / np.hypot(1, offset / 1.34)
    inside = (x > 4) & (x < 315)
    return np.abs((border[0] * y + border[1]) * y + border[2] - x)[inside] * cos


@pytest.mark.parametrize("dash_m", [None, 6.0])
@pytest.mark.parametrize("curvature", [0.0, 1 / 2000, -1 / 2000])
def test_drawn_borders_are_found(dash_m, curvature):
    """At most 5 px off on 85 % of the rows after 25 frames, in 9 of 10 searches; dashes move as at 30 m/s."""
    n = 10
    state = init(keys(n))
    for i in range(25):
        frame = draw(curvature=curvature, dash_m=dash_m, phase_m=3.0 * i, seed=i)
        state, borders = search(np.repeat(frame[None], n, 0), state, PAPER)
    found = [
        np.mean(row_errors(left, 1.8, curvature) <= 5.0) >= 0.85  # offsets of the inner edges
        and np.mean(row_errors(right, -1.8, curvature) <= 5.0) >= 0.85
        for left, right in zip(borders.left, borders.right, strict=True)
    ]
    assert np.mean(found) >= 0.9


def test_a_lost_border_is_searched_anew():
    """After bad frames the search is back in the first stage; with the road again it finds the road."""
    road, dark = draw()[None], np.random.default_rng(0).integers(80, 90, (1, 240, 320)).astype(np.uint8)
    state, _ = run(road, 10)
    assert (state.age == 10).all()
    state, borders = run(dark, Restart().patience, state)
    assert (state.age == 0).all()
    assert (borders.score < Restart().least_score).all()
    state, borders = run(road, 10, state)
    assert (borders.score > 30).all()
    assert np.median(row_errors(borders.left[0], 1.8)) < 5.0


def borders_of(width_px, rise=0.0, bend=0.0):
    """Both borders, `width_px` apart at the bottom; the right one moves away by rise·y + bend·y²."""
    return np.array([[0.0, 0.3, 40.0], [bend, 0.3 + rise, 40.0 + width_px]])


@pytest.mark.parametrize(
    ("border", "accepted"),
    [
        (borders_of(199.9), False),
        (borders_of(200.0), True),
        (borders_of(650.0), True),
        (borders_of(650.1), False),
        (borders_of(-300.0, 5.0), False),  # left of the left one
        # the topmost block is centred on y = 148
        (borders_of(300.0, -300.0 / 147.0), False),
        (borders_of(300.0, -300.0 / 149.0), True),
        (borders_of(300.0, 0.0, -300.0 / 147.0**2), False),
        (borders_of(300.0, 0.0, -300.0 / 149.0**2), True),
    ],
)
def test_borders_that_can_be_a_lane_s(border, accepted):
    assert plausible(border, PAPER) == accepted


def test_a_road_without_markings_does_not_lock():
    state, locked = init(keys(5)), []
    for i in range(30):
        frame = draw((), noise=8.0, seed=i)
        state, borders = search(np.repeat(frame[None], 5, 0), state, PAPER)
        locked.append(lane_estimate_from_borders(borders, state.shifted, Camera()).locked)
    assert np.mean(locked) <= 0.02


def test_restart_can_be_switched_off():
    dark = np.full((1, 240, 320), 80, np.uint8)
    state, _ = run(dark, 20, numbers=search_numbers(GeneticSearch(restart=Restart(enabled=False))))
    assert (state.age == 20).all()


@pytest.mark.parametrize("side", [1, -1])
def test_a_lane_change_is_followed(side):
    """Two lanes; the vehicle crosses 3.75 m at 1 m/s. The search takes over the other lane once."""
    lines = np.array([1.875, -1.875, side * 5.625])
    state, shifts = init(keys(1)), []
    for i in range(70):
        drift = side * np.clip((i - 15) * 0.1, 0.0, 3.75)
        state, borders = search(draw(lines - drift, seed=i)[None], state, PAPER)
        shifts.append(int(state.shifted[0]))
    assert [shift for shift in shifts if shift] == [side]
    inner = 0.075
    assert np.median(row_errors(borders.left[0], 1.875 - inner)) < 5.0
    assert np.median(row_errors(borders.right[0], -1.875 + inner)) < 5.0


def test_another_camera():
    """The default camera changes nothing; one that sees less road and stands left of the middle does."""
    search_settings = GeneticSearch()
    assert fitted_to(search_settings, Camera()) == search_settings
    other = fitted_to(search_settings, Camera(pitch_rad=-0.03, left_m=0.5))
    assert other.objective.blocks == 30
    # the road's lengths are smaller there: 92 rows, not 157, from the bottom to the horizon
    assert other.restart.least_width_px == pytest.approx(200.0 * 92.2 / 157.0, rel=0.005)
    # the vehicle's axis is half a metre to the right of the camera
    assert other.restart.center_px == pytest.approx(160.0 + 0.5 * 92.2 / 1.34, abs=0.5)
    assert other.first_left == search_settings.first_left
    # an image scaled unequally: in its bottom row, 120 rows below the axis, the road is nearer
    tall = fitted_to(search_settings, Camera(focal_y_px=500.0))
    assert tall.restart.least_width_px == pytest.approx(200.0 * (0.04 + 120 / 500) / (0.04 + 120 / 925))


# --- bad input


def test_frames_must_fit_the_state():
    with pytest.raises(ValueError, match="frames: 2: must be 3, one per vehicle"):
        search(np.zeros((2, 240, 320), np.uint8), init(keys(3)), PAPER)


def test_settings_name_what_is_wrong():
    with pytest.raises(ValueError, match=r"generations = \(0, 1, 1\): each must be"):
        GeneticSearch(generations=(0, 1, 1))
    with pytest.raises(ValueError, match=r"a = \[0.1, -0.1\]: the first must be below the second"):
        Region(a=(0.1, -0.1), b=(0.0, 1.0), c=(0.0, 1.0))
    with pytest.raises(SettingsError, match="did you mean 'mutation_rate'"):
        read(GeneticSearch, {"mutation_rat": 0.1}, "run.toml")
    with pytest.raises(ValueError, match=r"greatest_width_px = 100\.0: must be above"):
        Restart(greatest_width_px=100.0)
