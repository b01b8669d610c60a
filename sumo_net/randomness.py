"""One counter-based generator per (seed, vehicle, stream).

A draw is a pure function of a 64-bit key and a counter, so it does not depend on the order or size of the
fleet, nor on threads or workers. Keys are BLAKE2b hashes of (seed, vehicle id, stream name); draws come from
the SplitMix64 finaliser (Steele, Lea, Flood 2014) of key + counter.
"""

import hashlib
import math

import numpy as np

from sumo_net.compile import kernel

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
_TO_UNIT = 1.0 / 9007199254740992.0  # 2**-53


def stream_key(seed: int, vehicle_id: str, stream: str) -> np.uint64:
    """The 64-bit key of one stream of one vehicle, the same on every machine."""
    text = f"{seed}\x00{stream}\x00{vehicle_id}".encode("utf-8", "surrogatepass")
    return np.uint64(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little"))


def generator(seed: int, vehicle_id: str, stream: str) -> np.random.Generator:
    """A numpy generator with the same key, for draws at set-up."""
    return np.random.Generator(np.random.Philox(key=int(stream_key(seed, vehicle_id, stream))))


@kernel
def bits(key, counter):  # type: ignore[no-untyped-def]
    """64 random bits, uint64, of (key, counter)."""
    z = np.uint64(key) + (np.uint64(counter) + np.uint64(1)) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@kernel
def uniform(key, counter):  # type: ignore[no-untyped-def]
    """A uniform draw in [0, 1) of (key, counter)."""
    return np.float64(bits(key, counter) >> _S11) * _TO_UNIT


@kernel
def uniforms(keys, counter):  # type: ignore[no-untyped-def]
    """Uniform draws (n,) in [0, 1) of keys (n,) at one counter."""
    out = np.empty(len(keys))
    for i in range(len(keys)):
        out[i] = uniform(keys[i], counter)
    return out


@kernel
def normal(key, counter):  # type: ignore[no-untyped-def]
    """A standard normal draw of (key, counter) by Box and Muller, from uniform draws 2c and 2c + 1."""
    u1 = 1.0 - uniform(key, np.uint64(2) * np.uint64(counter))
    u2 = uniform(key, np.uint64(2) * np.uint64(counter) + np.uint64(1))
    return math.sqrt(-2.0 * math.log(u1)) * math.cos(2.0 * math.pi * u2)
