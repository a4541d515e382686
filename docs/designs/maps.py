"""A map over depth and features in weight space, by recursive least squares, with every choice open."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from designs.basis import LENGTH, Features, alike, knots, smooth, splines
from designs.presses import Array, Press
from numba import njit

from foretouch.identification.contact_map.learning import PERIOD
from foretouch.identification.exact.belief import DRIFT
from foretouch.models.contact_map.layout import BEYOND, COARSENESS

FADE_EVERY = 0.1
"""Time in contact after which the covariance goes back towards the prior [s]."""


@dataclass(frozen=True)
class Map:
    """One design.

    Attributes:
        features: Beside depth.
        length: Scale of everything [m].
        spacing: Of the knots of the elastic part [length]; those of the features are COARSENESS times as far apart.
        ridge: None for the smooth priors, else the standard deviation of every weight, all independent.
        noise: Standard deviation of the force; only its ratio to the priors matters.
        forgetting: Factor of the exponential forgetting, each update.
        inflation: Each second in contact the covariance goes so far back towards the prior.
        restart: Whether to begin anew where the error is too large for too long (`alarmed`).
        beyond: Deeper than ever: "held" (along the last slope, held between the chord from the surface and BEYOND
            times that), "tangent" (along the last slope), "chord" (in proportion), "clamp" (as at the deepest), "prior"
            (as the weights say).
        clamp_features: Whether features count within their range so far.
        gain: Whether the output is multiplied by what the late predictions of the last second lacked.
        whole: Predict everything from what is known at the end: not causal, a floor.
    """

    features: Features = field(default_factory=Features)
    length: float = LENGTH
    spacing: float = 1.0
    ridge: float | None = None
    noise: float = 1.0
    forgetting: float = 1.0
    inflation: float = DRIFT**2
    restart: bool = True
    beyond: str = "held"
    clamp_features: bool = True
    gain: bool = False
    whole: bool = False

    def predict(self, press: Press) -> tuple[Array, float]:
        """The late prediction at every sample [N], and the cost of an update [us]."""
        place, force, learnt_at = frame(press)
        values = self.features.of(press, place, self.length)
        rows = self._rows(place[learnt_at], values[:, learnt_at])
        begin = perf_counter()
        weights, begun = _learn(
            rows,
            force[learnt_at],
            place[learnt_at],
            press.in_contact[learnt_at],
            self._prior(),
            self.noise,
            self.forgetting,
            self.inflation,
            self.restart,
        )
        cost = 1e6 * (perf_counter() - begin) / max(learnt_at.size, 1)
        late = press.late
        newest = np.searchsorted(learnt_at, late, "right") - 1  # of the updates known at each sample
        known = newest >= 1
        if self.whole:
            newest, late = np.full(late.size, learnt_at.size - 1), np.full(late.size, late.size - 1)
        newest, late = np.maximum(newest, 0), np.maximum(late, press.begin)
        deepest, low, high = (column[newest].T for column in ranges(place[learnt_at], values[:, learnt_at].T, begun))
        if self.clamp_features:
            values = np.clip(values, low, high)
        zero = (press.offset - press.offset[press.begin])[late]

        def at(where: Array) -> Array:
            return np.maximum(np.einsum("ij,ij->i", self._rows(where, values), weights[newest]) - zero, 0.0)

        surface = press.surface[late] - press.surface[press.begin]
        predicted = np.where(known, self._beyond(at, place, deepest, surface), 0.0)
        return (_corrected(press, predicted) if self.gain else predicted), cost

    def _rows(self, place: Array, values: Array) -> Array:
        """Regressors, shape (n, number of weights)."""
        wide = splines(place / self.length, COARSENESS * self.spacing)
        columns = [splines(place / self.length, self.spacing), *(wide * value[:, None] for value in values)]
        return np.ascontiguousarray(np.concatenate(columns, axis=1))

    def _prior(self) -> Array:
        """Covariance of the weights before the first sample."""
        near, far = knots(self.spacing), knots(COARSENESS * self.spacing)
        count = self._rows(np.zeros(1), np.zeros((self._features(), 1))).shape[1]
        if self.ridge is not None:
            return self.ridge**2 * np.eye(count)
        covariance = np.zeros((count, count))
        covariance[: near.size, : near.size] = smooth(near, near)
        for feature in range(self._features()):
            begin = near.size + feature * far.size
            part = slice(begin, begin + far.size)
            covariance[part, part] = alike(far, far) + 1e-9 * np.eye(far.size)
        return covariance

    def _features(self) -> int:
        chosen = self.features
        return int(chosen.velocity) + int(chosen.acceleration) + len(chosen.plays) + len(chosen.averages)

    def _beyond(self, at: object, place: Array, deepest: Array, surface: Array) -> Array:
        """The force, also deeper than ever."""
        assert callable(at)
        if self.beyond == "prior":
            return np.asarray(at(place))
        step = 0.25 * self.length
        force = np.asarray(at(np.minimum(place, deepest)))
        chord = force / np.maximum(deepest - surface, step)
        if self.beyond == "clamp":
            return force
        if self.beyond == "chord":
            slope = chord
        else:
            slope = (force - at(np.minimum(place, deepest - step))) / step
            slope = np.maximum(slope, 0.0) if self.beyond == "tangent" else np.clip(slope, chord, BEYOND * chord)
        return np.asarray(force + np.maximum(place - deepest, 0.0) * slope)


def frame(press: Press) -> tuple[Array, Array, np.ndarray]:
    """Place from the first surface [m], force as the sensor gives it from the first zero [N], indices learnt from."""
    place = press.recording.position - press.surface[press.begin]
    force = press.recording.force - press.offset[press.begin]
    step = max(1, round(PERIOD / press.period))
    return place, force, np.arange(press.begin, place.size, step)


def _corrected(press: Press, predicted: Array) -> Array:
    """Multiplied by the ratio of felt to predicted force over the last second that was known."""
    fading = np.exp(-press.period)
    gain, felt, said = np.ones(predicted.size), 0.1, 0.1
    force = press.force
    for index in range(predicted.size):
        if press.in_contact[index] and predicted[index] > 0.0:
            felt = fading * felt + press.period * force[index] * predicted[index]
            said = fading * said + press.period * predicted[index] ** 2
        gain[index] = np.clip(felt / said, 0.5, 2.0)
    return np.asarray(predicted * gain[np.maximum(press.late, 0)])


@njit(cache=True)
def ranges(place: Array, values: Array, begun: np.ndarray) -> tuple[Array, Array, Array]:
    """Deepest place, smallest and largest features (zero among them) since the design began anew, sample by sample."""
    deepest, low, high = np.empty(place.size), np.zeros(values.shape), np.zeros(values.shape)
    for index in range(place.size):
        first = index == begun[index]
        deepest[index] = place[index] if first else max(deepest[index - 1], place[index])
        for k in range(values.shape[1]):
            value = values[index, k]
            low[index, k] = min(0.0 if first else low[index - 1, k], value)
            high[index, k] = max(0.0 if first else high[index - 1, k], value)
    return deepest, low, high


@njit(cache=True)
def _learn(
    rows: Array,
    force: Array,
    place: Array,
    in_contact: np.ndarray,
    prior: Array,
    noise: float,
    forgetting: float,
    inflation: float,
    restart: bool,
) -> tuple[Array, np.ndarray]:
    """Weights after each sample, shape (n, number of weights), and the sample where they were begun."""
    count, size = rows.shape
    covariance, weights = prior.copy(), np.zeros(size)
    kept, begun = np.empty((count, size)), np.zeros(count, np.int64)
    alarm, deepest, faded = np.zeros(3), -np.inf, 0.0
    for index in range(count):
        error = _fit(rows[index], force[index], covariance, weights, noise * noise * forgetting)
        if index:
            begun[index] = begun[index - 1]
        changed = in_contact[index] and alarmed(alarm, error, force[index])
        if changed and restart and place[index] <= deepest:
            covariance[:] = prior
            weights[:], alarm[:] = 0.0, 0.0
            _fit(rows[index], force[index], covariance, weights, noise * noise)
            deepest, begun[index] = -np.inf, index
        deepest = max(deepest, place[index])
        if forgetting < 1.0:
            covariance /= forgetting
        if in_contact[index]:
            faded += PERIOD
        if faded >= FADE_EVERY and inflation > 0.0:
            covariance += inflation * faded * (prior - covariance)
            faded = 0.0
        kept[index] = weights
    return kept, begun


ALARM_SHARE, ALARM_TIME, ALARM_FROM = 0.25, 0.05, 0.5
"""Share of the peak, time over which errors are averaged, and time in contact before the first alarm [-, s, s]."""


@njit(cache=True)
def alarmed(alarm: Array, error: float, force: float) -> bool:
    """Whether the recent error in contact is too large a share of the peak.

    `alarm` holds the mean squared error, the peak and the time in contact.
    """
    alarm[0] += (1.0 - np.exp(-PERIOD / ALARM_TIME)) * (error * error - alarm[0])
    alarm[1] = max(alarm[1], force)
    alarm[2] += PERIOD
    return bool(alarm[2] > ALARM_FROM and alarm[0] > (ALARM_SHARE * alarm[1]) ** 2)


@njit(cache=True)
def _fit(row: Array, force: float, covariance: Array, weights: Array, noise: float) -> float:
    """Recursive least squares, one sample, in place; returns the error before."""
    size = row.size
    active, gain = np.flatnonzero(row), np.zeros(size)
    error, variance = force, noise
    for i in active:
        error -= row[i] * weights[i]
        for j in range(size):
            gain[j] += row[i] * covariance[i, j]
    for i in active:
        variance += row[i] * gain[i]
    for i in range(size):
        share = gain[i] / variance
        weights[i] += share * error
        for j in range(size):
            covariance[i, j] -= share * gain[j]
    return error
