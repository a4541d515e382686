"""Presses at 1 kHz as sensors see them, and what an estimator makes of each on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import Estimator, Status
from foretouch.models import ContactModel, ContinuousSwitching, LinearisedContinuousSwitching, MotionFilter
from foretouch.quantities import Brief
from foretouch.reproduction.presses import Press, forces_of

Array = NDArray[np.float64]

PERIOD = 1e-3
"""Between samples [s]."""

NOISE, ENCODER = 0.02, 5e-6
"""Standard deviation of the force noise [N]; step of the encoder [m]."""

AHEAD = 300
"""Samples between what a model was learnt from and what it predicts: the paper's delay of 300 ms."""

STRIDE = 10
"""Every so many samples a model is kept."""

TAP_DEPTH, TAP_PERIOD, TAP_TIME = 0.010, 2.0, 10.0
"""Of the taps: deepest [m], from touch to touch [s], in all [s]."""

TREMOR, TREMOR_RATE = 1e-5, 8.0
"""Of the hand in taps and holding: amplitude [m] and rate [Hz]."""

HOLD_TIME = 10.0
"""How long a press is held [s]."""

TAP_LAW = ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5)
"""The paper's material after the first change."""


def measured_press(pressed: Press, seed: int = 0) -> Press:
    """The same press as sensors see it: force with noise, depth in steps of the encoder, velocity from those depths."""
    depth = np.round(pressed.depth / ENCODER) * ENCODER
    velocity = MotionFilter().run(pressed.time.tolist(), depth.tolist())
    noise = NOISE * np.random.default_rng(seed).standard_normal(depth.size)
    return replace(pressed, depth=depth, velocity=velocity, force=pressed.true_force + noise)


def _along(phase: Array, rate: Array, name: str) -> Press:
    """Press `TAP_LAW` to and fro as a cosine of a phase [rad] with its rate [rad/s], with the tremor of a hand."""
    time = np.arange(1.0, phase.size + 1.0) * PERIOD
    trembling = 2.0 * np.pi * TREMOR_RATE
    depth = 0.5 * TAP_DEPTH * (1.0 - np.cos(phase)) + TREMOR * np.sin(trembling * time)
    velocity = 0.5 * TAP_DEPTH * rate * np.sin(phase) + TREMOR * trembling * np.cos(trembling * time)
    force = TAP_LAW.force(depth, velocity)
    return Press(name, time, depth, velocity, force, force, (TAP_LAW,) * time.size)


def taps() -> Press:
    """Taps from the surface into one material at 1 kHz, without sensor noise."""
    rate = np.full(round(TAP_TIME / PERIOD), 2.0 * np.pi / TAP_PERIOD)
    return _along(np.cumsum(rate) * PERIOD, rate, "taps")


def hold() -> Press:
    """One press, held, then taps: the same material, without sensor noise."""
    rate = np.full(round((TAP_TIME + HOLD_TIME) / PERIOD), 2.0 * np.pi / TAP_PERIOD)
    begin = round(0.5 * TAP_PERIOD / PERIOD)
    rate[begin : begin + round(HOLD_TIME / PERIOD)] = 0.0
    return _along(np.cumsum(rate) * PERIOD, rate, "hold")


@dataclass(frozen=True, eq=False)
class Walk(Brief):
    """What an estimator made of a press, at every `STRIDE`-th sample.

    Attributes:
        index: Of those samples, shape (m,).
        k: Stiffness [N/m^s], NaN before there is a law, shape (m,).
        s: Exponent, shape (m,).
        next_error: Error of the force at the next sample [N], shape (m,).
        ahead_error: Error of the force `AHEAD` samples later on the motion of then [N]; NaN at the end, shape (m,).
        restarts: How often the estimator had to begin again.
        force_rms: Of the true force [N].
    """

    index: NDArray[np.int64]
    k: Array
    s: Array
    next_error: Array
    ahead_error: Array
    restarts: int
    force_rms: float

    @property
    def next_share(self) -> float:
        """RMS error of the force at the next sample in the RMS of the force."""
        return self._share(self.next_error)

    @property
    def ahead_share(self) -> float:
        """RMS error of the force `AHEAD` samples later in the RMS of the force."""
        return self._share(self.ahead_error)

    def _share(self, errors: Array) -> float:
        return float(np.sqrt(np.nanmean(np.square(errors)))) / self.force_rms


def walk(estimator: Estimator, pressed: Press) -> Walk:
    """Feed every sample to a fresh estimator whose surface is known."""
    estimator.trust_surface(True)
    models: list[ContactModel | None] = []
    restarts = 0
    for number, sample in enumerate(pressed.samples):
        status = estimator.update(sample)
        restarts += status is Status.RESTARTED
        if number % STRIDE == 0:
            models.append(estimator.model)
    index = np.arange(0, pressed.time.size, STRIDE)
    numbers = np.array([_stiffness(model) for model in models])
    return Walk(
        index,
        numbers[:, 0],
        numbers[:, 1],
        _errors(models, index, pressed, 1),
        _errors(models, index, pressed, AHEAD),
        restarts,
        float(np.sqrt(np.mean(np.square(pressed.true_force)))),
    )


def _stiffness(model: ContactModel | None) -> tuple[float, float]:
    """K and s of a law."""
    if isinstance(model, LinearisedContinuousSwitching):
        return float(np.exp(min(model.ln_k, 700.0))), model.s
    if isinstance(model, ContinuousSwitching):
        return model.stiffness, model.exponent + model.switching
    return np.nan, np.nan


def _errors(models: list[ContactModel | None], index: NDArray[np.int64], pressed: Press, later: int) -> Array:
    """Force of each model on a later sample less the true one [N], NaN beyond the end."""
    at = index + later
    there = at < pressed.time.size
    kept = tuple(model for model, inside in zip(models, there, strict=True) if inside)
    errors = np.full(index.size, np.nan)
    at = at[there]
    errors[there] = forces_of(kept, pressed.depth[at], pressed.velocity[at]) - pressed.true_force[at]
    return errors
