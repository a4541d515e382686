r"""How fast equation (20) can be on this machine: what a step waits for, measured.

From the covariance before a sample to that after it leads one chain in which each operation needs the one before:

.. math::
    q_i &= (P_{i0} + a P_{i1}) + (b P_{i2} + c P_{i3}) \\
    d &= ((\mu / w + q_0) + a q_1) + (b q_2 + c q_3) \\
    h &= \mu^{-1} / d, \qquad k_i = h q_i, \qquad P_{ij} \leftarrow \mu^{-1} P_{ij} - k_i q_j

That is a product, two sums; a product, two sums; a divide; a product; a product and a difference. A sum with a product
may be one fused multiply-add (FMA). So the least time of a sample is

- fused: 3 products, 3 FMAs, 2 sums and a divide,
- as compiled, without fusing: 4 products, 5 sums and a divide,

times the latency of each. Everything else (theta, residuals, the other elements of P) is beside this chain and can
overlap with it, as long as the processor has units to spare. On processors on which a sum is quicker than an FMA the
two are about the same, so nothing is lost by not fusing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from time import perf_counter
from typing import Any

from numba import types
from numba.extending import intrinsic, overload

from foretouch.core.compiling import compiled

__all__ = ["Latencies", "measure_latencies"]

LINKS = 200_000
ROUNDS = 15


@intrinsic  # type: ignore[untyped-decorator]
def _fuse(_context: Any, _a: Any, _b: Any, _c: Any) -> Any:  # pragma: no cover - run by the compiler
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def fused(a: float, b: float, c: float) -> float:
    """The sum a b + c; compiled it is rounded once."""
    return a * b + c


@overload(fused)
def _fused(a, b, c):  # type: ignore[no-untyped-def]  # pragma: no cover - run by the compiler
    return lambda a, b, c: _fuse(a, b, c)


def _sums(x: float, a: float, links: int) -> float:
    for _ in range(links):
        x = x + a
    return x


def _products(x: float, a: float, links: int) -> float:
    for _ in range(links):
        x = x * a
    return x


def _fmas(x: float, a: float, links: int) -> float:
    for _ in range(links):
        x = fused(x, a, 1e-9)
    return x


def _divides(x: float, a: float, links: int) -> float:
    for _ in range(links):
        x = a / x
    return x


Chain = Callable[[float, float, int], float]
CHAINS: tuple[Chain, ...] = tuple(compiled(error_model="numpy")(chain) for chain in (_sums, _products, _fmas, _divides))


@dataclass(frozen=True, slots=True)
class Latencies:
    """Nanoseconds from the operands of an operation to its result.

    Args:
        sum: Of an addition.
        product: Of a multiplication.
        fma: Of a fused multiply-add.
        divide: Of a division.
    """

    sum: float
    product: float
    fma: float
    divide: float

    @property
    def fused_bound(self) -> float:
        """Least time of a sample of (20) [ns] with fused multiply-adds."""
        return 3.0 * self.product + 3.0 * self.fma + 2.0 * self.sum + self.divide

    @property
    def unfused_bound(self) -> float:
        """Least time of a sample of (20) [ns] with products and sums as they are compiled."""
        return 4.0 * self.product + 5.0 * self.sum + self.divide


def measure_latencies(rounds: int = ROUNDS) -> Latencies:
    """Latencies of this machine: medians of compiled chains of 200,000 dependent operations, by turns.

    Args:
        rounds: How often each chain is timed.
    """
    times: list[list[float]] = [[] for _ in CHAINS]
    for chain in CHAINS:
        chain(1.0, 1.0000000001, 10)
    for _ in range(rounds):
        for chain, found in zip(CHAINS, times, strict=True):
            begin = perf_counter()
            chain(1.0, 1.0000000001, LINKS)
            found.append(1e9 * (perf_counter() - begin) / LINKS)
    return Latencies(*map(median, times))
