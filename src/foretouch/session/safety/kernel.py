"""One tick of `foretouch.session.safety.safety.Safety`, compiled: the rules are in its docstring, in the same order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.messages import Status
from foretouch.session.safety.force_guard import AWAY, ONSET, PATIENCE, allowed_speed, observe
from foretouch.session.safety.force_guard import FORCE as FELT
from foretouch.session.safety.force_guard import SIZE as GUARD_SIZE
from foretouch.session.safety.motion import POSITION, begin, limited
from foretouch.session.safety.motion import SIZE as MOTION_SIZE
from foretouch.session.safety.proven_way import CELL, CELLS, observe_way, proven_force, proven_speed
from foretouch.session.safety.proven_way import SIZE as WAY_SIZE

Array = NDArray[np.float64]

AIMED = 0.88
"""Fraction of the force ceiling that a press is brought to: the zero of a sensor that began in contact may err by 1 N,
and an arm that leaves a damped contact and stops swings back into it. At 0.95 a search led to 15.1 N in
Kelvin-Voigt."""

PROVEN_SHARE = 0.75
"""Fraction of the ceiling up to which a crossing at one speed permits a higher one: a robot that sets out overshoots
its speed."""

MARGIN, BRAKING_DELAY = 5e-4, 5e-3
"""Distance before a lower speed limit at which the robot has braked to it [m], and delay of the robot's motion [s]."""

START_BACK = 3e-5
"""Distance outside its measured position at which a robot that presses begins [m]: an encoder's count may show it
deeper than it is, and it would press on."""

UNLOADED, REST_FORCE = 0.5, 1.0
"""Force to which a robot unloads, and largest force that counts as unloaded [N]."""

REJOINED_FOR = 0.3
"""Time for which a robot keeps up with the commands before it follows them again [s]: longer than the playout takes to
lead from where it was held to where they are."""

CLEARANCE = 5e-3
"""Distance by which a retreating robot leaves the contact that it was in [m]."""

AIM, RETURNING, MET, NEW = 0, 1, 2, 3
"""Indices in the array: aim [m]; whether it is returning to the commands; number of ticks in which it has been with
them; whether it has not followed yet."""

CAME, FAULTY_FOR = 4, 5
"""Indices of the robot's commanded position when this contact began [m], NaN for none; and duration of a fault [s]."""

FORCE, DEPTH, LOWEST, HIGHEST, SPEED, ACCELERATION, RETURN_SPEED = 6, 7, 8, 9, 10, 11, 12
HOLD_AFTER, UNLOAD_AFTER, RETREATS = 13, 14, 15
"""Indices of constants from `SafetyLimits`."""

PERIOD, IMPEDANCE, DAMPING = 16, 17, 18
"""Indices of the constants T [s]; Z; and the damping assumed of an untouched region [N s/m]."""

IN_SPACE, NEAREST = 19, 20
"""Indices of whether the aim is brought into space, where the motion is limited; and of the position of the robot's
commanded point there against the surface [m], which on a curved one is not quite the aim."""

FASTEST, SHIFTED = 21, 22
"""Indices of the motion limits' inputs beside the aim: largest speed deeper, negative where it has to retreat [m/s],
and displacement of the aim by a limit [m]."""

NEARING = 23
"""Index of the speed, in space, at which motion along the surface may bring the robot nearer to it [m/s]."""

GUARD = 24
"""First index of the numbers of its `ForceGuard`."""

MOTION = GUARD + GUARD_SIZE
"""First index of those of its `MotionLimits`; in space its position and velocity are those along the normal."""

WAY = MOTION + MOTION_SIZE
"""First index of those of its `ProvenWay`."""

SIZE = WAY + WAY_SIZE

FOLLOWING, GUARDED, RETURNS = int(Status.FOLLOWING), int(Status.GUARDED), int(Status.RETURNING)
HOLDING, UNLOADING, RETREATING = int(Status.HOLDING), int(Status.UNLOADING), int(Status.RETREATING)
STOPPED, SENSOR_FAULT = int(Status.STOPPED), int(Status.SENSOR_FAULT)


@compiled
def _decide(memory: Array, stopped: bool, silence: float, faulty: bool) -> int:
    """Decide the `Status`. All but following the commands is left by a return to them."""
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


@compiled
def _ahead(memory: Array) -> float:
    """Commanded depth, in space of the commanded point, against the surface [m]."""
    return float(max(memory[AIM], memory[NEAREST]))


@compiled
def _fastest(memory: Array, status: int, position: float, surface: float, free: float) -> float:
    """Largest speed at which it may go deeper, negative where it has to retreat [m/s]."""
    guard, aimed = memory[GUARD:MOTION], AIMED * memory[FORCE]
    if status < HOLDING:
        ahead = _ahead(memory)
        untouched = not ahead < free and proven_speed(memory[WAY:], ahead, aimed) == 0.0
        inwards = max(allowed_speed(guard, aimed, memory[DAMPING] if untouched else 0.0), -memory[SPEED])
        inwards = min(inwards, _approach(memory, free))
        return float(min(inwards, memory[RETURN_SPEED]) if memory[RETURNING] != 0.0 else inwards)
    if status == RETREATING and math.isfinite(surface) and not position < surface - CLEARANCE:
        return -float(memory[RETURN_SPEED])
    unloads = status in (STOPPED, UNLOADING, RETREATING)
    back = max(allowed_speed(guard, UNLOADED if unloads else aimed, 0.0), -memory[SPEED])
    if (status == STOPPED or memory[FAULTY_FOR] >= memory[UNLOAD_AFTER]) and _is_inside(memory):
        back = min(back, -memory[RETURN_SPEED])
    return float(min(back, 0.0))


@compiled
def _is_inside(memory: Array) -> bool:
    """Whether it has not yet left this contact along its path into it."""
    return bool(memory[MOTION + POSITION] > memory[CAME] - AWAY)


@compiled
def _approach(memory: Array, free: float) -> float:
    """Largest speed of approach to a possible obstacle [m/s], through air known to be free up to a position [m]."""
    way, ceiling, felt, aim = memory[WAY:], memory[FORCE], memory[GUARD + FELT], _ahead(memory)
    if not (math.isfinite(felt) and abs(aim) < 1e6):
        return 0.0
    late = 0.5 * memory[ACCELERATION] * BRAKING_DELAY
    begin = max(aim, free) if math.isfinite(free) else aim
    first, fastest = math.floor(begin / CELL), memory[SPEED]
    for cell in range(first, first + CELLS):
        away = max(max(cell * CELL, begin) - aim - MARGIN, 0.0)
        if math.sqrt(late * late + memory[ACCELERATION] * away) - late >= fastest:
            break
        middle = (cell + 0.5) * CELL
        # A robot that has left a material does not feel how hard it presses at that depth.
        hidden = max(felt, proven_force(way, middle - CELL), proven_force(way, middle))
        unproven = max(max(AIMED * ceiling - hidden, 0.0) / memory[IMPEDANCE] - memory[NEARING], 0.0)
        allowed = max(proven_speed(way, middle, PROVEN_SHARE * ceiling), unproven) + late
        fastest = min(fastest, math.sqrt(allowed * allowed + memory[ACCELERATION] * away) - late)
    return float(fastest)


@compiled
def _rejoin(memory: Array, desired: float, aim: float) -> None:
    """Follow again, once the return has kept up with the commands for long enough."""
    memory[MET] = 0.0 if desired > aim else memory[MET] + 1.0
    first = memory[NEW] != 0.0
    kept_up = memory[MET] > 0.0 if first else memory[MET] * memory[PERIOD] >= REJOINED_FOR
    memory[RETURNING] = 0.0 if kept_up else memory[RETURNING]
    memory[NEW] = memory[RETURNING] if first else 0.0


@compiled
def _clip(memory: Array, wanted: float, surface: float) -> float:
    """Clip to depth and workspace."""
    lowest, highest = memory[LOWEST], memory[HIGHEST]
    if math.isfinite(surface):
        highest = min(highest, max(surface + memory[DEPTH], lowest))
    return float(min(max(wanted, lowest), highest))


@compiled
def _see(memory: Array, position: float, force: float, in_contact: bool, faulty: bool) -> None:
    """Take the sensors' readings, if they can be believed."""
    guard = memory[GUARD:MOTION]
    memory[FAULTY_FOR] = memory[FAULTY_FOR] + memory[PERIOD] if faulty else 0.0
    if faulty or not (math.isfinite(position) and math.isfinite(force)):
        observe(guard, math.nan, math.nan, False)
        return
    observe(guard, position, force, in_contact)
    observe_way(memory[WAY:], position, force, memory[PERIOD])
    if math.isnan(guard[ONSET]):
        memory[CAME] = math.nan
    elif math.isnan(memory[CAME]):
        path = memory[MOTION + POSITION]
        memory[CAME] = position if math.isnan(path) else path


@compiled("Tuple((f8, i8, b1))(f8[::1], b1, f8, f8, f8, b1, f8, f8, b1, b1, f8, b1)")
def keep_safe(
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
    free: float,
    uncertain: bool,
) -> tuple[float, int, bool]:
    """One tick.

    Args:
        memory: Written, shape (SIZE,).
        stopped: Whether an emergency stop is latched.
        desired: This and the following arguments are as in `Safety.update`.
        position: Position of the robot [m].
        force: Measured force [N].
        in_contact: Whether that is contact.
        surface: Position of the surface [m].
        silence: Time since the newest fresh command [s].
        faulty: Whether the sensors are not to be trusted.
        guarded: Whether `desired` was held back.
        free: End of the free air [m].
        uncertain: Whether the force is being judged.

    Returns:
        The position for the robot, in space the aim [m], the `Status`, and whether it presses.
    """
    motion = memory[MOTION:WAY]
    if math.isnan(motion[POSITION]) and math.isfinite(position):
        memory[AIM] = position if abs(force) <= REST_FORCE else position - START_BACK
        begin(motion, memory[AIM], 0.0, 0.0)
    _see(memory, position, force, in_contact, faulty)
    status = _decide(memory, stopped, silence, faulty)
    fastest = _fastest(memory, status, position, surface, free)
    if uncertain:
        fastest = min(fastest, 0.0)
    # The aim in the next tick, never more than 10 ms ahead of the path, for it would press on by itself; and the
    # displacement of the aim by that limit.
    path, shifted = motion[POSITION], 0.0
    if not math.isnan(path):
        shifted = min(path + max(fastest, 0.0) * PATIENCE - memory[AIM], 0.0)
    aim = memory[AIM] + shifted + fastest * memory[PERIOD]
    if status < HOLDING:
        if math.isfinite(desired):
            _rejoin(memory, desired, aim)
        aim = min(desired if math.isfinite(desired) else memory[AIM], aim)
    if guarded and status == FOLLOWING:
        status = GUARDED
    memory[AIM] = _clip(memory, aim, surface)
    memory[FASTEST], memory[SHIFTED] = fastest, shifted
    commanded = memory[AIM] if memory[IN_SPACE] != 0.0 else limited(motion, memory[AIM], max(fastest, 0.0), shifted)
    presses = not abs(force) <= REST_FORCE if not faulty else math.isnan(memory[CAME]) or _is_inside(memory)
    return commanded, status, presses
