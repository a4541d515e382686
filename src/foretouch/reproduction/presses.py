"""The ideal simulations of Figs. 7 and 8: one motion, four materials, what an estimator makes of each sample.

The motion is the paper's penetration trajectories, position and analytic velocity, in metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from foretouch.comparison.cases import BETWEEN, CHANGES, GRADUAL_DURATION, HUNT_CROSSLEY, KELVIN_VOIGT, gradual_law
from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import ContactSample
from foretouch.identification.linear.linearised import LinearisedEstimator
from foretouch.models import ContactModel, ContinuousSwitching, LinearisedContinuousSwitching, MemorylessLaw, advance
from foretouch.quantities import Array, Brief
from foretouch.reproduction.theory.linearisation import fit_polynomial, linearise

START_DEPTH = 0.020  # depth about which the trajectory of Fig. 6 swings, and at which it starts: x_0 [m].

WAVES = ((0.0025, 2.0), (0.015, 4.0), (-0.005, 6.0), (0.005, 8.0))
"""The sine waves of Fig. 6: amplitude [m] and the time that t is divided by [s]."""


def two_presses(time: ArrayLike, waves: tuple[tuple[float, float], ...] = WAVES) -> tuple[Array, Array]:
    r"""Depth [m] and velocity [m/s] of Fig. 6 at times t [s], which Figs. 7 and 8 also press along.

    .. math:: x(t) = 20 + 2.5 \sin\frac t2 + 15 \sin\frac t4 - 5 \sin\frac t6 + 5 \sin\frac t8 \;\text{mm}

    The paper's run from 0 to 25 s. Each of the waves has an amplitude [m] and a divisor of t [s].
    """
    t = np.asarray(time, dtype=np.float64)
    depth, velocity = np.full_like(t, START_DEPTH), np.zeros_like(t)
    for amplitude, divisor in waves:
        depth = depth + amplitude * np.sin(t / divisor)
        velocity = velocity + amplitude / divisor * np.cos(t / divisor)
    return depth, velocity


def linearisation_press(time: ArrayLike, *, noise: float = 0.5e-3, seed: int = 0) -> tuple[Array, Array]:
    r"""Depth [m] and velocity [m/s] of Fig. 5 at times t [s]; the depth is positive until 4 pi s.

    .. math:: x = 40 \sin\frac t4 + 0.5\,\text{rand}() \;\text{mm}

    rand() is even between 0 and 1, drawn anew for each sample; `noise` [m] is the greatest. The velocity is that of the
    sine alone: of the noise there is none.
    """
    if not noise >= 0.0:
        raise SettingError("noise", noise, "must not be negative, in m")
    t = np.asarray(time, dtype=np.float64)
    random = np.random.default_rng(seed)
    return 0.040 * np.sin(t / 4.0) + noise * random.random(t.shape), 0.010 * np.cos(t / 4.0)


DURATION, STEPS = GRADUAL_DURATION, CHANGES  # duration of the paper's simulations and times of sudden changes [s]
PERIOD = 0.1  # period of the paper's samples [s]: its changes at 7 s and 15 s are at the 70th and 150th iteration

STEP_LAWS = {
    "<2> Hunt-Crossley": ContinuousSwitching(3000.0, 1500.0, 1.4, 0.0),
    "middle": BETWEEN,
    "<1> Kelvin-Voigt": ContinuousSwitching(6000.0, 500.0, 0.0, 1.0),
}
"""The three materials of the paper's sudden changes (Fig. 7c)."""


def _sudden(time: float) -> MemorylessLaw:
    return list(STEP_LAWS.values())[sum(time >= step for step in STEPS)]


MATERIALS: dict[str, Callable[[float], MemorylessLaw]] = {
    "kelvin-voigt": lambda time: KELVIN_VOIGT,
    "hunt-crossley": lambda time: HUNT_CROSSLEY,
    "continuous": gradual_law,
    "steps": _sudden,
}
"""The law of each simulated material at a time [s]."""


@dataclass(frozen=True, eq=False)
class Press(Brief):
    """One simulation: what the estimator is given, and what is true."""

    material: str  # name of the material
    time: Array  # [s], shape (m,); the first sample is one period after 0
    depth: Array  # as given to the estimator [m], shape (m,)
    velocity: Array  # as given to the estimator [m/s], shape (m,)
    force: Array  # force as given to the estimator [N], shape (m,)
    true_force: Array  # force of the exact law on the exact motion [N], shape (m,)
    laws: tuple[MemorylessLaw, ...]  # the exact law at each sample, m of them

    @property
    def samples(self) -> list[ContactSample]:
        """The samples for `Estimator.update`."""
        columns = (self.time.tolist(), self.depth.tolist(), self.velocity.tolist(), self.force.tolist())
        return [ContactSample(*row, True) for row in zip(*columns, strict=True)]


def press(
    material: str,
    *,
    period: float = PERIOD,
    noise: float = 0.0,
    seed: int = 0,
    differenced: bool = False,
    waves: tuple[tuple[float, float], ...] = WAVES,
) -> Press:
    """Press one of `MATERIALS` along the trajectory of Fig. 6, a sample each period [s]; every sample is in contact.

    The force has noise with a standard deviation [N]; the velocity may be the difference of the last two depths.
    """
    if material not in MATERIALS:
        raise UnknownNameError("material", material, MATERIALS)
    count = round(DURATION / period)
    time = np.arange(1, count + 1) * DURATION / count
    depth, velocity = two_presses(time, waves)
    laws = tuple(map(MATERIALS[material], time.tolist()))
    force = forces_of(laws, depth, velocity)
    given = force + noise * np.random.default_rng(seed).standard_normal(count) if noise > 0.0 else force
    seen = velocity
    if differenced:
        seen = np.diff(depth, prepend=two_presses(0.0, waves)[0]) / period
    return Press(material, time, depth, seen, given, force, laws)


def forces_of(models: tuple[ContactModel | None, ...], depth: Array, velocity: Array) -> Array:
    """Force [N] of one model for each sample, NaN where there is none."""
    return np.array(
        [
            np.nan if model is None else advance(model, (), x, v, PERIOD)[1]
            for model, x, v in zip(models, depth.tolist(), velocity.tolist(), strict=True)
        ]
    )


def true_parameters(pressed: Press) -> Array:
    """(k, s, b1, b2) of the true law linearised, shape (4, m); k in N/m^s, b1 in s/m, b2 in s.

    a1 and a2 of (17) are fitted over the depths of the whole trajectory, for (18) has one pair for all depths.
    """
    depths = two_presses(np.arange(0.0, DURATION, PERIOD))[0]
    known: dict[MemorylessLaw, LinearisedContinuousSwitching] = {}
    for law in pressed.laws:
        if law not in known:
            fit = fit_polynomial(law.general_form[3], depths, depth_power=0.0)
            known[law] = linearise(law, fit.a1, fit.a2)
    columns = np.array([known[law].parameters for law in pressed.laws]).T
    columns[0] = np.exp(columns[0])
    return columns


@dataclass(frozen=True, eq=False)
class Trace(Brief):
    """What an estimator of the linearised law (18) found at each sample."""

    k: Array  # stiffness [N/m^s], shape (m,)
    s: Array  # exponent of depth, shape (m,)
    b1: Array  # [s/m], shape (m,)
    b2: Array  # [s], shape (m,)
    force: Array  # force of each sample by the parameters that were learnt from it too [N], shape (m,)
    ahead: Array  # force of each sample by the parameters before it [N], shape (m,); the first is NaN

    @property
    def parameters(self) -> Array:
        """k, s, b1 and b2, shape (4, m), as `true_parameters` has them."""
        return np.array([self.k, self.s, self.b1, self.b2])


def follow(estimator: LinearisedEstimator, pressed: Press) -> Trace:
    """Feed every sample to a fresh estimator of the linearised law (18)."""
    results = []
    for sample in pressed.samples:
        estimator.update(sample)
        results.append(estimator.linear_parameters)
    models = tuple(LinearisedContinuousSwitching(*linear) for linear in results)
    ln_k, s, b1, b2 = np.array(results).T
    force = forces_of(models, pressed.depth, pressed.velocity)
    ahead = forces_of((None, *models[:-1]), pressed.depth, pressed.velocity)
    with np.errstate(over="ignore"):
        return Trace(np.exp(ln_k), s, b1, b2, force, ahead)
