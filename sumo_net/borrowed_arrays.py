"""Kernels that do not count references, where whoever calls them holds the arrays for as long as they run.

numba counts one more for every array that is taken from a NamedTuple, sliced or handed on, and one less when
that is done with: locked additions, for which all threads wait. A kernel that neither makes arrays nor gives
any back can do without; its arguments cost less to hand over, too.
"""

from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import AnnotateTypes

from sumo_net.call_types import RememberingCompiler
from sumo_net.scratch import scratch

_VIEWS = ("getattr", "static_getitem", "build_tuple", "cast", "phi", "exhaust_iter")


class BorrowingCompiler(RememberingCompiler):
    """numba's compiler; kernels that can do without counting references do not count."""

    def define_pipelines(self) -> list[Any]:
        """numba's own, and what decides about the counts before the code is made."""
        (nopython,) = super().define_pipelines()
        nopython.add_pass_after(_StopCounting, AnnotateTypes)
        nopython.finalize()
        return [nopython]


@register_pass(mutates_CFG=False, analysis_only=True)
class _StopCounting(AnalysisPass):
    _name = "stop_counting_references"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        if _only_borrows(state):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
            state.targetctx.__dict__.pop("nrt", None)  # of the context that counts
        return False


def _only_borrows(state: Any) -> bool:
    """Whether all arrays of a function, whose types are known, are its arguments, parts or views of them."""

    def counted(name: str) -> bool:
        return _holds_references(state, state.typemap[name])

    def borrows(value: Any) -> bool:
        if not isinstance(value, ir.Expr) or value.op in _VIEWS:
            return True
        if value.op == "getitem":
            return not counted(value.index.name)  # a copy, where the index is an array
        if value.op == "call":
            named = guard(get_definition, state.func_ir, value.func)
            return getattr(named, "value", None) is scratch or isinstance(
                state.typemap[value.func.name], types.NamedTupleClass
            )
        return False

    if _holds_references(state, state.return_type):
        return False
    for block in state.func_ir.blocks.values():
        if any(block.find_insts((ir.DynamicRaise, ir.DynamicTryRaise))):  # a message with values is an object
            return False
        for assignment in block.find_insts(ir.Assign):
            if counted(assignment.target.name) and not borrows(assignment.value):
                return False
    return True


def _holds_references(state: Any, kind: Any) -> bool:
    """Whether values of a type keep something alive: arrays do, and tuples of them."""
    return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())
