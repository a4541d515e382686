"""A Gaussian process in kernel form, online, over a bounded set of samples (Csato and Opper 2002)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from designs.basis import LENGTH, Features
from designs.maps import alarmed, frame, ranges
from designs.presses import Array, Press
from numba import njit

from foretouch.identification.contact_map.prior import FEATURE_REACH, LEVEL, SIZE
from foretouch.models.contact_map.layout import BEYOND


@dataclass(frozen=True)
class Kernel:
    """The prior of the coarse map as a covariance of samples.

    Attributes:
        budget: Samples that are kept.
        features: Beside depth.
        noise: Standard deviation of the force; only its ratio to the prior matters.
        new: A sample is kept if what is kept already leaves so much variance of its force, in squares of the noise.
    """

    budget: int
    features: Features = field(default_factory=Features)
    noise: float = 1.0
    new: float = 0.1

    def predict(self, press: Press) -> tuple[Array, float]:
        """The late prediction at every sample [N], and the cost of an update [us]."""
        place, force, learnt_at = frame(press)
        values = self.features.of(press, place)
        inputs = np.ascontiguousarray(np.vstack((place / LENGTH, values)).T)
        begin = perf_counter()
        basis, weights, begun = _learn(
            inputs[learnt_at],
            force[learnt_at],
            press.in_contact[learnt_at],
            self.budget,
            self.noise**2,
            self.new,
        )
        cost = 1e6 * (perf_counter() - begin) / max(learnt_at.size, 1)
        late = press.late
        newest = np.searchsorted(learnt_at, late, "right") - 1
        seen = np.maximum(newest, 0)
        deepest, low, high = (column[seen].T for column in ranges(place[learnt_at], values[:, learnt_at].T, begun))
        held = np.clip(values, low, high)
        zero = (press.offset - press.offset[press.begin])[np.maximum(late, press.begin)]
        surface = (press.surface - press.surface[press.begin])[np.maximum(late, press.begin)]
        step = 0.25 * LENGTH

        def at(where: Array) -> Array:
            asked = np.ascontiguousarray(np.vstack((where / LENGTH, held)).T)
            return np.asarray(np.maximum(_ask(asked, inputs[learnt_at], basis, weights, seen) - zero, 0.0))

        predicted = at(np.minimum(place, deepest))
        chord = predicted / np.maximum(deepest - surface, step)
        slope = np.clip((predicted - at(np.minimum(place, deepest - step))) / step, chord, BEYOND * chord)
        predicted = predicted + np.maximum(place - deepest, 0.0) * slope
        return np.where(newest >= 1, predicted, 0.0), cost


@njit(cache=True)
def _covariance(one: Array, other: Array) -> float:
    """Of the forces at two samples: depth, then features."""
    x, y = one[0], other[0]
    value = LEVEL**2 + SIZE**2 * x * y
    if x * y > 0.0:
        near, far = min(abs(x), abs(y)), max(abs(x), abs(y))
        value += SIZE**2 * near * near * (3.0 * far - near) / 6.0
    products = 0.0
    for k in range(1, one.size):
        products += one[k] * other[k]
    return value + SIZE**2 * products * math.exp(-0.5 * ((x - y) / FEATURE_REACH) ** 2)


@njit(cache=True)
def _learn(
    inputs: Array, force: Array, in_contact: np.ndarray, budget: int, noise: float, least_new: float
) -> tuple[np.ndarray, Array, np.ndarray]:
    """Kept samples and their weights after each sample, both of shape (n, budget), -1 where there are fewer; and the
    sample where the process was begun."""
    size = budget + 1
    alpha, c, q = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    kept, used = np.full(size, -1), 0
    all_kept, all_alpha = np.full((force.size, budget), -1), np.zeros((force.size, budget))
    k, s, e = np.zeros(size), np.zeros(size), np.zeros(size)
    begun, alarm, deepest = np.zeros(force.size, np.int64), np.zeros(3), -math.inf
    for index in range(force.size):
        here = inputs[index]
        own = _covariance(here, here)
        mean = 0.0
        for i in range(used):
            k[i] = _covariance(inputs[kept[i]], here)
            mean += alpha[i] * k[i]
        if index:
            begun[index] = begun[index - 1]
        if in_contact[index] and alarmed(alarm, force[index] - mean, force[index]) and here[0] <= deepest:
            alpha[:], c[:], q[:], kept[:], used, mean = 0.0, 0.0, 0.0, -1, 0, 0.0
            alarm[:], deepest, begun[index] = 0.0, -math.inf, index
        deepest = max(deepest, here[0])
        variance, new = own, own
        for i in range(used):
            s[i] = e[i] = 0.0
            for j in range(used):
                s[i] += c[i, j] * k[j]
                e[i] += q[i, j] * k[j]
            variance += k[i] * s[i]
            new -= k[i] * e[i]
        first, second = (force[index] - mean) / (noise + variance), -1.0 / (noise + variance)
        if new < least_new * noise:  # what is kept says the same
            for i in range(used):
                s[i] += e[i]
        else:
            kept[used], s[used], e[used] = index, 1.0, -1.0
            used += 1
            for i in range(used):
                for j in range(used):
                    q[i, j] += e[i] * e[j] / new
        for i in range(used):
            alpha[i] += first * s[i]
            for j in range(used):
                c[i, j] += second * s[i] * s[j]
        if used > budget:
            least, out = math.inf, 0
            for i in range(used):
                worth = abs(alpha[i]) / q[i, i]
                if worth < least:
                    least, out = worth, i
            used -= 1
            _leave(alpha, c, q, kept, out, used)
        for i in range(used):
            all_kept[index, i], all_alpha[index, i] = kept[i], alpha[i]
    return all_kept, all_alpha, begun


@njit(cache=True)
def _leave(alpha: Array, c: Array, q: Array, kept: np.ndarray, out: int, last: int) -> None:
    """Leave one sample out, such that the process changes least; the last one takes its place."""
    alpha[out], alpha[last] = alpha[last], alpha[out]
    kept[out], kept[last] = kept[last], -1
    for matrix in (c, q):
        for i in range(last + 1):
            matrix[out, i], matrix[last, i] = matrix[last, i], matrix[out, i]
        for i in range(last + 1):
            matrix[i, out], matrix[i, last] = matrix[i, last], matrix[i, out]
    weight, own_c, own_q = alpha[last], c[last, last], q[last, last]
    for i in range(last):
        alpha[i] -= weight * q[last, i] / own_q
        for j in range(last):
            c[i, j] += (
                own_c * q[last, i] * q[last, j] / own_q**2 - (q[last, i] * c[last, j] + c[last, i] * q[last, j]) / own_q
            )
    for i in range(last):
        for j in range(last):
            q[i, j] -= q[last, i] * q[last, j] / own_q
    alpha[last] = 0.0
    c[last, : last + 1] = 0.0
    c[: last + 1, last] = 0.0
    q[last, : last + 1] = 0.0
    q[: last + 1, last] = 0.0


@njit(cache=True)
def _ask(asked: Array, inputs: Array, basis: np.ndarray, weights: Array, newest: np.ndarray) -> Array:
    """What was known at each sample says of it."""
    force = np.zeros(asked.shape[0])
    for index in range(asked.shape[0]):
        known = newest[index]
        for i in range(basis.shape[1]):
            if basis[known, i] < 0:
                break
            force[index] += weights[known, i] * _covariance(inputs[basis[known, i]], asked[index])
    return force
