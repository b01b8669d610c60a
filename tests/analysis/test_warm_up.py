"""The parts that are compiled ahead are those that a run calls: not one more variant of a kernel follows."""

import functools
from types import SimpleNamespace

import numba

from analysis import warm_up
from analysis.simulate import simulate
from camera_synth import render_kernels
from plugin import ground_truth_kernels
from plugin.lane import genetic_kernels, refine_kernels
from plugin.motion import filter_kernels, prediction_kernels
from plugin.tracking import association_kernels, imm_kernels, polar_kernels
from plugin.warning import departure_kernels, tlc_kernels
from radar_synth import degrade_kernels, visibility_kernels

KERNELS = {
    "lane": [refine_kernels.step_kernel, refine_kernels.columns_kernel, refine_kernels.parabola_kernel],
    "picture": [render_kernels.render_fleet, genetic_kernels.search_kernel],
    "motion": [
        filter_kernels.step,
        prediction_kernels.single_track,
        tlc_kernels.crossing,
        departure_kernels.step,
        ground_truth_kernels.compare,
    ],
    "radar": [
        visibility_kernels.gather,
        visibility_kernels.look,
        degrade_kernels.measure,
        polar_kernels.predict,
        imm_kernels.update,
        imm_kernels.expect,
        polar_kernels.estimate,
        association_kernels.gate_pairs,
    ],
}


def test_a_run_needs_no_other_variant_of_the_kernels_compiled_ahead(tmp_path):
    before = {kernel: set(kernel.signatures) for part in KERNELS.values() for kernel in part}
    for name, part in warm_up.PARTS.items():
        part()
        for kernel in KERNELS[name]:
            assert kernel.signatures, f"{name} does not compile {kernel.py_func.__name__}"
    ahead = {kernel: set(kernel.signatures) for kernel in before}
    simulate("highway", tmp_path, seed=3, duration_s=0.3, fraction=0.1, quiet=True)
    for kernel, signatures in ahead.items():
        assert isinstance(kernel, numba.core.dispatcher.Dispatcher)
        assert set(kernel.signatures) == signatures, kernel.py_func.__name__


def test_a_helper_starts_only_where_something_is_to_be_compiled(monkeypatch):
    assert warm_up.compiled()  # the test above has run it, or the one before that

    def never(*_: object, **__: object) -> None:
        raise AssertionError("started a process for what is compiled")

    monkeypatch.setattr(warm_up.subprocess, "Popen", never)
    with warm_up.compiling() as meet:
        meet()


def test_what_a_failed_helper_leaves_is_done_without_it(monkeypatch):
    done = []
    monkeypatch.setattr(warm_up, "compiled", lambda: False)
    monkeypatch.setattr(warm_up.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(warm_up.sys, "executable", "false")
    for part in ("picture", "motion"):
        monkeypatch.setattr(warm_up, part, functools.partial(done.append, part))
    with warm_up.compiling() as meet:
        meet()
    assert done == ["picture", "motion"]


def test_without_a_cache_no_helper_starts(monkeypatch):
    uncached = SimpleNamespace(stats=SimpleNamespace(cache_path=None))
    monkeypatch.setattr(refine_kernels, "step_kernel", uncached)
    assert warm_up.compiled()


def test_it_tells_how_many_kernels_are_done(monkeypatch):
    told = []
    monkeypatch.setattr(warm_up, "compiled", lambda: False)
    monkeypatch.setattr(warm_up.os, "cpu_count", lambda: 1)
    monkeypatch.setattr(warm_up, "_TELL_EVERY_S", -1.0)
    with warm_up.compiling(told.append) as meet:
        meet()
        numba.njit(lambda x: x + 1.0)(1.0)
    assert told[0] == 0
    assert told[-1] > 0
