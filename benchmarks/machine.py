"""Speed of one core of this machine: memory copy, and vector arithmetic in the first-level cache."""

import time

import numba
import numpy as np


def limits() -> dict[str, float]:
    """GB/s of a copy beyond all caches (read and written), and Gflop/s of multiply-adds in float32."""
    source, target = np.ones(1 << 25, np.float32), np.zeros(1 << 25, np.float32)
    copied = min(_spent(lambda: np.copyto(target, source)) for _ in range(7))
    x, rounds = np.full(1024, 0.5, np.float32), 20_000
    _multiply_add(x, 1)
    worked = min(_spent(lambda: _multiply_add(x, rounds)) for _ in range(7))
    flops = 16.0 * x.size * rounds / worked
    return {"copy_gb_per_s": 2.0 * source.nbytes / copied / 1e9, "float32_gflop_per_s": flops / 1e9}


@numba.njit(fastmath={"contract"})  # fused, but the eight are not merged
def _multiply_add(x, rounds):  # type: ignore[no-untyped-def]
    """Eight multiply-adds on each of x (n,), `rounds` times."""
    a, b = np.float32(0.999), np.float32(1e-3)
    for _ in range(rounds):
        for i in range(x.shape[0]):
            v = x[i]
            for _ in range(8):
                v = v * a + b
            x[i] = v


def _spent(function) -> float:  # type: ignore[no-untyped-def]
    begin = time.process_time()
    function()
    return time.process_time() - begin
