r"""The press that benchmarks identify, and what ours is held against: peers, the processor's bound and plain loops.

The press goes in and out at constant speed, so that the paper's mu is one number. The plain loops are compiled, written
as anybody would, and many recordings at once in NumPy, every operation over all streams. Recursive least squares are by
padasip, filterpy and river.

The peers all begin at theta_0 = 0 and P_0 = p I and forget by the same constant mu, as the paper's (20) without its
perturbation. Each is given a sample a call, which is what its interface has. What each calls these differs:

- padasip `FilterRLS`: `mu`, and `eps` = 1 / p.
- filterpy `KalmanFilter`: a state that stays, F = I and Q = 0, with fading memory alpha^2 = 1 / mu and R = mu. Its
  prediction comes first and divides P by mu, so that P begins at mu p I.
- river `BayesianLinearRegression`: `smoothing` = mu weights a sample by (1 - mu) beta, so beta = 1 / (1 - mu); its
  prior with smoothing is I / `alpha` as a precision, so alpha = p. It inverts a matrix in each step. Without smoothing,
  mu = 1, it does not: then beta = 1, and its prior is I / alpha as a covariance, so alpha = 1 / p. It learns alone,
  `learn_one`, without a prediction before.

The bound says how fast equation (20) can be on this machine, from what a step waits for. From the covariance before a
sample to that after it leads one chain in which each operation needs the one before:

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

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic, overload

from foretouch.bench.timing import Array
from foretouch.core.compiling import compiled
from foretouch.errors import install_command
from foretouch.identification import ContactSample, FPRLSOptions
from foretouch.identification.linear.estimators import by_distance

PERIOD, SPEED, SHALLOWEST, DEEPEST = 1e-3, 0.02, 2e-3, 10e-3
"""Time between samples [s], speed of the probe [m/s], and its depths [m]."""

STIFFNESS, DAMPING, EXPONENT = 2000.0, 100.0, 1.4
"""Parameters of the Hunt-Crossley law that is pressed: k [N/m^n], lambda [N s/m^(n+1)], n."""

INITIAL_COVARIANCE = 1e6  # P_0 = this times I, the paper's, for ours and for the peers

OPTIONS = FPRLSOptions(initial_covariance=INITIAL_COVARIANCE, perturbation=0.0)
"""Options without the self-perturbing test, which no peer has."""

FORGETTING_FACTOR = by_distance(OPTIONS.forgetting_rate).factor(SPEED * PERIOD)  # The paper's mu at this speed


class Press(NamedTuple):
    """Conditioned columns of a press, each of shape (n,): time [s], depth [m], velocity [m/s] and force [N]."""

    time: Array
    depth: Array
    velocity: Array
    force: Array


class Problem(NamedTuple):
    """The same press as a linear problem, which the peers are given ready-made: theta from Phi and ln F.

    Regressors are (1, ln x, v, v / x), shape (n, 4), and targets ln F, shape (n,).
    """

    regressors: Array
    targets: Array

    @classmethod
    def of(cls, pressed: Press) -> Problem:
        """The linearised law (18) on a press."""
        depth, velocity = pressed.depth, pressed.velocity
        return cls(
            np.column_stack([np.ones_like(depth), np.log(depth), velocity, velocity / depth]), np.log(pressed.force)
        )


def press(size: int, deepest: float = DEEPEST, noise: float = 0.01) -> Press:
    """A press of a Hunt-Crossley material, in and out between 2 mm and the deepest [m], at 20 mm/s and 1 kHz.

    It has `size` samples; the noise is a standard deviation of ln F.
    """
    time: Array = PERIOD * np.arange(size, dtype=np.float64)
    phase = np.mod(SPEED * time / (deepest - SHALLOWEST), 2.0)
    depth = SHALLOWEST + (deepest - SHALLOWEST) * np.where(phase < 1.0, phase, 2.0 - phase)
    velocity: Array = np.where(phase < 1.0, SPEED, -SPEED)
    errors = noise * np.random.default_rng(0).standard_normal(size)
    force: Array = np.exp(errors) * depth**EXPONENT * (STIFFNESS + DAMPING * velocity)
    return Press(time, depth, velocity, force)


def samples(pressed: Press) -> list[ContactSample]:
    """What `update` takes, one a sample."""
    columns = [column.tolist() for column in pressed]
    return [ContactSample(time, depth, speed, force, True) for time, depth, speed, force in zip(*columns, strict=True)]


@compiled(allocates=True)
def _recursion(regressors: Array, targets: Array, forgetting_factor: float, initial_covariance: float) -> Array:
    """Equation (20) with a constant mu, loop by loop over whole matrices."""
    samples, size = regressors.shape
    theta = np.zeros(size)
    covariance = initial_covariance * np.eye(size)
    projected = np.empty(size)
    for k in range(samples):
        innovation, denominator = targets[k], forgetting_factor
        for i in range(size):
            innovation -= regressors[k, i] * theta[i]
            total = 0.0
            for j in range(size):
                total += covariance[i, j] * regressors[k, j]
            projected[i] = total
            denominator += regressors[k, i] * total
        for i in range(size):
            gain = projected[i] / denominator
            theta[i] += gain * innovation
            for j in range(size):
                covariance[i, j] = (covariance[i, j] - gain * projected[j]) / forgetting_factor
    return theta


def recursion_over(problem: Problem) -> Array:
    """Theta after a whole problem, shape (4,), from theta_0 = 0, with the constants of this module."""
    return _recursion(problem.regressors, problem.targets, FORGETTING_FACTOR, INITIAL_COVARIANCE)


@compiled
def bare_call(state: Array, one: float, other: float, third: float, fourth: float) -> int:
    """A compiled call with an array and four numbers that does next to nothing: what any call from Python costs."""
    state[0] += one * other + third * fourth
    return 1


@compiled
def _enlarge(matrix: Array, vector: Array, rounds: int) -> None:
    for _ in range(rounds):
        for i in range(vector.size):
            for j in range(vector.size):
                matrix[i, j] += vector[i] * vector[j]


def rank_one_updates(rounds: int) -> Array:
    """Sum of as many outer products of 256 numbers as there are rounds, shape (256, 256).

    That is half a megabyte that is read and written, as a covariance's is. Code that shares a cache with other programs
    becomes slower with them, where small loops do not: it is held against this.
    """
    matrix = np.zeros((256, 256))
    _enlarge(matrix, np.linspace(0.0, 1.0, 256), rounds)
    return matrix


def recursion_over_many(regressors: Array, targets: Array, forgetting_factor: Array) -> Array:
    """Theta of n streams by equation (20) without its perturbation, shape (n, 4), from theta_0 = 0 and P_0 = p I.

    Regressors Phi have shape (m, 4, n), streams innermost, as it is fastest; targets ln F and mu have shape (m, n).
    """
    _, size, streams = regressors.shape
    theta = np.zeros((size, streams))
    covariance = np.zeros((size, size, streams))
    covariance[range(size), range(size)] = INITIAL_COVARIANCE
    for regressor, target, mu in zip(regressors, targets, forgetting_factor, strict=True):
        projected = (covariance * regressor).sum(axis=1)
        gain = projected / (mu + (regressor * projected).sum(axis=0))
        theta += gain * (target - (regressor * theta).sum(axis=0))
        covariance -= gain[:, None] * projected
        covariance /= mu
    return theta.T


Peer = Callable[[], Array]
"""Runs the whole problem from the beginning and returns the last theta, shape (4,)."""

RIVER_WITHOUT_FORGETTING = "river, mu = 1"  # River as it is fastest


def _padasip(problem: Problem) -> Peer:
    padasip = _import("padasip")

    def run() -> Array:
        filtered = padasip.filters.FilterRLS(4, mu=FORGETTING_FACTOR, eps=1.0 / INITIAL_COVARIANCE, w="zeros")
        for regressor, target in zip(problem.regressors, targets, strict=True):
            filtered.adapt(target, regressor)
        return np.array(filtered.w)

    targets = problem.targets.tolist()
    return run


def _filterpy(problem: Problem) -> Peer:
    kalman = _import("filterpy.kalman")

    def run() -> Array:
        filtered = kalman.KalmanFilter(dim_x=4, dim_z=1)
        filtered.x, filtered.P = np.zeros((4, 1)), np.eye(4) * INITIAL_COVARIANCE * FORGETTING_FACTOR
        filtered.F, filtered.Q, filtered.R = np.eye(4), np.zeros((4, 4)), np.array([[FORGETTING_FACTOR]])
        filtered.alpha = FORGETTING_FACTOR**-0.5
        for row, target in zip(rows, targets, strict=True):
            filtered.predict()
            filtered.update(target, H=row)
        return np.array(filtered.x).ravel()

    rows, targets = list(problem.regressors[:, None, :]), problem.targets.tolist()
    return run


def _river(problem: Problem, forgetting_factor: float = FORGETTING_FACTOR) -> Peer:
    linear_model = _import("river.linear_model")
    if forgetting_factor < 1.0:
        beta, alpha, smoothing = 1.0 / (1.0 - forgetting_factor), INITIAL_COVARIANCE, forgetting_factor
    else:
        beta, alpha, smoothing = 1.0, 1.0 / INITIAL_COVARIANCE, None

    def run() -> Array:
        learner = linear_model.BayesianLinearRegression(alpha=alpha, beta=beta, smoothing=smoothing)
        for row, target in zip(rows, targets, strict=True):
            learner.learn_one(row, target)
        # theta_i is the prediction of the unit vector i.
        return np.array([learner.predict_one({name: float(name == one) for name in names}) for one in names])

    names = range(problem.regressors.shape[1])
    rows = [dict(zip(names, row, strict=True)) for row in problem.regressors.tolist()]
    targets = problem.targets.tolist()
    return run


PEERS: dict[str, Callable[[Problem], Peer]] = {
    "padasip": _padasip,
    "filterpy": _filterpy,
    "river": _river,
    RIVER_WITHOUT_FORGETTING: lambda problem: _river(problem, 1.0),
}
"""The peers by name."""


def peer(name: str, problem: Problem, say: Callable[[str], None]) -> Peer | None:
    """A peer of `PEERS` on a problem; None where its package is not installed, which one line reports."""
    try:
        return PEERS[name](problem)
    except ImportError as error:
        package = name.partition(",")[0]
        say(f"{package} is left out ({error}): {install_command('bench')}")
        return None


def _import(name: str) -> Any:
    with warnings.catch_warnings():  # of their own house
        warnings.simplefilter("ignore")
        return importlib.import_module(name)


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
    """Nanoseconds from the operands of a sum, a product, a fused multiply-add and a division to its result."""

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
    """Latencies of this machine: medians over rounds of compiled chains of 200,000 dependent operations, by turns."""
    times: list[list[float]] = [[] for _ in CHAINS]
    for chain in CHAINS:
        chain(1.0, 1.0000000001, 10)
    for _ in range(rounds):
        for chain, result in zip(CHAINS, times, strict=True):
            begin = perf_counter()
            chain(1.0, 1.0000000001, LINKS)
            result.append(1e9 * (perf_counter() - begin) / LINKS)
    return Latencies(*map(median, times))
