"""Runs in processes of their own: one can hold only one simulation."""

import atexit
from typing import Any

from analysis.fork_server import ForkServer

_server = ForkServer()  # one for all tests of a process: it has loaded everything
atexit.register(_server.close)


def in_process(function: Any, *arguments: Any) -> Any:
    """Value of an importable function that runs in a process of its own."""
    return _server.result(function, *arguments)
