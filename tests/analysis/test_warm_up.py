"""The parts that are compiled ahead are those that a run calls: not one more variant of a kernel follows."""

import functools
import gc
import os
import subprocess
import sys
from types import SimpleNamespace

import numba

from analysis import warm_up
from analysis.simulate import simulate
from analysis.warm_up_parts import PARTS, borders
from camera_synth import render_kernels, truth_kernels
from plugin import conflict_kernels, csv_kernels, ground_truth_kernels
from plugin.lane import genetic_kernels, refine_kernels
from plugin.motion import filter_kernels, prediction_kernels
from plugin.tracking import (
    association_kernels,
    closing_kernels,
    imm_kernels,
    polar_kernels,
    rear_kernels,
)
from plugin.warning import collision_kernels, departure_kernels, tlc_kernels
from radar_synth import degrade_kernels, visibility_kernels
from sumo_net import ego_kernels, ego_road_kernels, road_kernels, surroundings_kernels

KERNELS = {
    "lane": [refine_kernels.step_kernel, refine_kernels.columns_kernel, refine_kernels.parabola_kernel],
    "picture": [render_kernels.render_fleet],
    "tracks": [
        polar_kernels.predict,
        imm_kernels.update,
        imm_kernels.expect,
        polar_kernels.estimate,
        association_kernels.gate_pairs,
    ],
    "own_drive": [
        ego_kernels.advance,
        ego_road_kernels.onto_paths,
        ego_road_kernels.drive_over,
        ego_road_kernels.see,
        conflict_kernels.path_leaders,
    ],
    "leaders": [closing_kernels.follow, collision_kernels.warn, rear_kernels.look_fleet],
    "scans": [visibility_kernels.gather, visibility_kernels.look, degrade_kernels.measure],
    "surroundings": [road_kernels.ahead, surroundings_kernels.around, conflict_kernels.lane_leaders],
    "motion": [
        filter_kernels.step,
        prediction_kernels.single_track,
        tlc_kernels.crossing,
        departure_kernels.step,
        ground_truth_kernels.compare,
    ],
    "search": [genetic_kernels.search_kernel],
    "borders": [truth_kernels.locate_borders],
    "tables": [csv_kernels.write_rows],
}


def test_a_run_needs_no_other_variant_of_the_kernels_compiled_ahead(tmp_path):
    before = {kernel: set(kernel.signatures) for part in KERNELS.values() for kernel in part}
    for part in PARTS:
        part()
        for kernel in KERNELS[part.__name__]:
            assert kernel.signatures, f"{part.__name__} does not compile {kernel.py_func.__name__}"
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


def two_processors(monkeypatch, done):
    """A machine on which nothing is compiled, and two parts that do no more than say so."""
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
    os.write(filled, bytes([PARTS.index(borders)] * 3))
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
