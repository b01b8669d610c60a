"""Kernels of the published genetic search (Zhang et al. 2011, section 1.2.2).

A chromosome is an unsigned integer, its first printed bit the most significant one: a, then b, then c.
"""

import numpy as np

from plugin.lane.objective_kernels import (
    BLOCK_PX,
    BLOCKS,
    NO_SCORE,
    block_map,
    mean_value,
    reachable_columns,
    road_grey,
    slope_class,
)
from sumo_net.compile import kernel
from sumo_net.randomness import bits, uniform

FRAME_SHIFT = 32  # a frame has 2**32 counters, half of them for each border


@kernel
def decode(chromosome, low, high, widths, border):  # type: ignore[no-untyped-def]
    """Write (a, b, c) of a chromosome to border[0:3], eq. 5: x = x₁ + x'/(2ᵏ - 1)·(x₂ - x₁).

    (The print has x' - x₁ for x' in the numerator; the source's own example needs x'.)
    """
    rest = np.uint64(chromosome)
    for parameter in range(2, -1, -1):
        width = np.uint64(widths[parameter])
        largest = (np.uint64(1) << width) - np.uint64(1)
        share = np.float64(rest & largest) / np.float64(largest)
        border[parameter] = low[parameter] + share * (high[parameter] - low[parameter])
        rest >>= width


@kernel
def swapped_bits(length, p1, p2, p3):  # type: ignore[no-untyped-def]
    """Mask of the second and the fourth segment of `length` bits cut before the bits p1 < p2 < p3."""
    one = np.uint64(1)
    second = ((one << np.uint64(p2 - p1)) - one) << np.uint64(length - p2)
    fourth = (one << np.uint64(length - p3)) - one
    return second | fourth


@kernel
def cross(first, second, mask):  # type: ignore[no-untyped-def]
    """Both children: the parents with the bits of `mask` exchanged."""
    exchanged = (np.uint64(first) ^ np.uint64(second)) & np.uint64(mask)
    return np.uint64(first) ^ exchanged, np.uint64(second) ^ exchanged


@kernel
def mutate(chromosome, length, bit):  # type: ignore[no-untyped-def]
    """The chromosome with one bit, counted from the left and from 0, turned over."""
    return np.uint64(chromosome) ^ (np.uint64(1) << np.uint64(length - 1 - bit))


@kernel
def _below(word, shift, bound):  # type: ignore[no-untyped-def]
    """An integer in [0, bound) from 20 bits of a random word."""
    return np.int64((((word >> np.uint64(shift)) & np.uint64(0xFFFFF)) * np.uint64(bound)) >> np.uint64(20))


@kernel
def crossover_points(word, length):  # type: ignore[no-untyped-def]
    """Three different cuts 1 ≤ p1 < p2 < p3 < length from a random word, all triples equally likely."""
    p1 = 1 + _below(word, 0, length - 1)
    p2 = 1 + _below(word, 20, length - 2)
    p3 = 1 + _below(word, 40, length - 3)
    if p2 >= p1:
        p2 += 1
    low, high = min(p1, p2), max(p1, p2)
    if p3 >= low:
        p3 += 1
    if p3 >= high:
        p3 += 1
    return min(low, p3), max(low, min(high, p3)), max(high, p3)


@kernel
def roulette_weights(fitness, weights):  # type: ignore[no-untyped-def]
    """Weights of eq. 7, scaled so that the greatest is 2**32.

    A weight is the fitness itself; if any is negative, all are shifted by the lowest. A candidate without
    blocks has weight 0. If all would be 0, all are equal.
    """
    lowest, highest = 0.0, -np.inf
    for i in range(fitness.shape[0]):
        if fitness[i] > NO_SCORE:
            lowest = min(lowest, fitness[i])
            highest = max(highest, fitness[i])
    for i in range(fitness.shape[0]):
        if highest <= lowest:
            weights[i] = 4294967296.0
        elif fitness[i] > NO_SCORE:
            weights[i] = (fitness[i] - lowest) / (highest - lowest) * 4294967296.0
        else:
            weights[i] = 0.0


@kernel
def spin(weights, key, counter):  # type: ignore[no-untyped-def]
    """(index chosen with the probability of eq. 7, next counter).

    Indices are drawn uniformly and accepted with probability weight / greatest weight, which gives the
    roulette wheel's probabilities without summing the weights.
    """
    size = np.uint64(weights.shape[0])
    while True:
        word = bits(key, counter)
        counter += np.uint64(1)
        index = np.int64(((word >> np.uint64(32)) * size) >> np.uint64(32))
        if np.float64(word & np.uint64(0xFFFFFFFF)) < weights[index]:
            return index, counter


@kernel
def evolve(maps, roads, sign, low, high, widths, generations, key, counter, numbers, best, history):  # type: ignore[no-untyped-def]
    """One border's search. Writes (a, b, c) to best[0:3], the best F per generation to `history`; returns F.

    maps (3, 50, 320): block values per slope class; roads (3,): the road's grey times α of each class; sign:
    +1 left, -1 right; low, high (3,): the region; key, counter: start of the random draws; history may be
    empty.
    """
    size = numbers.population
    length = np.int64(widths[0] + widths[1] + widths[2])
    population = np.empty(size, np.uint64)
    children = np.empty(size, np.uint64)
    fitness = np.empty(size)
    inherited = np.empty(size)
    border = np.empty(3)
    weights = np.empty(size)
    draw = np.uint64(counter)
    for i in range(size):
        population[i] = bits(key, draw + np.uint64(i)) >> np.uint64(64 - length)
        children[i] = ~population[i]  # so that all of the first generation is evaluated
        inherited[i] = 0.0
    draw += np.uint64(size)
    elite = 0
    for generation in range(generations + 1):
        # fitness, eq. 6; a child equal to its parent keeps the parent's
        for i in range(size):
            if population[i] == children[i]:
                fitness[i] = inherited[i]
                continue
            decode(population[i], low, high, widths, border)
            row = slope_class(sign * border[1])
            fitness[i] = mean_value(
                maps[row], border[0], border[1], border[2], roads[row], numbers.blocks, numbers.minimum_blocks
            )
        elite = 0
        for i in range(1, size):
            if fitness[i] > fitness[elite]:
                elite = i
        if generation < history.shape[0]:
            history[generation] = fitness[elite]
        if generation == generations:
            break
        # selection, eq. 7; index 0 keeps the best individual, untouched by the operators
        roulette_weights(fitness, weights)
        children[0] = population[elite]
        inherited[0] = fitness[elite]
        for i in range(1, size):
            chosen, draw = spin(weights, key, draw)
            children[i] = population[chosen]
            inherited[i] = fitness[chosen]
        for i in range(size):  # assigning a slice would take two seconds more to compile
            population[i] = children[i]
        # crossover of an individual with the next one
        for i in range(1, size - 1):
            if uniform(key, draw + np.uint64(i)) < numbers.crossover_rate:
                p1, p2, p3 = crossover_points(bits(key, draw + np.uint64(size + i)), length)
                mask = swapped_bits(length, p1, p2, p3)
                population[i], population[i + 1] = cross(population[i], population[i + 1], mask)
        draw += np.uint64(2 * size)
        # mutation of one bit
        for i in range(1, size):
            if uniform(key, draw + np.uint64(i)) < numbers.mutation_rate:
                bit = _below(bits(key, draw + np.uint64(size + i)), 0, length)
                population[i] = mutate(population[i], length, bit)
        draw += np.uint64(2 * size)
    decode(population[elite], low, high, widths, best)
    return fitness[elite]


@kernel
def stage_of(age, transition_frames):  # type: ignore[no-untyped-def]
    """0 in the first frame after a (re)start, 1 in the transition, 2 after it."""
    if age == 0:
        return 0
    return 1 if age <= transition_frames else 2


@kernel
def region_of_interest(stage, side, last, numbers, low, high):  # type: ignore[no-untyped-def]
    """Bounds of a, b and c: the fixed region in stage 0, the last result ± a reach afterwards."""
    for parameter in range(3):
        if stage == 0:
            low[parameter] = numbers.first[side, parameter, 0]
            high[parameter] = numbers.first[side, parameter, 1]
        else:
            reach = numbers.reach[stage - 1, parameter]
            low[parameter] = last[parameter] - reach
            high[parameter] = last[parameter] + reach


@kernel
def search_border(frame, side, stage, last, grey, key, counter, numbers, maps, best, history):  # type: ignore[no-untyped-def]
    """One border in one frame: region, block maps of the slope classes within it, evolution; returns F."""
    low = np.empty(3)
    high = np.empty(3)
    roads = np.empty(3)
    first = np.empty(maps.shape[1], np.int64)
    final = np.empty(maps.shape[1], np.int64)
    region_of_interest(stage, side, last, numbers, low, high)
    reachable_columns(low, high, numbers.blocks, first, final)
    sign = 1.0 if side == 0 else -1.0
    gentlest, steepest = min(sign * low[1], sign * high[1]), max(sign * low[1], sign * high[1])
    for row in range(3):
        roads[row] = numbers.alpha[row] * grey
        # classes 0, 1, 2 are slopes in [0.5, 2], above 2, below 0.5
        if row == 0 and (steepest < 0.5 - 1e-9 or gentlest > 2.0 + 1e-9):
            continue
        if row == 1 and steepest <= 2.0 - 1e-9:
            continue
        if row == 2 and gentlest >= 0.5 + 1e-9:
            continue
        block_map(frame, numbers.stencils[side, row], numbers.blocks, first, final, maps[row])
    generations = numbers.generations[stage]
    widths = numbers.bits[side, stage]
    return evolve(maps, roads, sign, low, high, widths, generations, key, counter, numbers, best, history)


@kernel
def search_kernel(frames, state, numbers, after):  # type: ignore[no-untyped-def]
    """One frame of every vehicle: restart where due, search, count failures.

    `state` and `after` are SearchStates; `after` is filled. If the borders of a lane differ by w in (a, b,
    c), the left neighbour's left border is at left - w, as both scale with the height of the camera only.
    """
    maps = np.zeros((3, BLOCKS, frames.shape[2]), np.int32)
    history = np.empty(0)
    last = np.empty((2, 3))
    for v in range(frames.shape[0]):
        grey = road_grey(frames[v], numbers.region[0], numbers.region[1], numbers.region[2])
        counter = np.uint64(state.frame[v]) << np.uint64(FRAME_SHIFT)
        shift = _lane_shift(state.age[v], state.border[v], numbers)
        for one in range(2):
            for parameter in range(3):
                last[one, parameter] = state.border[v, one, parameter]
        if shift != 0:
            crossed, far = (0, 1) if shift > 0 else (1, 0)
            for parameter in range(3):
                last[far, parameter] = state.border[v, crossed, parameter]
                last[crossed, parameter] = (
                    2.0 * state.border[v, crossed, parameter] - state.border[v, far, parameter]
                )
        for side in range(2):
            age = state.age[v, side] if shift == 0 else 1
            stage = stage_of(age, numbers.transition_frames)
            start = counter + (np.uint64(side) << np.uint64(FRAME_SHIFT - 1))
            after.score[v, side] = search_border(
                frames[v],
                side,
                stage,
                last[side],
                grey,
                state.key[v],
                start,
                numbers,
                maps,
                after.border[v, side],
                history,
            )
            after.age[v, side] = age + 1
            after.failing[v, side] = state.failing[v, side] if shift == 0 else 0
        after.key[v] = state.key[v]
        after.frame[v] = state.frame[v] + 1
        after.shifted[v] = shift
        if numbers.restarts:
            _note_failure(after.border[v], after.score[v], after.failing[v], after.age[v], numbers)


@kernel
def _lane_shift(age, border, numbers):  # type: ignore[no-untyped-def]
    """+1 if the last result's left border is right of the image's centre, -1 if its right border is left."""
    if not numbers.restarts or age[0] == 0 or age[1] == 0 or not plausible(border, numbers):
        return 0
    if border[0, 2] > numbers.center_px + numbers.crossed_by_px:
        return 1
    if border[1, 2] < numbers.center_px - numbers.crossed_by_px:
        return -1
    return 0


@kernel
def plausible(border, numbers):  # type: ignore[no-untyped-def]
    """Whether the borders keep a lane's distance at the bottom and do not cross in the processed rows."""
    top = 1.0 + BLOCK_PX * (numbers.blocks - 1)
    width = border[1, 2] - border[0, 2]
    rise = (border[1, 0] - border[0, 0]) * top + border[1, 1] - border[0, 1]
    return numbers.least_width_px <= width <= numbers.greatest_width_px and width + rise * top > 0.0


@kernel
def _note_failure(border, score, failing, age, numbers):  # type: ignore[no-untyped-def]
    """Count frames in which a border failed; after `patience` of them, return it to the first stage."""
    lane = plausible(border, numbers)
    for side in range(2):
        if lane and score[side] >= numbers.least_score:
            failing[side] = 0
            continue
        failing[side] += 1
        if failing[side] >= numbers.patience:
            failing[side] = 0
            age[side] = 0
