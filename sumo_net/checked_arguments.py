"""Kernels whose wrappers check the types of the arguments themselves, in machine code.

At each call from Python, numba looks for the compiled version that fits the arguments, by the names and the
types of all fields of each NamedTuple: a tenth of a step at ten vehicles. Nearly all kernels of this project
have only one version. Their wrappers (what Python calls) raise TypeError, before anything is done, if an
argument is not exactly of the type that the version was compiled for. So they can be called directly.

Arguments so checked are converted without further checks. Results that are NamedTuples are made without their
constructors in Python, and without unpickling their classes at each call.

What is overridden here is not documented by numba. The places of fields in memory are those of the C
interfaces of CPython and numpy. Where they are others, this module raises ImportError.
"""

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.cpu import CPUContext
from numba.core.pythonapi import NativeValue, PythonAPI
from numba.core.typed_passes import AnnotateTypes
from numba.np import numpy_support

from sumo_net.borrowed_arrays import BorrowingCompiler

_POINTER, _BIT, _BYTE = ir.IntType(8).as_pointer(), ir.IntType(1), ir.IntType(8)
_INT, _LONG, _DOUBLE = ir.IntType(32), ir.IntType(64), ir.DoubleType()

# offsets in bytes within PyObject, PyFloatObject, PyTupleObject, PyArrayObject, PyArray_Descr
_TYPE = 8
_FLOAT_VALUE = 16
_TUPLE_SIZE, _TUPLE_ITEMS, _ITEM_BYTES = 16, 24, 8
_ARRAY_DIMENSIONS, _ARRAY_DTYPE, _ARRAY_FLAGS = 24, 56, 64
_DTYPE_ORDER, _DTYPE_NUMBER = 26, 28


def _read(address: int, offset: int, kind: Any) -> Any:
    return kind.from_address(address + offset).value


def _as_expected() -> bool:
    """Whether the fields of an object of each kind are where the offsets say."""
    pointer, size = ctypes.c_void_p, ctypes.c_ssize_t
    array = np.zeros((2, 3), ">i2")
    number, pair, dtype = 0.5, (None, array), array.dtype
    return (
        ctypes.sizeof(pointer) == _ITEM_BYTES
        and _read(id(number), _TYPE, pointer) == id(float)
        and _read(id(number), _FLOAT_VALUE, ctypes.c_double) == number
        and _read(id(pair), _TUPLE_SIZE, size) == len(pair)
        and _read(id(pair), _TUPLE_ITEMS + _ITEM_BYTES, pointer) == id(array)
        and _read(id(array), _ARRAY_DIMENSIONS, ctypes.c_int) == array.ndim
        and _read(id(array), _ARRAY_DTYPE, pointer) == id(dtype)
        and _read(id(array), _ARRAY_FLAGS, ctypes.c_int) == array.flags.num
        and _read(id(dtype), _DTYPE_ORDER, ctypes.c_char) == dtype.byteorder.encode()
        and _read(id(dtype), _DTYPE_NUMBER, ctypes.c_int) == dtype.num
    )


if not _as_expected():
    raise ImportError("objects are laid out in memory in another way")

# numpy's flags of an array
_C_ORDER, _FORTRAN_ORDER, _WRITEABLE = 0x1, 0x2, 0x400
_ORDERS = {"C": _C_ORDER, "F": _FORTRAN_ORDER, "A": 0}

_TUPLE: Any = types.BaseTuple  # the stubs of numba's types do not say what they contain
_NAMED_TUPLE: Any = types.BaseNamedTuple
_NUMBERS = {types.float64: (float, np.float64), types.int64: (int, np.int64)}  # what numba takes as such
_SINGLETONS = {types.boolean: (True, np.True_, False, np.False_), types.none: (None,)}


def checkable(kind: Any) -> bool:
    """Whether a wrapper can check that an argument is exactly of this type of numba's."""
    if isinstance(kind, _TUPLE):
        return all(map(checkable, kind))
    if isinstance(kind, types.Array):
        return isinstance(kind.dtype, types.Number | types.Boolean)
    return kind in _NUMBERS or kind in _SINGLETONS


def direct(dispatcher: Any) -> Callable[..., Any] | None:
    """The first compiled version of a kernel, if it checks its arguments itself."""
    for version in dispatcher.overloads.values():
        return version.entry_point if all(map(checkable, version.signature.args)) else None
    return None


class CheckingCompiler(BorrowingCompiler):
    """The compiler of kernels that check their arguments, where all of them are `checkable`."""

    def define_pipelines(self) -> list[Any]:
        """The pipeline of borrowing kernels, with a pass that says how wrappers convert arguments."""
        (nopython,) = super().define_pipelines()
        nopython.add_pass_after(_CheckArguments, AnnotateTypes)
        nopython.finalize()
        return [nopython]


@register_pass(mutates_CFG=False, analysis_only=True)
class _CheckArguments(AnalysisPass):
    _name = "check_arguments"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        if all(map(checkable, state.args)):
            state.targetctx = state.targetctx.subtarget()
            state.targetctx.__class__ = _Context
            state.targetctx.checked = state.args
        return False


class _Context(CPUContext):
    checked: tuple[Any, ...]  # types of the arguments

    def get_python_api(self, builder: Any) -> Any:
        return _Api(self.checked, self, builder)


class _Api(PythonAPI):
    """numba's code for conversions between objects and values; in a wrapper, after checks."""

    def __init__(self, arguments: tuple[Any, ...], context: Any, builder: Any) -> None:
        super().__init__(context, builder)
        self._kinds = arguments
        self._objects: tuple[Any, ...] = ()
        self._constants: Any = None  # of a wrapper; None elsewhere
        self._loaded: dict[int, Any] = {}  # references to constants, by their ids

    def unpack_tuple(self, args: Any, name: str, n_min: int, n_max: int, *objs: Any) -> Any:
        """As in numba; called at the beginning of a wrapper, and nowhere else."""
        self._objects = objs
        return super().unpack_tuple(args, name, n_min, n_max, *objs)

    def get_env_manager(self, env: Any, env_body: Any, env_ptr: Any) -> Any:
        """As in numba; called in a wrapper before the arguments are converted."""
        manager = super().get_env_manager(env, env_body, env_ptr)
        if self._objects:
            self._constants = manager
            other = self.builder.append_basic_block("other.type")
            for pointer, kind in zip(self._objects, self._kinds, strict=True):
                self._check(self.builder.load(pointer), kind, other)
            with self.builder.goto_block(other):
                self.err_set_string("PyExc_TypeError", "an argument has another type")
                self.builder.ret(self.get_null_object())
        return manager

    def to_native_value(self, typ: Any, obj: Any) -> Any:
        """The value of an object; in a wrapper, its type has been checked."""
        if self._constants is None:
            return super().to_native_value(typ, obj)
        return NativeValue(self._value(obj, typ))

    def from_native_value(self, typ: Any, val: Any, env_manager: Any = None) -> Any:
        """An object of a value."""
        if self._constants is None or not isinstance(typ, _NAMED_TUPLE):
            return super().from_native_value(typ, val, env_manager)
        parts = super().from_native_value(types.Tuple(tuple(typ)), val, env_manager)
        made = self.call_function_objargs(self._constant(_maker(typ.instance_class)), [parts])
        self.decref(parts)
        return made

    def serialize_object(self, obj: Any) -> Any:
        """What `unserialize` needs: in a wrapper, a constant's number instead of a pickle."""
        return super().serialize_object(obj) if self._constants is None else self._constants.add_const(obj)

    def unserialize(self, structptr: Any) -> Any:
        """A new reference to what was given to `serialize_object`."""
        if not isinstance(structptr, int):
            return super().unserialize(structptr)
        value = self._constants.read_const(structptr)
        self.incref(value)
        return value

    def _check(self, value: Any, kind: Any, other: Any) -> None:
        """Branch to the block `other` unless an object is of a type."""
        if kind in _SINGLETONS:
            self._require(self._is_any(value, _SINGLETONS[kind]), other)
        elif kind in _NUMBERS:
            self._require(self._is_any(self._class(value), _NUMBERS[kind]), other)
            if kind == types.int64:  # a larger one would be of another type
                self.long_as_longlong(value)
                self._require(self._same(self.err_occurred(), self.get_null_object()), other)
        elif isinstance(kind, types.Array):
            self._require(self.builder.call(self._fits(), self._asked_of_array(value, kind)), other)
        else:
            self._require(self._is_any(self._class(value), [getattr(kind, "instance_class", tuple)]), other)
            self._require(self._same(self._field(value, _TUPLE_SIZE, _LONG), _LONG(len(kind))), other)
            for place, part in enumerate(kind):
                self._check(self._item(value, place), part, other)

    def _asked_of_array(self, value: Any, kind: Any) -> list[Any]:
        """Arguments of `_fits`: the object, ndarray, and as what the type is known to numba."""
        dtype = numpy_support.as_dtype(kind.dtype)
        # an array in C's order may be in Fortran's as well, then numba says C
        either = _C_ORDER if kind.layout == "C" else _C_ORDER | _FORTRAN_ORDER
        flags = _ORDERS[kind.layout] | (_WRITEABLE if kind.mutable else 0)
        numbers = map(_INT, (kind.ndim, dtype.num, either | _WRITEABLE, flags))
        return [value, self._loaded_once(np.ndarray), *numbers, _BYTE(ord(dtype.byteorder))]

    def _fits(self) -> Any:
        """A function of the wrapper's module: whether an object is an array of a certain type."""
        name = "array_fits"
        if name in self.module.globals:
            return self.module.globals[name]
        takes = [_POINTER, _POINTER, _INT, _INT, _INT, _INT, _BYTE]
        function = ir.Function(self.module, ir.FunctionType(_BIT, takes), name)
        function.linkage = "internal"
        value, of, dimensions, number, mask, flags, order = function.args
        wrapper, self.builder = self.builder, ir.IRBuilder(function.append_basic_block())
        other = function.append_basic_block("other.type")
        self._require(self._inherits(self._class(value), of), other)
        dtype = self._field(value, _ARRAY_DTYPE, _POINTER)
        have = self.builder.and_(self._field(value, _ARRAY_FLAGS, _INT), mask)
        same = [
            self._same(self._field(value, _ARRAY_DIMENSIONS, _INT), dimensions),
            self._same(self._field(dtype, _DTYPE_NUMBER, _INT), number),
            self._same(self._field(dtype, _DTYPE_ORDER, _BYTE), order),
            self._same(have, flags),
        ]
        self.builder.ret(functools.reduce(self.builder.and_, same))
        with self.builder.goto_block(other):
            self.builder.ret(_BIT(0))
        self.builder = wrapper
        return function

    def _value(self, value: Any, kind: Any) -> Any:
        """The value of an object that is of a type."""
        if kind == types.float64:
            return self._field(value, _FLOAT_VALUE, _DOUBLE)
        if kind == types.int64:
            return self.long_as_longlong(value)
        if kind == types.boolean:
            return self._is_any(value, (True, np.True_))
        if kind == types.none:
            return self.context.get_dummy_value()
        if isinstance(kind, _TUPLE):
            parts = [self._value(self._item(value, place), part) for place, part in enumerate(kind)]
            return self.context.make_tuple(self.builder, kind, parts)
        made = self.context.make_array(kind)(self.context, self.builder)._getpointer()
        counted = self.context.enable_nrt
        adapt = self.nrt_adapt_ndarray_from_python if counted else self.numba_array_adaptor
        adapt(value, self.builder.bitcast(made, _POINTER))
        return self.builder.load(made)

    def _require(self, true: Any, other: Any) -> None:
        """Branch to the block `other` unless a bit is set."""
        after = self.builder.append_basic_block()
        self.builder.cbranch(true, after, other)
        self.builder.position_at_end(after)

    def _is_any(self, value: Any, options: Sequence[Any]) -> Any:
        same = [self._same(value, self._loaded_once(one)) for one in options]
        return functools.reduce(self.builder.or_, same)

    def _class(self, value: Any) -> Any:
        return self._field(value, _TYPE, _POINTER)

    def _inherits(self, one: Any, other: Any) -> Any:
        function = self._get_function(ir.FunctionType(_INT, [_POINTER, _POINTER]), "PyType_IsSubtype")
        return self.builder.trunc(self.builder.call(function, [one, other]), _BIT)

    def _same(self, one: Any, another: Any) -> Any:
        return self.builder.icmp_unsigned("==", one, another)

    def _item(self, value: Any, place: int) -> Any:
        return self._field(value, _TUPLE_ITEMS + _ITEM_BYTES * place, _POINTER)

    def _field(self, value: Any, offset: int, kind: Any) -> Any:
        place = self.builder.gep(value, [_LONG(offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def _loaded_once(self, value: Any) -> Any:
        """A borrowed reference to an object, for the beginning of a wrapper, which is always run."""
        if id(value) not in self._loaded:
            self._loaded[id(value)] = self._constant(value)
        return self._loaded[id(value)]

    def _constant(self, value: Any) -> Any:
        """A borrowed reference to an object."""
        return self._constants.read_const(self._constants.add_const(value))


@functools.cache
def _maker(of: type) -> Any:
    """Makes a NamedTuple of a tuple, as its `_make` does."""
    return functools.partial(tuple.__new__, of)
