r"""Impact of a mass on any material without memory, integrated; and where the closed-form energy loss (12) ends.

In depths of x_M by (7) and speeds of v_i an impact depends on three numbers only: n, alpha and the damping ratio
:math:`\epsilon = \lambda v_i / (k x_M^\alpha)`,

.. math::
    \xi'' = -\tfrac12 (s + 1)\, \xi^n (\xi^\alpha + \epsilon \xi'), \qquad
    \frac{\Delta E}{\tfrac12 m v_i^2} \approx \tfrac43 h(\beta)\, \epsilon

so one number says how far (12) can be trusted, whatever the units. Its relative error grows in proportion to epsilon.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models.classic import ContinuousSwitching
from foretouch.models.contact_model import NO_STATE, ContactModel
from foretouch.models.memoryless_law import MemorylessLaw
from foretouch.quantities import Array, Brief
from foretouch.reproduction.theory.energy_loss import energy_loss

_LONGEST = 1e4
"""Time at which an impact that neither separates nor loses its energy is given up [scaled length over speed]."""

_MOST_EVALUATIONS = 200_000
"""Evaluations of the law before an impact is given up: seconds. Ordinary ones take some thousands."""

_LEFT = 1e-9  # fraction of the energy with which a mass that is pulled back counts as stuck: it creeps out forever
_PERIOD = 1e-3  # sample period that the laws are given [s]; those without memory do not look at it


@dataclass(frozen=True, eq=False)
class Impact(Brief):
    """One impact, from first touch to separation: the arrays of the paper's Figs. 2 and 3, and the sums."""

    mass: float  # m [kg]
    speed: float  # speed at first touch, v_i [m/s]
    rebound_speed: float  # speed at separation [m/s], positive; 0 for a mass that sticks
    separated: bool  # False for a mass that sticks (only with tension)
    duration: float  # time from touch to separation [s]
    maximum_depth: float  # greatest depth x_M [m]
    fastest_return: float  # greatest speed in unloading [m/s]; the rebound speed, unless the material pulls at release
    damping_work: float  # energy that the damper took [J], integrated along the way from its power
    time: Array  # sample times [s], evenly spaced, shape (samples,)
    depth: Array  # x [m], shape (samples,)
    velocity: Array  # [m/s], shape (samples,)
    # on the mass [N], shape (samples,); 0 in the first sample, at the surface itself, where the Kelvin-Voigt force
    # jumps to B v_i
    force: Array

    @property
    def energy_loss(self) -> float:
        """Kinetic energy in less kinetic energy out [J]."""
        return 0.5 * self.mass * (self.speed - self.rebound_speed) * (self.speed + self.rebound_speed)

    @property
    def restitution(self) -> float:
        """Speed out over speed in [-]."""
        return self.rebound_speed / self.speed

    @property
    def power(self) -> Array:
        """Power into the material [W], force times velocity, shape (samples,)."""
        return self.force * self.velocity

    @property
    def areas(self) -> tuple[float, float, float]:
        """H1, H2 and H3 of the paper's Figs. 2 and 3 [J], from the kinetic energies; their sum is the energy loss.

        H1 is what the mass gives while it goes in, H2 (negative) what it gets back, H3 what the material takes from
        it again by pulling at release: 0 unless tension was allowed.
        """
        given = 0.5 * self.mass * self.speed**2
        back = 0.5 * self.mass * self.fastest_return**2
        return given, -back, back - 0.5 * self.mass * self.rebound_speed**2


def integrate_impact(
    law: ContactModel,
    mass: float,
    speed: float,
    *,
    allow_tension: bool = False,
    samples: int = 401,
    relative_tolerance: float = 1e-10,
) -> Impact:
    r"""Throw a mass at a material and integrate until it leaves.

    .. math:: m \ddot x = -F(x, \dot x), \quad x(0) = 0, \quad \dot x(0) = v_i

    without gravity, until x comes back to 0, by SciPy's explicit Runge-Kutta method of order 8 (DOP853) in depths of
    the first guess of x_M and in speeds of v_i.

    The law has no memory; mass m [kg] and speed v_i [m/s] are positive. With tension the law, which must be a
    `MemorylessLaw`, pulls at release, as the equations are written. At least two evenly spaced samples are returned.

    Raises:
        SettingError: A law with a memory or without tension, a number out of range, or an impact that the solver cannot
            follow: a mass held by a Kelvin-Voigt law that pulls, its damping ratio above 100.
    """
    from scipy.integrate import solve_ivp

    require("mass", mass, above=0.0)
    require("speed", speed, above=0.0)
    require("samples", samples, at_least=2)
    require("relative_tolerance", relative_tolerance, above=0.0, at_most=1e-2)
    force = _force_of(law, allow_tension)
    length = _first_guess(force, mass, speed)
    energy = mass * speed**2  # twice the kinetic energy; force * length over it is acceleration in scaled units

    evaluations = itertools.count()

    def rates(_time: float, state: Array) -> list[float]:
        if next(evaluations) > _MOST_EVALUATIONS:
            raise _cannot(law, mass, speed)
        depth, velocity = float(state[0]) * length, float(state[1]) * speed
        total = force(depth, velocity)
        damper = total - force(depth, 0.0)
        return [float(state[1]), -total * length / energy, damper * float(state[1]) * length / energy]

    def event(value: Callable[[Array], float], *, terminal: bool = False) -> Callable[[float, Array], float]:
        def at(_time: float, state: Array) -> float:
            return value(state)

        vars(at).update(terminal=terminal, direction=-1.0)  # attributes of a function: SciPy's interface for events
        return at

    surface = event(lambda state: float(state[0]), terminal=True)
    turning = event(lambda state: float(state[1]))
    pulling = event(lambda state: force(float(state[0]) * length, float(state[1]) * speed))
    stuck = event(lambda state: 0.5 * (1.0 - _LEFT) - float(state[2]) if allow_tension else 1.0, terminal=True)
    solution: Any = solve_ivp(
        rates,
        (0.0, _LONGEST),
        [0.0, 1.0, 0.0],
        method="DOP853",
        events=(surface, turning, pulling, stuck),
        dense_output=True,
        rtol=relative_tolerance,
        atol=1e-3 * relative_tolerance,
    )
    if solution.status != 1 or not np.isfinite(solution.y).all():
        raise _cannot(law, mass, speed)
    end = float(solution.t[-1])
    times = np.linspace(0.0, end, samples)
    states = solution.sol(times)
    depth, velocity = np.maximum(states[0], 0.0) * length, states[1] * speed
    separated = len(solution.t_events[0]) > 0
    rebound = -float(solution.y[1, -1]) * speed if separated else 0.0
    return Impact(
        mass=mass,
        speed=speed,
        rebound_speed=rebound,
        separated=separated,
        duration=end * length / speed,
        maximum_depth=max([float(solution.y[0].max()), *(float(state[0]) for state in solution.y_events[1])]) * length,
        fastest_return=max([rebound, *(-float(state[1]) * speed for state in solution.y_events[2])]),
        damping_work=float(solution.y[2, -1]) * energy,
        time=times * (length / speed),
        depth=depth,
        velocity=velocity,
        force=np.array([force(x, v) for x, v in zip(depth.tolist(), velocity.tolist(), strict=True)]),
    )


def _cannot(law: ContactModel, mass: float, speed: float) -> SettingError:
    impact = f"an impact of {mass:g} kg at {speed:g} m/s cannot be integrated to its end"
    return SettingError("law", law, f"{impact}: take less damping, or a greater relative_tolerance")


def _force_of(law: ContactModel, allow_tension: bool) -> Callable[[float, float], float]:
    """Force [N] of depth and velocity, in scalar arithmetic; a SettingError where a law has a memory or cannot pull."""
    if law.initial_state() != NO_STATE:
        raise SettingError("law", law.law, "must have no memory: its force must follow from depth and velocity")
    if not allow_tension:
        return lambda depth, velocity: law.advance(NO_STATE, depth, velocity, _PERIOD)[1]
    if not isinstance(law, MemorylessLaw):
        raise SettingError("allow_tension", True, f"{law.law} has no force below zero")
    k, damping, n, alpha = law.general_form

    def pulling(depth: float, velocity: float) -> float:
        return depth**n * (k * depth**alpha + damping * velocity) if depth > 0.0 else 0.0

    return pulling


def _first_guess(force: Callable[[float, float], float], mass: float, speed: float) -> float:
    """Depth [m] at which the spring alone holds about the energy of the mass: the unit of length of the solver."""
    energy = 0.5 * mass * speed**2
    low, high = 1e-12, 1e6
    for _ in range(60):  # bisection over decades; force times depth is the stored energy but for a factor s + 1
        middle = math.sqrt(low * high)
        if force(middle, 0.0) * middle < energy:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True, slots=True)
class LowDampingError:
    """The closed form beside the integrated impact, as ratios to the incoming energy."""

    damping_ratio: float  # epsilon [-]
    approximate_loss: float  # fraction of the energy lost by (12) [-]; above 1 it is absurd
    loss: float  # fraction lost by integration [-]
    restitution: float  # speed out over speed in, by integration [-]
    relative_error: float  # approximate_loss / loss - 1 [-]


def unit_impact(exponent: float, switching: float, damping_ratio: float) -> tuple[ContinuousSwitching, float]:
    """Law and mass of an impact at 1 m/s whose greatest depth by (7) is 1 m: its damping is the damping ratio."""
    return ContinuousSwitching(1.0, damping_ratio, exponent, switching), 2.0 / (exponent + switching + 1.0)


def speed_exponent(law: MemorylessLaw, mass: float, speed: float = 1.0, *, allow_tension: bool = False) -> float:
    """Local exponent of speed in the energy that an impact costs [-], from integrated impacts 1 % to either side."""
    low, high = (
        integrate_impact(law, mass, speed * factor, allow_tension=allow_tension, samples=2).damping_work
        for factor in (0.99, 1.01)
    )
    return math.log(high / low) / math.log(1.01 / 0.99)


def low_damping_error(
    exponent: float, switching: float, damping_ratio: float, *, allow_tension: bool = False
) -> LowDampingError:
    """The error of (12) at one damping ratio epsilon [-] above 0.

    Exponent n and switching alpha are not negative, and not both zero. With tension the equation is integrated as
    printed, pulling at release, which is what (9) integrates.
    """
    require("damping_ratio", damping_ratio, above=0.0)
    law, mass = unit_impact(exponent, switching, damping_ratio)
    impact = integrate_impact(law, mass, 1.0, allow_tension=allow_tension, samples=2)
    energy = 0.5 * mass
    theory = float(energy_loss(law, mass, 1.0))
    # The damper's work, not the difference of two kinetic energies: that one has no digits left at small losses.
    loss = impact.damping_work if impact.separated else energy
    return LowDampingError(damping_ratio, theory / energy, loss / energy, impact.restitution, theory / loss - 1.0)


def low_damping_limit(exponent: float, switching: float, tolerance: float) -> LowDampingError:
    """The damping ratio at which (12) has a given relative error [-], from 1e-4 to 1, and an impact there."""
    from scipy.optimize import brentq

    require("tolerance", tolerance, at_least=1e-4, at_most=1.0)

    def beyond(log_ratio: float) -> float:
        return abs(low_damping_error(exponent, switching, math.exp(log_ratio)).relative_error) - tolerance

    return low_damping_error(exponent, switching, math.exp(brentq(beyond, math.log(1e-6), math.log(100.0), rtol=1e-8)))


MASS, SPEED = 1.0, 0.5  # mass [kg] and speed [m/s] of the impacts of Figs. 2 and 3; the paper gives none.


def impact_of(law: MemorylessLaw, *, speed: float = SPEED, allow_tension: bool = True) -> Impact:
    """One impact, sampled densely enough that sums over it are integrals to five digits."""
    return integrate_impact(law, MASS, speed, allow_tension=allow_tension, samples=2001)


def impact_table(impact: Impact) -> dict[str, Array]:
    """What figures of an impact draw, by column."""
    return {
        "time_s": impact.time,
        "depth_m": impact.depth,
        "velocity_m_s": impact.velocity,
        "force_N": impact.force,
        "power_W": impact.power,
    }
