"""How fast a robot may go deeper, or has to retreat, so that a force approaches a limit without passing it.

With it the follower guards a contact that the leader does not know yet, and in space keeps the force below its ceiling
in every direction, whatever normal is believed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import Numbers3, add, dot, norm, scaled, subtract, vector, write

AIMED = 0.88
"""Fraction of the force ceiling that a press is brought to: the zero of a sensor that began in contact may err by 1 N,
and an arm that leaves a damped contact and stops swings back into it. At 0.95 a search led to 15.1 N in
Kelvin-Voigt."""

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
def forget_contact(guard: ForceGuard) -> None:
    """Begin anew: the next contact is with something else."""
    guard.stiffness = SOFTEST
    guard.onset = guard.force = guard.reference = guard.reference_force = math.nan


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


UNKNOWN_FROM = 1e-3  # Distance outside the surface known to the leader above which a contact is with something else [m]


class Touch(Record):
    r"""Keeps a robot from following blindly into a surface that the leader does not know.

    Until the leader is known to render from a model that has this surface, the robot

    - goes deeper no faster than the approach speed, before any contact too;
    - in contact, goes deeper or back so that the force comes to the one to be held, as `ForceGuard` says, as slowly;
    - follows outwards at once.

    Then the return to the commands is as slow as the approach. Where nothing is guarded, commands pass unchanged.
    """

    speed: float  # of approach [m/s]
    holding_force: float  # F_h [N]
    period: float  # T [s]
    commanded: float = math.nan  # newest position for the robot [m]; NaN where nothing is guarded
    held_back: float  # distance that it is behind the commands [m]
    unknown: bool  # whether the leader did not know the surface
    guard: ForceGuard


def first_touch(approach_speed: float, force: float, sample_period: float) -> NDArray[np.void]:
    """One `Touch` with the approach speed [m/s], F_h [N] and T [s], all positive."""
    require("approach_speed", approach_speed, above=0.0)
    require("guarded_force", force, above=0.0)
    require("sample_period", sample_period, above=0.0)
    return Touch.new(speed=approach_speed, holding_force=force, period=sample_period)


@compiled
def follow(touch: Touch) -> None:
    """Start again where the robot then is, guarding nothing."""
    touch.commanded, touch.held_back, touch.unknown = math.nan, 0.0, False


@kernel("f8(Touch[::1], f8, f8, f8, b1, f8)")
def guarded_position(
    touches: NDArray[np.void], desired: float, position: float, force: float, in_contact: bool, known_surface: float
) -> float:
    """One tick: the position for the robot [m]. While force or position are NaN it goes no deeper.

    Args:
        touches: Written.
        desired: Commanded position [m].
        position: Position of the robot [m].
        force: Measured force [N].
        in_contact: Whether that is contact.
        known_surface: Surface of the newest model that the leader is known to render from [m]; NaN for none.
    """
    touch = touches[0]
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


SLOWED = 0.6  # Fraction of the force ceiling above which sliding slows down, until it stops at `AIMED`

AHEAD, RATE_WEIGHT = 0.02, 0.2
"""Look-ahead time of the force for sliding [s], and weight of a tick in the smoothing of the force's rate."""

RECOVERY = 0.002
"""Fraction of its speed by which a slide that was slowed may grow per tick: a probe that slips after it has stuck would
otherwise reach full speed before its force is felt."""

CONE = 0.8  # Cosine of the largest angle between force and normal that friction explains
FELT = 1.0  # Smallest force that counts as a contact that matters [N]


class ForceCap(Record):
    """Force limit in space: along the measured force, whatever normal is believed.

    Within the cone in which friction may turn a force its direction is that of the believed normal: friction turns
    when the probe slides back along it.

    The position goes no deeper against the force than `ForceGuard` allows for 88 % of the ceiling, by the distance that
    the probe has moved against it, and retreats where that is exceeded. Where the normal does not explain the force,
    what was proven along it says nothing of this material, which counts as damped as an untouched one. A slide is
    slowed down while the force nears the ceiling: a surface that rises on the way makes a force grow that no depth
    explains.
    """

    ceiling: float  # of the force [N]
    most_damped: float  # damping assumed of an untouched material [N s/m]
    speed: float  # largest of the robot [m/s]
    period: float  # T [s]
    guard: ForceGuard
    here: Numbers3 = math.nan  # type: ignore[assignment]  # of the probe when a force was last known [m], or NaN
    place: Numbers3  # newest allowed position [m]
    outwards: Numbers3 = (0.0, 0.0, 1.0)  # type: ignore[assignment]  # direction of the force
    way: float  # distance moved against the force [m]
    force: float  # [N]
    rate: float  # of the force [N/s], smoothed
    fastest: float  # largest speed against the force, negative where it has to retreat [m/s]
    sliding: float = 1.0  # fraction of the speed at which the probe may slide
    slide: float  # speed at which it may [m/s]
    known: bool  # whether the force is
    explained: bool  # whether friction explains its direction
    limits: bool  # whether there is an allowed position


@compiled(error_model="numpy")
def observe_force(cap: ForceCap, here: Vector, force: Vector, normal: Vector) -> None:
    """Take the probe's position [m], the measured force [N] and the believed normal.

    A NaN force is unknown: nothing slides, and nothing goes deeper.
    """
    size = norm(force)
    if not (size < math.inf and math.isfinite(here[0]) and math.isfinite(here[1]) and math.isfinite(here[2])):
        observe(cap.guard, math.nan, math.nan, False)
        cap.fastest = allowed_speed(cap.guard, 0.0, 0.0)
        cap.known, cap.explained, cap.sliding = False, False, 0.0
        return
    felt = size > FELT
    cap.explained = not felt or dot(force, normal) > CONE * size
    outwards = normal if cap.explained else scaled(force, 1.0 / size)
    if felt and not math.isnan(cap.here[0]):
        cap.way -= dot(subtract(here, vector(cap.here)), outwards)
    cap.known = True
    write(cap.outwards, outwards)
    write(cap.here, here)
    observe(cap.guard, cap.way, size, felt)
    deeper = allowed_speed(cap.guard, AIMED * cap.ceiling, 0.0 if cap.explained else cap.most_damped)
    cap.fastest = deeper if felt else math.inf
    cap.rate += RATE_WEIGHT * ((size - cap.force) / cap.period - cap.rate)
    cap.force = size
    coming = size + max(cap.rate, 0.0) * AHEAD
    allowed = (AIMED * cap.ceiling - coming) / ((AIMED - SLOWED) * cap.ceiling)
    cap.sliding = min(max(allowed, 0.0), 1.0, cap.sliding + RECOVERY)


@compiled
def slide(cap: ForceCap, fastest: float) -> float:
    """Largest speed at which the probe may slide now, given the speed that all other limits allow [m/s].

    In contact it grows no faster than a slowed slide recovers, however suddenly more becomes allowed.
    """
    speed = cap.sliding * fastest
    if cap.force > FELT:
        speed = min(speed, cap.slide + RECOVERY * cap.speed)
    cap.slide = speed
    return float(speed)


@compiled
def limit_force(cap: ForceCap, wanted: Vector, moved: Vector, commanded: Vector) -> tuple[Vector, Vector]:
    """Allowed position, and its displacement by a limit, which is no motion of the position [m].

    Args:
        cap: Written.
        wanted: Wanted position [m].
        moved: Displacement of it by another limit, which is no motion either [m].
        commanded: Position commanded to the robot in the tick before [m].
    """
    before, shifted = vector(cap.place), (0.0, 0.0, 0.0)
    if not cap.limits:
        cap.limits = True
        write(cap.place, wanted)
        return wanted, shifted
    if not cap.known:
        return before, shifted
    outwards, deeper = vector(cap.outwards), max(cap.fastest, 0.0)
    # Never beyond the next position on the path, for the probe would slide and press on by itself.
    ahead = _shortened(cap, subtract(add(before, moved), commanded), cap.slide * PATIENCE)
    shifted = subtract(add(commanded, ahead), before)
    before = add(before, shifted)
    place = add(before, _shortened(cap, subtract(wanted, before), cap.slide * cap.period))
    if cap.force > FELT:
        back = max(dot(subtract(commanded, before), outwards) - deeper * PATIENCE, 0.0)
        inwards = back - dot(subtract(place, before), outwards)
        most = min(max(cap.fastest, -cap.speed), cap.speed) * cap.period
        if inwards > most:
            place = add(place, scaled(outwards, inwards - most))
            shifted = add(shifted, scaled(outwards, back))
    write(cap.place, place)
    return place, shifted


@compiled(error_model="numpy")
def _shortened(cap: ForceCap, step: Vector, longest: float) -> Vector:
    """Shorten a step so that its part across the force is at most this long [m].

    A course that leaves a surface inclined otherwise than believed may slide along the true one.
    """
    outwards = vector(cap.outwards)
    along = scaled(outwards, dot(step, outwards))
    across = subtract(step, along)
    length = norm(across)
    return add(along, scaled(across, longest / length)) if length > longest else step
