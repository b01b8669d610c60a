"""Compiling on both cores: a second process takes the kernels from the same list as the first.

All kernels take about a minute of one core to compile, once. `compiling` starts a helper where that is still
to be done; both processes keep what they have compiled in the same cache, and neither waits for the other but
at `meet`.
"""

import contextlib
import functools
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event

from analysis.warm_up_parts import PARTS
from plugin.compiled import compiled
from sumo_net.compile import kept

Meet = Callable[[], None]
Tell = Callable[[int], None]
_TELL_EVERY_S = 0.2


@contextlib.contextmanager
def compiling(tell: Tell = lambda _: None) -> Iterator[Meet]:
    """Have the kernels compiled by two processes, if they are not yet.

    Call what it gives before the first step: that does this process's share, and returns when the helper has
    done its own. `tell` is called with the number of kernels done, first with 0.
    """
    if compiled():
        yield lambda: None
        return
    tell(0)
    with event.install_listener("numba:compile", _Teller(tell)), _with_helper() as meet:
        yield meet


class _Teller(event.Listener):
    """Tells how far both processes are, after a kernel that this one has compiled."""

    def __init__(self, tell: Tell) -> None:
        self._tell, self._told = tell, time.monotonic()

    def on_start(self, event: Any) -> None:
        """Nothing is done yet."""

    def on_end(self, event: Any) -> None:
        """A kernel, or one within another, is compiled."""
        if time.monotonic() - self._told > _TELL_EVERY_S:
            self._told = time.monotonic()
            self._tell(kept())


@contextlib.contextmanager
def _with_helper() -> Iterator[Meet]:
    if (os.cpu_count() or 1) < 2:
        yield lambda: None
        return
    waiting, filled = os.pipe()
    os.write(filled, bytes(range(len(PARTS))))
    os.close(filled)  # who reads on when all are taken finds the end
    # -P: whatever is called `analysis` where the user stands is not this one
    command = [sys.executable, "-P", "-m", "analysis.warm_up"]
    said, quiet = subprocess.PIPE, subprocess.DEVNULL
    with subprocess.Popen(command, stdin=waiting, stdout=said, stderr=quiet) as helper:

        def meet() -> None:
            take(waiting, lambda _: None)
            helper.wait()  # should it have failed, what it had taken is compiled where it is needed

        try:
            yield meet
        finally:
            helper.terminate()
            os.close(waiting)


def take(waiting: int, say: Callable[[bytes], object]) -> None:
    """Compile one part after the other of those whose numbers, a byte each, wait in a pipe.

    `say` is called with each number before.
    """
    with _nothing_collected():
        while number := os.read(waiting, 1):
            say(number)
            PARTS[number[0]]()


def help_parent() -> None:
    """Take from standard input, until all is taken or the parent, which reads what is said, is gone."""
    with contextlib.suppress(BrokenPipeError):
        take(sys.stdin.fileno(), functools.partial(os.write, sys.stdout.fileno()))


@contextlib.contextmanager
def _nothing_collected() -> Iterator[None]:
    # a compiler keeps most of what it makes: looking for rubbish is a tenth of its time
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


if __name__ == "__main__":
    help_parent()
