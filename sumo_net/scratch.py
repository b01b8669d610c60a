"""Work space of kernels on the stack.

An array from numpy is on the heap: each allocation costs a call, and the compiler has to assume that arrays
may overlap. Small matrices of constant size on the stack are kept in registers.
"""

import math
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

_BYTES = 8


def _scratch(_typing_context: Any, shape: Any) -> Any:
    """An uninitialised float64 array of constant shape, an integer or a tuple of integers.

    Only for kernels. It ends with the kernel, so it must not be returned. Each call in the source stands for
    one array, also within a loop.
    """
    sizes = getattr(shape, "types", (shape,))
    if not all(isinstance(size, types.IntegerLiteral) for size in sizes):
        return None
    lengths = [size.literal_value for size in sizes]
    array = types.Array(types.float64, len(lengths), "C")

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        def number(value: int) -> Any:
            return context.get_constant(types.intp, value)

        double, count = context.get_data_type(types.float64), math.prod(lengths)
        made = make_array(array)(context, builder)
        populate_array(
            made,
            data=cgutils.alloca_once(builder, double, size=number(count)),
            shape=[number(length) for length in lengths],
            strides=[number(_BYTES * math.prod(lengths[i + 1 :])) for i in range(len(lengths))],
            itemsize=number(_BYTES),
            meminfo=None,
        )
        return made._getvalue()

    return array(shape), generate


scratch: Any = intrinsic(_scratch)
