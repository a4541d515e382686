"""How fast a robot may go deeper, or has to retreat, so that a force approaches a limit without passing it.

With it the follower guards a contact that the leader does not know yet.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.errors.checks import require

PATIENCE = 0.01
"""Time constant with which a force is brought to its limit [s]: longer than the delay of sensor and drive."""

STEEPER = 2.0  # Factor by which a material is assumed stiffer than its secant and its tangent: it may stiffen
SHORTEST_DEPTH = 2e-5  # Least distance over which the secant is computed [m]
SOFTEST = 50.0  # Least stiffness that is assumed [N/m]

STRIDE, KEPT = 1e-4, 0.5
"""Least distance over which the tangent is computed [m], and fraction of a steeper one before that is kept after it."""

AWAY = 1e-3  # Distance outside its onset at which a contact is over [m]


class ForceGuard(Record):
    r"""Limits the speed by the contact that the robot is in.

    .. math:: \dot x = \frac{F_{limit} - F}{K \tau + b}

    with tau = 10 ms, b the assumed damping, and K twice the steepest of this contact's secant, force over depth since
    its onset, and its tangent over 0.1 mm; where the material is less steep further on, K is halved every 0.1 mm. The
    force then approaches its limit as by a first-order low-pass, and does not pass it, on any material that stiffens by
    no more than that. The effect of speed and mass in an impact is not included (`impact_impedance` is).
    """

    stiffness: float = SOFTEST  # K of this contact [N/m]
    onset: float = math.nan  # of this contact [m]; NaN once the robot was 1 mm further out without one
    force: float = math.nan  # the newest [N]; NaN if unknown
    reference: float = math.nan  # position where the newest tangent starts [m]
    reference_force: float = math.nan  # there [N]


@compiled
def observe(guard: ForceGuard, position: float, force: float, in_contact: bool) -> None:
    """Take one sample of the sensors; where one is NaN, the force is unknown.

    Args:
        guard: Written.
        position: Position of the robot [m].
        force: Measured force [N].
        in_contact: Whether that is contact.
    """
    known = math.isfinite(position) and math.isfinite(force)
    guard.force = force if known else math.nan
    if not known:
        return
    if not in_contact:
        if position < guard.onset - AWAY:
            guard.onset, guard.stiffness = math.nan, SOFTEST
        return
    if math.isnan(guard.onset):
        guard.onset = guard.reference = position
        guard.reference_force = force
    distance = position - guard.reference
    if distance >= STRIDE:  # the stiffness here, after each such distance
        tangent = (force - guard.reference_force) / distance
        guard.stiffness = max(KEPT * guard.stiffness, STEEPER * tangent, SOFTEST)
    if distance >= STRIDE or distance < 0.0:
        guard.reference, guard.reference_force = position, force
    depth = position - guard.onset
    guard.stiffness = max(guard.stiffness, STEEPER * force / max(depth, SHORTEST_DEPTH))


@compiled
def allowed_speed(guard: ForceGuard, limit: float, damping: float) -> float:
    """Speed at which the robot may go deeper now, negative where it has to retreat [m/s]; 0 if force unknown.

    Args:
        guard: Of this contact.
        limit: Force to approach [N].
        damping: b, assumed where it goes deeper [N s/m].
    """
    if math.isnan(guard.force):
        return 0.0
    missing = limit - guard.force
    return float(missing / (guard.stiffness * PATIENCE + (damping if missing > 0.0 else 0.0)))


@kernel("f8(ForceGuard[::1], f8, f8, b1, f8, f8)")
def guarded_speed(
    guards: NDArray[np.void], position: float, force: float, in_contact: bool, limit: float, damping: float
) -> float:
    """`observe`, and the `allowed_speed` after it, of one guard."""
    guard = guards[0]
    observe(guard, position, force, in_contact)
    return allowed_speed(guard, limit, damping)


UNKNOWN_FROM = 1e-3  # Distance outside the surface known to the leader above which a contact is with something else [m]


class Touch(Record):
    """State of a `FirstTouch`, with its settings."""

    speed: float  # of approach [m/s]
    holding_force: float  # F_h [N]
    period: float  # T [s]
    commanded: float = math.nan  # newest position for the robot [m]; NaN where nothing is guarded
    held_back: float  # distance that it is behind the commands [m]
    unknown: bool  # whether the leader did not know the surface
    guard: ForceGuard


@compiled
def follow(touch: Touch) -> None:
    """Start again where the robot then is, guarding nothing."""
    touch.commanded, touch.held_back, touch.unknown = math.nan, 0.0, False


@compiled
def guarded_position(
    touch: Touch, desired: float, position: float, force: float, in_contact: bool, known_surface: float
) -> float:
    """One tick of `FirstTouch.update`, whose other arguments these are; its state is written."""
    unknown = math.isnan(known_surface) or (in_contact and position < known_surface - UNKNOWN_FROM)
    if math.isnan(touch.commanded):
        touch.commanded = position if math.isfinite(position) else desired
    if unknown:
        observe(touch.guard, position, force, in_contact)
        deeper = min(max(allowed_speed(touch.guard, touch.holding_force, 0.0), -touch.speed), touch.speed)
        touch.commanded = min(desired, touch.commanded + deeper * touch.period)
        touch.held_back = desired - touch.commanded
    else:
        if touch.unknown:  # a step of the commands, as where the index has met the surface, is none of the robot's
            touch.held_back = desired - touch.commanded
        back = touch.speed * touch.period
        touch.held_back -= math.copysign(min(back, abs(touch.held_back)), touch.held_back)
        touch.commanded = desired - touch.held_back
    touch.unknown = unknown
    return float(touch.commanded)


_guarded_position = Kernel(guarded_position, "f8(Touch, f8, f8, f8, b1, f8)")


class FirstTouch:
    r"""Keeps a robot from following blindly into a surface that the leader does not know.

    Until the leader is known to render from a model that has this surface, the robot

    - goes deeper no faster than the approach speed, before any contact too;
    - in contact, goes deeper or back so that the force comes to the one to be held,
      as `foretouch.session.safety.force_guard.ForceGuard` says, no faster than that either;
    - follows outwards at once.

    Then the return to the commands is as slow as the approach. Where nothing is guarded, commands pass unchanged.

    Args:
        approach_speed: Speed of approach [m/s], positive.
        force: F_h [N], positive.
        sample_period: Sample period [s], positive.
        memory: Array of one `Touch` for the state, part of another record; None for one of its own.
    """

    __slots__ = ("_held_back", "_touch")

    def __init__(
        self, approach_speed: float, force: float, sample_period: float, *, memory: NDArray[np.void] | None = None
    ) -> None:
        require("approach_speed", approach_speed, above=0.0)
        require("guarded_force", force, above=0.0)
        require("sample_period", sample_period, above=0.0)
        memory = Touch.new() if memory is None else memory
        memory[:] = Touch.new(speed=approach_speed, holding_force=force, period=sample_period)
        self._touch, self._held_back = memory[0], memory["held_back"]

    @property
    def guarded(self) -> bool:
        """Whether the newest command was held back."""
        return bool(self._held_back.item() != 0.0)

    def update(self, desired: float, position: float, force: float, in_contact: bool, known_surface: float) -> float:
        """One tick: the position for the robot [m]. While force or position are NaN it goes no deeper.

        Args:
            desired: Commanded position [m].
            position: Position of the robot [m].
            force: Measured force [N].
            in_contact: Whether that is contact.
            known_surface: Surface of the newest model that the leader is known to render from [m]; NaN for none.
        """
        return _guarded_position.entry(self._touch, desired, position, force, in_contact, known_surface)
