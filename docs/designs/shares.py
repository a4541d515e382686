"""Experts in one force: the shipped ones, each learnt alone, and several ways to give them shares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter

import numpy as np
from designs.presses import Array, Press
from scipy.optimize import nnls

from foretouch.identification import ContactSample, Learner, predict
from foretouch.identification.conditioning.kernel import PEAK_SHARE
from foretouch.identification.contact_map.bank import EXPERT_NAMES, ContactMap
from foretouch.identification.contact_map.learning import PERIOD
from foretouch.identification.contact_map.scores import PENALTY
from foretouch.identification.exact.belief import FIRST_ERROR, LEARNING_TIME, YOUNG

SHARPNESS = 8.0  # Power of the inverse error in the shipped weights


@dataclass(frozen=True)
class Shipped:
    """The package's own learner, through the same code as `foretouch predict`.

    Attributes:
        experts: Those that are asked.
        told: Whether the zero of the force is given where a recording never leaves the material.
    """

    experts: Sequence[str] = EXPERT_NAMES
    told: bool = True

    def predict(self, press: Press) -> tuple[Array, float]:
        """The late prediction at every sample [N], and the cost of learning [us an update, with the law's own]."""
        return _alone(press, tuple(self.experts), press.delay, self.told), self._cost(press)

    def _cost(self, press: Press) -> float:
        recording, estimator = press.recording, ContactMap(experts=self.experts)
        depth, force = recording.position - press.surface, press.force
        columns = (recording.time, depth, press.velocity, force, press.in_contact)
        samples = [ContactSample(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]
        begin = perf_counter()
        for sample in samples:
            estimator.update(sample)
        return 1e6 * (perf_counter() - begin) / max(estimator.updates, 1)


@lru_cache(maxsize=32)
def _alone(press: Press, experts: tuple[str, ...], delay: float, told: bool = True) -> Array:
    """Prediction of some experts of the shipped learner [N]."""
    recording = press.recording
    learner = Learner(
        ContactMap(experts=experts),
        force_offset=press.zero if press.zero_given and told else None,
        contact_floor=recording.contact_floor,
    )
    return predict(recording, learner, delay=delay).force


@dataclass(frozen=True)
class Shares:
    """The shipped experts, each alone, in shares that are computed here.

    Attributes:
        rule: "power" (of the inverse error), "equal", or "stacked" (non-negative least squares, which need not sum
            to one).
        power: Of the first rule.
        late: Whether late predictions are scored, or those one update ahead.
        duration: Over which errors count [s].
    """

    rule: str = "power"
    power: float = SHARPNESS
    late: bool = True
    duration: float = LEARNING_TIME

    def predict(self, press: Press) -> tuple[Array, float]:
        """The late prediction at every sample [N]; its cost is that of the experts."""
        forces = np.array([_alone(press, (name,), press.delay) for name in EXPERT_NAMES])
        scored = forces if self.late else np.array([_alone(press, (name,), PERIOD) for name in EXPERT_NAMES])
        late = press.late
        shares = {"power": self._power, "equal": self._equal, "stacked": self._stacked}[self.rule](press, scored)
        return np.where(late >= 0, np.einsum("ij,ij->j", forces, shares[:, np.maximum(late, 0)]), 0.0), math.nan

    def _equal(self, press: Press, scored: Array) -> Array:
        return np.full(scored.shape, 1.0 / len(scored))

    def _errors(self, press: Press, scored: Array) -> tuple[Array, Array]:
        """Which samples are scored, and what each expert said there less what was felt [N], zero elsewhere.

        Those in contact, or predicted to be, at places that had been visited and after enough time in contact when the
        prediction was made.
        """
        late, seconds = np.maximum(press.late, 0), np.cumsum(press.in_contact) * press.period
        deepest = np.fmax.accumulate(np.where(np.isnan(press.surface), np.nan, press.recording.position))
        peak = np.maximum.accumulate(np.where(press.in_contact, press.force, 1e-3))
        used = press.in_contact | (scored.max(axis=0) > PEAK_SHARE * peak)
        used &= (seconds[late] >= YOUNG) & (press.recording.position <= deepest[late])
        return used, np.where(used, scored - press.force, 0.0)

    def _power(self, press: Press, scored: Array) -> Array:
        """As the shipped learner weighs law and maps: penalties, and what is assumed at first; the maps alike."""
        used, errors = self._errors(press, scored)
        seconds = np.cumsum(press.in_contact) * press.period
        peak = np.maximum.accumulate(np.where(press.in_contact, press.force, 1e-3))
        first = YOUNG * np.exp(-seconds / YOUNG)
        scored_for = _fading(used * press.period, used, press.period, self.duration)
        worth = np.empty(scored.shape)
        for expert, penalty in enumerate((PENALTY, 1.0, PENALTY)):
            summed = _fading(errors[expert] ** 2 * press.period, used, press.period, self.duration)
            squared = (summed + first * (FIRST_ERROR * peak) ** 2) / (scored_for + first)
            worth[expert] = (squared * penalty**2 + 1e-12) ** (-0.5 * self.power)
        return np.asarray(worth / worth.sum(axis=0))

    def _stacked(self, press: Press, scored: Array) -> Array:
        """Weights that would have served best so far, renewed every 20 ms, and 0.1 s of belief in equality."""
        used, _ = self._errors(press, scored)
        count, step = len(scored), max(1, round(0.02 / press.period))
        fading = math.exp(-0.02 / self.duration)
        weights, shares = np.full(count, 1.0 / count), np.empty(scored.shape)
        normal, right = np.zeros((count, count)), np.zeros(count)
        peak = 1e-3
        for begin in range(0, scored.shape[1], step):
            shares[:, begin : begin + step] = weights[:, None]
            chosen = np.flatnonzero(used[begin : begin + step]) + begin
            if chosen.size == 0:
                continue
            said, felt = scored[:, chosen], press.force[chosen]
            peak = max(peak, float(felt.max()))
            normal = fading * normal + press.period * said @ said.T
            right = fading * right + press.period * said @ felt
            ridge = 0.1 * (0.1 * peak) ** 2 * np.eye(count)
            root = np.linalg.cholesky(normal + ridge)
            weights, _ = nnls(root.T, np.linalg.solve(root, right + ridge @ np.full(count, 1.0 / count)))
        return shares


def _fading(values: Array, used: Array, period: float, duration: float) -> Array:
    """Sum that fades while samples are used."""
    summed, so_far, fading = np.empty(values.size), 0.0, math.exp(-period / duration)
    for index, (value, use) in enumerate(zip(values.tolist(), used.tolist(), strict=True)):
        if use:
            so_far = fading * so_far + value
        summed[index] = so_far
    return summed
