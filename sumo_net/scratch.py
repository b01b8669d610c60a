"""Work space for kernels on the stack.

An array from numpy lies on the heap: it costs a call each time, and the compiler must take it that what is
written into one may be read in another. Small matrices of constant size on the stack it keeps in registers.
"""

import math
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

_BYTES = 8


def _scratch(_typing_context: Any, shape: Any) -> Any:
    """A float64 array, not filled, of a constant shape: a number or a tuple of them.

    For kernels alone. It is gone when the kernel ends, so it may not be given back, and a kernel has one for
    each place in its text that asks, also within a loop.
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
