"""Compiled kernels: a broken or read-only cache stops no run."""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from analysis.fork_server import ForkServer
from sumo_net import compile as compiling

MODULE = """import numpy as np
from sumo_net.compile import kernel

@kernel
def double(x):
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = 2.0 * x[i]
    return out
"""


def use(folder: Path) -> tuple[list[float], int]:
    """In a process of its own: what the kernel gives, and how often the cache had it."""
    sys.path.insert(0, str(folder))
    import doubling  # type: ignore[import-not-found]

    return doubling.double(np.arange(3.0)).tolist(), sum(doubling.double.stats.cache_hits.values())


def shorten(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:20])


def garble(file: Path) -> None:
    file.write_bytes(b"\x80\x04\x95garbage" + file.read_bytes()[30:])


def empty(file: Path) -> None:
    file.write_bytes(b"")


def test_a_broken_cache_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "doubling.py").write_text(MODULE)
    right = [0.0, 2.0, 4.0]
    with ForkServer(("sumo_net.compile",)) as server:
        assert server.result(use, tmp_path) == (right, 0)
        assert server.result(use, tmp_path) == (right, 1)
        for suffix, spoil in (("nbi", shorten), ("nbc", shorten), ("nbi", empty), ("nbc", garble)):
            (file,) = (tmp_path / "__pycache__").glob(f"*.{suffix}")
            spoil(file)
            assert server.result(use, tmp_path) == (right, 0), (suffix, spoil)
            assert server.result(use, tmp_path) == (right, 1), (suffix, spoil)


def use_as_compiled_otherwise(folder: Path) -> tuple[list[float], int]:
    compiling._COMPILED_BY = ((0.0, 0),)
    return use(folder)


def test_what_was_compiled_in_another_way_is_compiled_anew(tmp_path: Path) -> None:
    (tmp_path / "doubling.py").write_text(MODULE)
    with ForkServer(("sumo_net.compile",)) as server:
        hits = [server.result(way, tmp_path)[1] for way in (use, use, use_as_compiled_otherwise)]
    assert hits == [0, 1, 0]


def test_without_any_folder_to_write_it_compiles_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise RuntimeError("cannot cache function 'double': no locator available")

    monkeypatch.setattr(compiling.FunctionCache, "__init__", refuse)
    monkeypatch.setattr(compiling, "KERNELS", [])
    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR"):
        double = compiling.kernel(lambda x: 2.0 * x)
    assert double(3.0) == 6.0


def test_a_cache_on_a_full_disk_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(compiling.FunctionCache, "save_overload", full)
    monkeypatch.setattr(compiling, "KERNELS", [])

    @compiling.kernel
    def triple(x: float) -> float:
        return 3.0 * x

    assert triple(2.0) == 6.0


def use_after_edit(folder: Path) -> float:
    """In a process of its own: what `outer` gives, imported before its file and `inner`'s changed."""
    sys.path.insert(0, str(folder))
    import outer  # type: ignore[import-not-found]

    for name, text in (("inner", INNER.replace("2.0 * x", "30.0 * x")), ("outer", OUTER + "# edited")):
        (folder / f"{name}.py").write_text(text)
    return float(outer.outer(3.0))


def test_a_process_does_not_keep_what_it_compiled_of_files_edited_since(tmp_path: Path) -> None:
    for name, text in {"inner": INNER, "middle": MIDDLE, "outer": OUTER}.items():
        (tmp_path / f"{name}.py").write_text(text)
    with ForkServer(("sumo_net.compile",)) as server:
        assert server.result(use_after_edit, tmp_path) == 701.0
        assert server.result(call_outer, tmp_path) == (9101.0, 0, 0)


CALLING = """from sumo_net.compile import inlined, kernel

@kernel
def twice(x):
    return 2.0 * x

@inlined
def half(x):
    return 0.5 * x

@kernel
def both(x):
    return twice(x) + half(x)
"""


def call_within(folder: Path) -> tuple[float, list[str], float, int, int]:
    """In a process of its own: what `both` gives, what is in the cache, and then of `twice` by itself."""
    sys.path.insert(0, str(folder))
    import calling  # type: ignore[import-not-found]

    given = calling.both(3.0)
    files = sorted(file.name.split("-")[0] for file in (folder / "__pycache__").glob("*.nbi"))
    before = compiling.kept()
    return given, files, calling.twice(3.0), before, compiling.kept()


def test_a_kernel_within_another_is_not_kept_by_itself(tmp_path: Path) -> None:
    (tmp_path / "calling.py").write_text(CALLING)
    with ForkServer(("sumo_net.compile",)) as server:
        assert server.result(call_within, tmp_path) == (7.5, ["calling.both"], 6.0, 1, 2)


SAYING = """from sumo_net.compile import kernel

@kernel
def small(x):
    if x > 3.0:
        raise ValueError("too large", x)
    return x

@kernel
def twice(x):
    return 2.0 * small(x)

@kernel
def more(x):
    return twice(x) + 1.0
"""


def call_too_large(folder: Path) -> tuple[float, tuple[object, ...]]:
    """In a process of its own: what `more` gives, and what it raises two kernels further in."""
    sys.path.insert(0, str(folder))
    import saying  # type: ignore[import-not-found]

    given = saying.more(3.0)
    with pytest.raises(ValueError, match="too large") as raised:
        saying.more(4.0)
    return given, raised.value.args


def call_with(folder: Path, codegen: dict[str, type]) -> tuple[bool, float, tuple[object, ...]]:
    """In a process of its own, as if this were numba's code generation: whether ours is used."""
    module = ModuleType("numba.core.codegen")
    vars(module).update(codegen)
    sys.modules["numba.core.codegen"] = module
    for name in ("sumo_net.compile", "sumo_net.inner_compiler"):
        del sys.modules[name]  # this file has imported them
    used = hasattr(import_module("sumo_net.compile"), "InnerCompiler")
    return used, *call_too_large(folder)


def test_what_an_inner_kernel_raises_arrives_with_its_values(tmp_path: Path) -> None:
    (tmp_path / "saying.py").write_text(SAYING)
    with ForkServer(("sumo_net.compile",)) as server:
        for _ in ("compiled", "kept"):
            assert server.result(call_too_large, tmp_path) == (7.0, ("too large", 4.0))


def test_numba_is_as_the_inner_compiler_wants_it() -> None:
    assert hasattr(compiling, "InnerCompiler")


@pytest.mark.parametrize("codegen", [{}, {"JITCodeLibrary": object, "JITCPUCodegen": object}])
def test_another_numba_compiles_the_same_by_itself(codegen: dict[str, type], tmp_path: Path) -> None:
    (tmp_path / "saying.py").write_text(SAYING)
    with ForkServer(("sumo_net.compile",)) as server:
        assert server.result(call_with, tmp_path, codegen) == (False, 7.0, ("too large", 4.0))


INNER = """from typing import NamedTuple
from sumo_net.compile import kernel

class Given(NamedTuple):
    one: float
    other: float

@kernel
def innermost(x):
    return 2.0 * x
"""
MIDDLE = """from sumo_net.compile import kernel
from inner import innermost

MORE = 1.0

@kernel
def between(x):
    return innermost(x) + MORE
"""
OUTER = """from sumo_net.compile import kernel
from inner import Given
from middle import MORE, between

@kernel
def outer(x):
    given = Given(between(x), MORE)
    return 100.0 * given[0] + given[1]

@kernel
def beside(x):
    return -x
"""


def call_outer(folder: Path) -> tuple[float, int, int]:
    """In a process of its own: what `outer` gives, how often the cache had it, and `beside`."""
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True  # edits within a second, of the same length, are seen
    import outer  # type: ignore[import-not-found]

    given = outer.outer(3.0)
    outer.beside(3.0)
    return given, *(sum(one.stats.cache_hits.values()) for one in (outer.outer, outer.beside))


def test_what_a_changed_kernel_is_in_is_compiled_anew(tmp_path: Path) -> None:
    texts = {"inner": INNER, "middle": MIDDLE, "outer": OUTER}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    with ForkServer(("sumo_net.compile",)) as server:
        assert server.result(call_outer, tmp_path) == (701.0, 0, 0)
        assert server.result(call_outer, tmp_path) == (701.0, 1, 1)
        (tmp_path / "inner.py").write_text(INNER.replace("2.0 * x", "30.0 * x"))
        assert server.result(call_outer, tmp_path) == (9101.0, 0, 1)
        assert server.result(call_outer, tmp_path) == (9101.0, 1, 1)
        (tmp_path / "middle.py").write_text(MIDDLE.replace("1.0", "2.0"))
        assert server.result(call_outer, tmp_path) == (9202.0, 0, 1)
        (tmp_path / "inner.py").write_text(INNER.replace("one: float", "last: float"))
        assert server.result(call_outer, tmp_path) == (802.0, 0, 1)


def test_a_constant_is_part_of_a_kernel_and_what_is_beside_it_is_not(tmp_path: Path) -> None:
    from sumo_net.kernel_sources import parts

    here = {"np": np, "WIDTH": 3, "OTHER": 4}
    exec("def wide(x):\n    return np.sqrt(x) * WIDTH", here)
    names = {part[1] for part in parts(here["wide"]) if len(part) == 3}  # type: ignore[arg-type]
    assert "WIDTH" in names
    assert "OTHER" not in names
