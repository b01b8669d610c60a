"""Keeps freed memory for the next step instead of returning it to the operating system."""

import ctypes

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3  # of glibc's mallopt
_MIB = 1 << 20


def keep_freed_memory() -> bool:
    """Let glibc keep up to 128 MiB of freed memory; returns whether that worked.

    A step works on temporary arrays of some hundred kilobytes to a few megabytes. By default glibc maps these
    anew each time, and every page costs a page fault: a tenth of the radar chain's time. With other C
    libraries this does nothing.
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
