"""Logarithm and exponential from additions, multiplications and one divide: the same bits wherever they are computed.

The C library, NumPy's vectors and another machine round ln x differently in the last digit. Least squares with
forgetting can amplify that digit without bound (a covariance that winds up breaks at the sample where rounding says),
so the compiled estimators compute both with the arithmetic that IEEE 754 determines to the last bit. Without branches
and tables, loops over them become vector instructions; interpreted they give the same.
"""

from __future__ import annotations

import struct
from typing import Any

from numba import types
from numba.extending import intrinsic, overload

from foretouch.core.compiling import compiled

__all__ = ["LARGEST_EXPONENT", "exponential", "logarithm"]

LARGEST_EXPONENT = 708.0
"""Arguments of the exponential count as at most this, and as at least minus this."""

ROOT_HALF_BITS = 0x3FE6A09E00000000  # of sqrt(1/2), rounded down
SHIFT = 0x3FF0000000000000 - ROOT_HALF_BITS
MANTISSA = 0x000FFFFFFFFFFFFF
TWO_52_BITS = 0x4330000000000000  # of 2^52: integers in its mantissa are read as numbers
TWO_52_AND_BIAS = 4503599627370496.0 + 1023.0
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # the first has 32 bits: k times it is exact
INVERSE_LN2 = 1.4426950408889634
ROUNDER = 6755399441055744.0 + 1023.0  # 1.5 * 2^52 + 1023: adding it rounds, and leaves k + 1023 in the lowest bits


@intrinsic  # type: ignore[untyped-decorator]
def _as_integer(_context: Any, _value: Any) -> Any:  # pragma: no cover - run by the compiler
    def generate(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _context.get_value_type(signature.return_type))

    return types.int64(types.float64), generate


@intrinsic  # type: ignore[untyped-decorator]
def _as_number(_context: Any, _bits: Any) -> Any:  # pragma: no cover - run by the compiler
    def generate(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _context.get_value_type(signature.return_type))

    return types.float64(types.int64), generate


def bits_of(value: float) -> int:
    """The 64 bits of a number as an integer."""
    bits: int = struct.unpack("<q", struct.pack("<d", value))[0]
    return bits


def number_of(bits: int) -> float:
    """The number of these 64 bits."""
    number: float = struct.unpack("<d", struct.pack("<q", bits))[0]
    return number


@overload(bits_of)
def _bits_of(value):  # type: ignore[no-untyped-def]  # pragma: no cover - run by the compiler
    return lambda value: _as_integer(value)


@overload(number_of)
def _number_of(bits):  # type: ignore[no-untyped-def]  # pragma: no cover - run by the compiler
    return lambda bits: _as_number(bits)


def _logarithm(x: float) -> float:
    shifted = bits_of(x) + SHIFT
    k = number_of((shifted >> 52) | TWO_52_BITS) - TWO_52_AND_BIAS
    f = number_of((shifted & MANTISSA) + ROOT_HALF_BITS) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = (2.0 / 3.0 + w * (2.0 / 7.0)) + (w * w) * ((2.0 / 11.0 + w * (2.0 / 15.0)) + (w * w) * (2.0 / 19.0))
    even = (2.0 / 5.0 + w * (2.0 / 9.0)) + (w * w) * (2.0 / 13.0 + w * (2.0 / 17.0))
    rest = z * odd + w * even
    half_square = 0.5 * f * f
    return (((s * (half_square + rest) + k * LN2_LOW) - half_square) + f) + k * LN2_HIGH


def _exponential(x: float) -> float:
    x = x if x > -LARGEST_EXPONENT else -LARGEST_EXPONENT
    x = x if x < LARGEST_EXPONENT else LARGEST_EXPONENT
    rounded = x * INVERSE_LN2 + ROUNDER
    k = rounded - ROUNDER
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 / 6.0 + r * (1.0 / 24.0)) + r2 * (1.0 / 120.0 + r * (1.0 / 720.0))
    middle = (1.0 / 5040.0 + r * (1.0 / 40320.0)) + r2 * (1.0 / 362880.0 + r * (1.0 / 3628800.0))
    high = (1.0 / 39916800.0 + r * (1.0 / 479001600.0)) + r2 * (1.0 / 6227020800.0 + r * (1.0 / 87178291200.0))
    tail = low + r4 * (middle + r4 * high)
    scale = number_of((bits_of(rounded) & 0x7FF) << 52)
    return (1.0 + (r + (0.5 * r2 + (r2 * r) * tail))) * scale


logarithm = compiled(error_model="numpy", forceinline=True)(_logarithm)
r"""ln x of a positive normal number, within one unit in the last place.

With :math:`x = 2^k (1 + f)`, :math:`1 + f` within :math:`\sqrt{1/2}` to :math:`\sqrt 2`, and :math:`s = f / (2 + f)`:
:math:`\ln x = k \ln 2 + 2\,(s + s^3/3 + s^5/5 + \dots)`, to the term of :math:`s^{19}`.
"""

exponential = compiled(error_model="numpy", forceinline=True)(_exponential)
r"""exp(x), within one unit in the last place; arguments count as within -708 to 708, NaN as -708.

With :math:`x = k \ln 2 + r`, :math:`2^k` times the series of :math:`e^r` to the term of :math:`r^{14}`.
"""
