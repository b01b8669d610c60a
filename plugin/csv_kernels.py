"""Kernel of the tables' text: rows of CSV, as Arrow writes them."""

import numpy as np

from sumo_net.compile import kernel

NUMBER, WHOLE, FLAG, TEXT = range(4)
MOST_PARTS = 1e15  # up to here a decimal number is the shortest that names its float64
MOST_LETTERS = 24  # of what is no text
_LARGE, _SMALL = 1e10, 1e-6  # from here on, and under this, Arrow writes powers of ten
_COMMA, _POINT, _MINUS, _ZERO, _E, _LINE, _RETURN, _QUOTE = (np.uint8(ord(letter)) for letter in ',.-0e\n\r"')
_TRUE = np.frombuffer(b"true", np.uint8)
_FALSE = np.frombuffer(b"false", np.uint8)
_TEN = np.uint64(10)


@kernel
def _fill(out, at, value, count):  # type: ignore[no-untyped-def]
    """Write the last `count` digits of a value, uint64; where they end."""
    for k in range(at + count - 1, at - 1, -1):
        rest = value // _TEN
        out[k] = _ZERO + np.uint8(value - rest * _TEN)
        value = rest
    return at + count


@kernel
def _whole(out, at, value):  # type: ignore[no-untyped-def]
    """Write all digits of a value, uint64; where they end."""
    count, rest = 1, value // _TEN
    while rest > np.uint64(0):
        count += 1
        rest //= _TEN
    return _fill(out, at, value, count)


@kernel
def _with_power(out, at, parts, decimals):  # type: ignore[no-untyped-def]
    """Write parts / 10 ** decimals, under 1 and not 0, as 1.2e-7; where it ends."""
    while parts % _TEN == np.uint64(0):
        parts //= _TEN
        decimals -= 1
    end = _whole(out, at + 1, parts)  # a place further, the first digit goes before the point
    power = decimals - (end - at - 2)
    out[at] = out[at + 1]
    if end == at + 2:
        end = at + 1
    else:
        out[at + 1] = _POINT
    out[end], out[end + 1] = _E, _MINUS
    return _whole(out, end + 2, np.uint64(power))


@kernel
def _number(out, at, value, scale, decimals):  # type: ignore[no-untyped-def]
    """Write a number of whole parts of 1 / scale = 10 ** -decimals; where it ends, -1 if it is too large."""
    size = abs(value)
    if not (size < _LARGE and size * scale < MOST_PARTS):
        return -1
    if value < 0.0:
        out[at] = _MINUS
        at += 1
    parts = np.uint64(np.rint(size * scale))
    if 0.0 < size < _SMALL:
        return _with_power(out, at, parts, decimals)
    whole = parts // np.uint64(scale)
    at = _whole(out, at, whole)
    if decimals == 0:
        return at
    out[at] = _POINT
    at = _fill(out, at + 1, parts - whole * np.uint64(scale), decimals)
    while out[at - 1] == _ZERO:
        at -= 1
    return at - 1 if out[at - 1] == _POINT else at


@kernel
def write_rows(cells, out):  # type: ignore[no-untyped-def]
    """The text of Cells into `out`, of uint8; its length, or -1 where Arrow has to write it."""
    letters, at = cells.letters, 0
    quoted = False
    for k in range(len(letters)):
        quoted |= letters[k] == _COMMA or letters[k] == _QUOTE or letters[k] == _LINE or letters[k] == _RETURN
    if quoted:
        return -1
    for i in range(cells.known.shape[1]):
        for c in range(len(cells.kind)):
            kind, row = cells.kind[c], cells.place[c]
            if not cells.known[c, i]:
                pass
            elif kind == NUMBER:
                at = _number(out, at, cells.numbers[row, i], cells.scale[row], cells.decimals[row])
                if at < 0:
                    return -1
            elif kind == TEXT:
                first = cells.first[row]
                for k in range(first + cells.ends[row, i], first + cells.ends[row, i + 1]):
                    out[at] = letters[k]
                    at += 1
            elif kind == FLAG:
                for letter in _TRUE if cells.wholes[row, i] else _FALSE:
                    out[at] = letter
                    at += 1
            else:
                value = cells.wholes[row, i]
                if value < 0:
                    out[at] = _MINUS
                    at += 1
                at = _whole(out, at, np.uint64(abs(value)))
            out[at] = _COMMA
            at += 1
        out[at - 1] = _LINE
    return at
