"""Kernels without reference counting, where the caller holds the arrays while they run.

numba increments a reference count for every array that is taken from a NamedTuple, sliced or passed on, and
decrements it afterwards: atomic operations that make threads wait for each other. A kernel that neither
creates nor returns arrays does not need them; its arguments are cheaper to pass, too.
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
    """numba's compiler, without reference counting in kernels that do not need it."""

    def define_pipelines(self) -> list[Any]:
        """numba's own pipeline, with a pass that switches reference counting off before code generation."""
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
            state.targetctx.__dict__.pop("nrt", None)  # cached from the context with counting
        return False


def _only_borrows(state: Any) -> bool:
    """Whether all arrays of a typed function are its arguments, or parts or views of them."""

    def counted(name: str) -> bool:
        return _holds_references(state, state.typemap[name])

    def borrows(value: Any) -> bool:
        if not isinstance(value, ir.Expr) or value.op in _VIEWS:
            return True
        if value.op == "getitem":
            return not counted(value.index.name)  # indexing by an array makes a copy
        if value.op == "call":
            named = guard(get_definition, state.func_ir, value.func)
            return getattr(named, "value", None) is scratch or isinstance(
                state.typemap[value.func.name], types.NamedTupleClass
            )
        return False

    if _holds_references(state, state.return_type):
        return False
    for block in state.func_ir.blocks.values():
        if any(block.find_insts((ir.DynamicRaise, ir.DynamicTryRaise))):  # its message is a counted object
            return False
        for assignment in block.find_insts(ir.Assign):
            if counted(assignment.target.name) and not borrows(assignment.value):
                return False
    return True


def _holds_references(state: Any, kind: Any) -> bool:
    """Whether values of a type hold counted references, as arrays and tuples of them do."""
    return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())
