"""Compilation on two cores: a second process takes kernels from the same list as the first.

Compiling all kernels takes about a minute of one core, once. `compiling` starts a helper process if that is
still to be done; both processes write to the same cache, and wait for each other only at `meet`.
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
    """Let two processes compile the kernels, if they are not compiled yet.

    Call the function it yields before the first step: it does this process's share, and returns when the
    helper has finished. `tell` is called with the number of kernels done, first with 0.
    """
    if compiled():
        yield lambda: None
        return
    tell(0)
    with event.install_listener("numba:compile", _Teller(tell)), _with_helper() as meet:
        yield meet


class _Teller(event.Listener):
    """Reports the progress of both processes after each kernel compiled in this one."""

    def __init__(self, tell: Tell) -> None:
        self._tell, self._told = tell, time.monotonic()

    def on_start(self, event: Any) -> None:
        """Does nothing."""

    def on_end(self, event: Any) -> None:
        """Called when a kernel, possibly nested, is compiled."""
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
    os.close(filled)  # so that readers find the end when all are taken
    # -P: not another `analysis` in the user's working directory
    command = [sys.executable, "-P", "-m", "analysis.warm_up"]
    said, quiet = subprocess.PIPE, subprocess.DEVNULL
    with subprocess.Popen(command, stdin=waiting, stdout=said, stderr=quiet) as helper:

        def meet() -> None:
            take(waiting, lambda _: None)
            helper.wait()  # if it failed, its parts are compiled when first used

        try:
            yield meet
        finally:
            helper.terminate()
            os.close(waiting)


def take(waiting: int, say: Callable[[bytes], object]) -> None:
    """Compile the parts whose numbers, a byte each, are taken from the pipe `waiting`, until it is empty.

    `say` is called with each number first.
    """
    with _nothing_collected():
        while number := os.read(waiting, 1):
            say(number)
            PARTS[number[0]]()


def help_parent() -> None:
    """Take parts from standard input, until it is empty or the parent, which reads the numbers, is gone."""
    with contextlib.suppress(BrokenPipeError):
        take(sys.stdin.fileno(), functools.partial(os.write, sys.stdout.fileno()))


@contextlib.contextmanager
def _nothing_collected() -> Iterator[None]:
    # a compiler keeps most objects: garbage collection would be a tenth of its time
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


if __name__ == "__main__":
    help_parent()
