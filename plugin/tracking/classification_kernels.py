"""Kernel of the motion classes' state machine, over all tracks."""

from typing import NamedTuple

import numpy as np

from sumo_net.compile import kernel

UNCLASSIFIED, STATIONARY, SAME_DIRECTION, ONCOMING, STOPPED_SAME, STOPPED_ONCOMING = range(6)


class ClassRules(NamedTuple):
    """The class settings as kernels take them."""

    settle_cycles: int
    stop_cycles: int
    go_cycles: int
    near_zero_mps: float
    oncoming_speed_mps: float  # V_x


@kernel
def advance(state, candidate, count, speed, measured, moving, p):  # type: ignore[no-untyped-def]
    """One cycle in place: state, candidate, count (T,) int8; speed (T,) over ground along x.

    moving (T,) is V_t, p ClassRules. A cycle without a measurement neither counts nor interrupts the
    count.
    """
    for t in range(len(state)):
        now, v = state[t], speed[t]
        if not measured[t]:
            continue
        target, needed = now, p.go_cycles
        if now == UNCLASSIFIED:
            needed = p.settle_cycles
            if v >= moving[t]:
                target = SAME_DIRECTION
            elif v <= p.oncoming_speed_mps:
                target = ONCOMING
            else:
                target = STATIONARY
        elif now in (SAME_DIRECTION, ONCOMING):
            needed = p.stop_cycles
            if abs(v) <= p.near_zero_mps or p.oncoming_speed_mps < v < moving[t]:
                # Text ii of the patent prints 'was same direction' for both; its description has the pair.
                target = STOPPED_SAME if now == SAME_DIRECTION else STOPPED_ONCOMING
        elif v > moving[t]:
            target = SAME_DIRECTION
        elif v < p.oncoming_speed_mps:
            target = ONCOMING
        if target == now or not np.isfinite(v):
            count[t] = 0
            continue
        count[t] = count[t] + 1 if count[t] > 0 and candidate[t] == target else 1
        candidate[t] = target
        if count[t] >= needed:
            state[t] = target
            count[t] = 0
