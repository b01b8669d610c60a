"""The parts compiled ahead cover a run: it compiles no further kernel variant."""

import functools
import gc
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numba

from analysis import warm_up
from analysis.fork_server import ForkServer
from analysis.simulate import simulate
from analysis.warm_up_parts import PARTS, surroundings
from plugin.lane import refine_kernels
from sumo_net.compile import KERNELS


def late_in_a_run(out: Path) -> list[str]:
    """Kernels that a run compiles or loads after all parts are compiled."""
    for part in PARTS:
        part()
    ahead = {kernel: set(kernel.signatures) for kernel in KERNELS}
    simulate("highway", out, seed=3, duration_s=0.3, fraction=0.1, quiet=True)
    late = [kernel.py_func for kernel in KERNELS if set(kernel.signatures) - ahead.get(kernel, set())]
    return [f"{function.__module__}.{function.__name__}" for function in late]


def test_a_run_compiles_nothing_but_the_parts(tmp_path):
    with ForkServer(("analysis.simulate",)) as server:
        late = server.result(late_in_a_run, tmp_path)
    assert not late, "these belong into a part, or are called there with other types"


def test_a_helper_starts_only_where_something_is_to_be_compiled(monkeypatch):
    assert warm_up.compiled()  # the test above has run it, or the one before that

    def never(*_: object, **__: object) -> None:
        raise AssertionError("started a process for what is compiled")

    monkeypatch.setattr(warm_up.subprocess, "Popen", never)
    with warm_up.compiling() as meet:
        meet()


def two_processors(monkeypatch, done):
    """Nothing is compiled, and there are two parts that only report being called."""
    monkeypatch.setattr(warm_up, "compiled", lambda: False)
    monkeypatch.setattr(warm_up.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(warm_up, "PARTS", [functools.partial(done.append, part) for part in ("one", "other")])


def test_what_a_failed_helper_leaves_is_done_without_it(monkeypatch):
    done = []
    two_processors(monkeypatch, done)
    monkeypatch.setattr(warm_up.sys, "executable", "false")
    with warm_up.compiling() as meet:
        meet()
    assert done == ["one", "other"]
    assert gc.isenabled()


def test_what_the_helper_has_taken_is_not_done_again(monkeypatch):
    done = []
    two_processors(monkeypatch, done)
    popen = warm_up.subprocess.Popen

    def takes_one(_: object, **streams: object) -> object:
        helper = popen(["head", "-c", "1"], **streams)
        helper.wait()
        return helper

    monkeypatch.setattr(warm_up.subprocess, "Popen", takes_one)
    with warm_up.compiling() as meet:
        meet()
    assert done == ["other"]


def test_a_helper_whose_parent_is_gone_takes_no_more_than_one_part():
    waiting, filled = os.pipe()
    os.write(filled, bytes([PARTS.index(surroundings)] * 3))
    os.close(filled)
    read, said = os.pipe()
    os.close(read)
    command = [sys.executable, "-P", "-m", "analysis.warm_up"]
    assert subprocess.run(command, stdin=waiting, stdout=said, timeout=60).returncode == 0
    assert len(os.read(waiting, 3)) == 2
    os.close(waiting)
    os.close(said)


def test_without_a_cache_no_helper_starts(monkeypatch):
    uncached = SimpleNamespace(stats=SimpleNamespace(cache_path=None))
    monkeypatch.setattr(refine_kernels, "step_kernel", uncached)
    assert warm_up.compiled()


def test_it_tells_how_many_kernels_are_done(monkeypatch):
    told = []
    monkeypatch.setattr(warm_up, "compiled", lambda: False)
    monkeypatch.setattr(warm_up.os, "cpu_count", lambda: 1)
    monkeypatch.setattr(warm_up, "_TELL_EVERY_S", -1.0)
    monkeypatch.setattr(warm_up, "kept", lambda: 7)
    with warm_up.compiling(told.append) as meet:
        meet()
        numba.njit(lambda x: x + 1.0)(1.0)
    assert told[0] == 0
    assert told[-1] == 7
