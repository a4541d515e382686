"""One tick of `foretouch.session.safety.Safety`, compiled: the rules are in its docstring, in the same order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.messages import Status
from foretouch.session.force_guard import DAMPING, PATIENCE, STEEPEST
from foretouch.session.force_guard_kernel import SIZE as GUARD_SIZE
from foretouch.session.force_guard_kernel import allowed_speed, observe
from foretouch.session.motion_limits import POSITION, VELOCITY
from foretouch.session.motion_limits_kernel import SIZE as MOTION_SIZE
from foretouch.session.motion_limits_kernel import begin, limited
from foretouch.session.safety import (
    AIMED,
    CLEARANCE,
    DAMPING_SHARE,
    HIDDEN,
    IMPACT_SHARE,
    MARGIN,
    MOST_DAMPED,
    REJOINED_FOR,
    REST_FORCE,
    STIFFEST,
    UNLOADED,
    impact_speed,
)

__all__ = [
    "AIM",
    "FASTEST",
    "FORCE",
    "GUARD",
    "IN_SPACE",
    "MOTION",
    "NEAREST",
    "NEW",
    "PERIOD",
    "SHIFTED",
    "SIZE",
    "keep_safe",
]

Array = NDArray[np.float64]

AIM, RETURNING, MET, NEW = 0, 1, 2, 3
"""Places in the array: where it is to be [m]; whether it is on the way back to the commands; for how many ticks it has
been with them; whether it has not followed yet."""

FORCE, DEPTH, LOWEST, HIGHEST, SPEED, ACCELERATION, MASS, RETURN_SPEED = 4, 5, 6, 7, 8, 9, 10, 11
HOLD_AFTER, UNLOAD_AFTER, RETREATS = 12, 13, 14
"""What stays: the numbers of `SafetyLimits`."""

PERIOD = 15
"""T [s]."""

IN_SPACE, NEAREST = 16, 17
"""Whether the aim is brought into space, and the motion limited there; and where the place that the robot was told
there is against the surface [m], which on a curved one is not quite the aim."""

FASTEST, SHIFTED = 18, 19
"""What the motion limits are told beside the aim: how fast it may go deeper, negative where it has to go back [m/s],
and by how far the aim was set elsewhere [m]."""

GUARD = 20
"""From here on the numbers of its `ForceGuard`."""

MOTION = GUARD + GUARD_SIZE
"""And of its `MotionLimits`; in space the position and velocity in it are those along the normal."""

SIZE = MOTION + MOTION_SIZE

FOLLOWING, GUARDED, RETURNS = int(Status.FOLLOWING), int(Status.GUARDED), int(Status.RETURNING)
HOLDING, UNLOADING, RETREATING = int(Status.HOLDING), int(Status.UNLOADING), int(Status.RETREATING)
STOPPED, SENSOR_FAULT = int(Status.STOPPED), int(Status.SENSOR_FAULT)

_impact = compiled(impact_speed)


def _decide(memory: Array, stopped: bool, silence: float, faulty: bool) -> int:
    """What it does: a `Status`. Whatever is none of the commands' has a way back to them."""
    if stopped:
        status = STOPPED
    elif faulty:
        status = SENSOR_FAULT
    elif silence >= memory[UNLOAD_AFTER]:
        status = RETREATING if memory[RETREATS] != 0.0 else UNLOADING
    elif silence >= memory[HOLD_AFTER]:
        status = HOLDING
    else:
        return RETURNS if memory[RETURNING] != 0.0 else FOLLOWING
    memory[RETURNING], memory[MET] = 1.0, 0.0
    return status


_decided = compiled(_decide)


def _fastest(memory: Array, status: int, position: float, surface: float, surface_doubt: float) -> float:
    """How fast it may go deeper, negative where it has to go back [m/s]."""
    guard = memory[GUARD:MOTION]
    stiffness, damping = STIFFEST, MOST_DAMPED  # that are reckoned with
    if not (math.isnan(surface) or math.isnan(guard[DAMPING])):
        steepest = guard[STEEPEST]
        stiffness = min(steepest, STIFFEST) if steepest != 0.0 else STIFFEST
        damping = min(HIDDEN * guard[DAMPING], MOST_DAMPED)
    back = max(allowed_speed(guard, AIMED * memory[FORCE], damping), -memory[SPEED])
    if status < HOLDING:
        inwards = min(back, _towards(memory, surface, surface_doubt, stiffness, damping))
        return float(min(inwards, memory[RETURN_SPEED]) if memory[RETURNING] != 0.0 else inwards)
    if status == RETREATING and math.isfinite(surface) and not position < surface - CLEARANCE:
        return -float(memory[RETURN_SPEED])
    if status in (STOPPED, UNLOADING, RETREATING):
        back = max(allowed_speed(guard, UNLOADED, 0.0), -memory[SPEED])
    return float(min(back, 0.0))


def _approach(memory: Array, surface: float, surface_doubt: float, stiffness: float, damping: float) -> float:
    """How fast it may come to what may be there [m/s]."""
    slow = _impact(IMPACT_SHARE * memory[FORCE], memory[MASS], stiffness)
    if damping > 0.0:
        slow = min(slow, DAMPING_SHARE * memory[FORCE] / damping)
    way = 0.0 if math.isnan(surface) else max(surface - MARGIN - surface_doubt - max(memory[AIM], memory[NEAREST]), 0.0)
    return math.sqrt(slow * slow + memory[ACCELERATION] * way)


_towards = compiled(_approach)
_fastest_now = compiled(_fastest)


def _rejoin(memory: Array, desired: float, aim: float) -> None:
    """Follow again, once the way back has been with the commands for long enough."""
    memory[MET] = 0.0 if desired > aim else memory[MET] + 1.0
    first = memory[NEW] != 0.0
    kept_up = memory[MET] > 0.0 if first else memory[MET] * memory[PERIOD] >= REJOINED_FOR
    memory[RETURNING] = 0.0 if kept_up else memory[RETURNING]
    memory[NEW] = memory[RETURNING] if first else 0.0


_rejoined = compiled(_rejoin)


def _within(memory: Array, wanted: float, surface: float) -> float:
    """Clip to depth and workspace."""
    lowest, highest = memory[LOWEST], memory[HIGHEST]
    if math.isfinite(surface):
        highest = min(highest, max(surface + memory[DEPTH], lowest))
    return float(min(max(wanted, lowest), highest))


_clipped = compiled(_within)


def _keep_safe(
    memory: Array,
    stopped: bool,
    desired: float,
    position: float,
    force: float,
    in_contact: bool,
    surface: float,
    silence: float,
    faulty: bool,
    guarded: bool,
    surface_doubt: float,
) -> tuple[float, int, bool]:
    """One tick.

    Args:
        memory: Written, shape (SIZE,).
        stopped: Whether an emergency stop is latched.
        desired: This and what follows as in `Safety.update`.
        position: [m].
        force: [N].
        in_contact: Whether that is contact.
        surface: [m].
        silence: [s].
        faulty: Whether the sensors are not to be trusted.
        guarded: Whether `desired` was held back.
        surface_doubt: [m].

    Returns:
        The position for the robot, in space the aim [m], what was done (a `Status`), and whether it presses.
    """
    guard, motion = memory[GUARD:MOTION], memory[MOTION:]
    if math.isnan(motion[POSITION]) and math.isfinite(position):
        begin(motion, position, 0.0, 0.0)
        memory[AIM] = position
    if faulty:
        observe(guard, math.nan, math.nan, False, 0.0)
    else:
        observe(guard, position, force, in_contact, motion[VELOCITY])
    status = _decided(memory, stopped, silence, faulty)
    fastest = _fastest_now(memory, status, position, surface, surface_doubt)
    # The aim in the next tick, never further inside than the path soon is, for it would press on by itself; beside it,
    # by how far it was set back for that.
    path, shifted = motion[POSITION], 0.0
    if not math.isnan(path):
        shifted = min(path + max(fastest, 0.0) * PATIENCE - memory[AIM], 0.0)
    aim = memory[AIM] + shifted + fastest * memory[PERIOD]
    if status < HOLDING:
        if math.isfinite(desired):
            _rejoined(memory, desired, aim)
        aim = min(desired if math.isfinite(desired) else memory[AIM], aim)
    if guarded and status == FOLLOWING:
        status = GUARDED
    memory[AIM] = _clipped(memory, aim, surface)
    memory[FASTEST], memory[SHIFTED] = fastest, shifted
    told = memory[AIM] if memory[IN_SPACE] != 0.0 else limited(motion, memory[AIM], max(fastest, 0.0), shifted)
    return told, status, faulty or not abs(force) <= REST_FORCE


keep_safe = compiled("Tuple((f8, i8, b1))(f8[::1], b1, f8, f8, f8, b1, f8, f8, b1, b1, f8)")(_keep_safe)
