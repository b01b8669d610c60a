"""Freed memory is kept for the next step instead of being handed back to the system."""

import ctypes

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3  # of glibc's mallopt
_MIB = 1 << 20


def keep_freed_memory() -> bool:
    """Let the C library keep up to 128 MiB that is free; whether it could be told.

    A step works on arrays of some hundred kilobytes to a few megabytes that live no longer than the step. As
    glibc is set up, these are mapped anew every time, and every page of them costs a page fault: a tenth of
    the radar chain. Elsewhere than with glibc this does nothing.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return False
    told = [
        mallopt(_MMAP_THRESHOLD, 32 * _MIB),
        mallopt(_TRIM_THRESHOLD, 128 * _MIB),
        mallopt(_TOP_PAD, 8 * _MIB),
    ]
    return all(told)
