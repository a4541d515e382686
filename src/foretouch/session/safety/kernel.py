"""One tick of `foretouch.session.safety.safety.Safety`, compiled: the rules are in its docstring, in the same order."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.messages import Status
from foretouch.session.safety.force_guard import AIMED, AWAY, PATIENCE, ForceGuard, allowed_speed, observe
from foretouch.session.safety.motion import Path, begin, limited, set_path
from foretouch.session.safety.proven_way import CELL, CELLS, ProvenWay, observe_way, proven_force, proven_speed

PROVEN_FRACTION = 0.75
"""Fraction of the ceiling up to which a crossing at one speed permits a higher one: a robot that sets out overshoots
its speed."""

MARGIN, BRAKING_DELAY = 5e-4, 5e-3
"""Distance before a lower speed limit at which the robot has braked to it [m], and delay of the robot's motion [s]."""

START_BACK = 3e-5
"""Distance outside its measured position at which a robot that presses begins [m]: an encoder's count may show it
deeper than it is, and it would press on."""

UNLOADED, REST_FORCE = 0.5, 1.0  # Force to which a robot unloads, and largest force that counts as unloaded [N]

REJOINED_FOR = 0.3
"""Time for which a robot keeps up with the commands before it follows them again [s]: longer than the playout takes to
lead from where it was held to where they are."""

CLEARANCE = 5e-3  # Distance by which a retreating robot leaves the contact that it was in [m]


class Limits(Record):
    """Fields of `foretouch.session.safety.safety.SafetyLimits`, in their order."""

    force: float
    depth: float
    workspace: Annotated[NDArray[np.float64], float, 2]
    speed: float
    acceleration: float
    jerk: float
    mass: float
    stiffest: float
    most_damped: float
    return_speed: float
    hold_after: float
    unload_after: float
    retreats: bool


class Memory(Record):
    """State of a `Safety`, with its constants."""

    limits: Limits
    period: float  # T [s]
    impedance: float  # Z [N s/m]
    aim: float = math.nan  # [m]
    returning: bool  # to the commands
    met: int  # ticks in which it has been with the commands
    fresh: bool = True  # it has not followed yet: nothing leads from anywhere
    came: float = math.nan  # its commanded position when this contact began [m], NaN for none
    faulty_for: float  # [s]
    nearest: float = -math.inf  # in space, its commanded point against the surface [m]: on a curved one not the aim
    nearing: float  # speed, in space, at which motion along the surface may bring the robot nearer to it [m/s]
    holds: bool = True  # whether what was proven of the way holds here, in space
    higher: float  # in space, how much nearer the surface may be than where that was proven [m]
    fastest: float  # speed at which it may go deeper now, negative where it has to retreat [m/s]
    shifted: float  # displacement of the aim by a limit in the newest tick [m], not positive: it is no motion
    guard: ForceGuard
    motion: Path  # in space position and velocity along the normal
    way: ProvenWay


REACTION = 3e-3
"""Time after its first touch for which a robot keeps its speed before it stops [s]: the delay of its sensor and drive.
The simulated arm takes 2.3 to 2.8 ms."""


def impact_impedance(stiffness: float, damping: float, mass: float, reaction: float) -> float:
    r"""Largest force of an impact for each m/s of its speed [N s/m].

    A probe meets a surface at a speed v. Assumed is

    1. of the material: while the probe goes deeper it is a spring beside a damper. The spring pushes with e(x), which
       is 0 at the surface, nowhere negative, and grows by at most K a metre, the damper with 0 to :math:`b \dot x`;
    2. of sensor and drive: until the time tau after the first touch the probe is no faster than v, however hard the
       drive pushes for that;
    3. of the drive from then on: no matter what it does, the work that it does on the probe of mass m is not positive.

    Then the contact force never exceeds Z v, until the probe first comes to rest, with

    .. math::
        Z = \begin{cases} b + K \tau & b \tau \ge m \\
        \sqrt{(K \tau^2 + m)(K + b^2 / m)} & \text{else} \end{cases}

    For until tau, :math:`x \le v \tau` and :math:`\dot x \le v`: the force is at most :math:`(b + K \tau) v`. From then
    on :math:`\tfrac12 m \dot x^2 + \int e\, dx` does not grow, nor does the speed, and :math:`e\, de \le K e\, dx`, so
    that e squared grows by at most 2 K times what the spring takes up: with :math:`\dot x = s v`, s from 0 to 1,

    .. math:: e + b \dot x \le v \Big(b s + \sqrt{(K \tau)^2 + m K (1 - s^2)}\Big)

    whose largest value over s is at s = 1 where :math:`b \tau \ge m`, and else inside. For tau = 0 and b = 0 it is
    :math:`v \sqrt{m K}`, what the energies of a mass and a spring give.

    Args:
        stiffness: K [N/m], positive.
        damping: b [N s/m], not negative.
        mass: m [kg], positive.
        reaction: tau [s], not negative.
    """
    if damping * reaction >= mass:
        return damping + stiffness * reaction
    return math.sqrt((stiffness * reaction * reaction + mass) * (stiffness + damping * damping / mass))


_impedance = compiled(impact_impedance)


@kernel("b1(Memory[::1], f8)")
def set_limits(memories: NDArray[np.void], period: float) -> bool:
    """Take the limits that stand in one `Memory`, in which nothing has moved yet, for ticks of this period T [s].

    Returns whether they are limits: False where one of them, or the period, is not above 0, or where unloading would
    begin before holding.
    """
    memory = memories[0]
    limits = memory.limits
    memory.period = period
    memory.impedance = _impedance(limits.stiffest, limits.most_damped, limits.mass, REACTION)
    set_path(memory.motion, limits.speed, limits.acceleration, limits.jerk, period)
    moves = period > 0.0 and limits.speed > 0.0 and limits.acceleration > 0.0 and limits.jerk > 0.0
    presses = limits.force > 0.0 and limits.depth > 0.0 and limits.mass > 0.0 and limits.return_speed > 0.0
    meets = limits.stiffest > 0.0 and limits.most_damped > 0.0
    return bool(moves and presses and meets and 0.0 < limits.hold_after <= limits.unload_after)


FOLLOWING, GUARDED, RETURNS = int(Status.FOLLOWING), int(Status.GUARDED), int(Status.RETURNING)
HOLDING, UNLOADING, RETREATING = int(Status.HOLDING), int(Status.UNLOADING), int(Status.RETREATING)
STOPPED, SENSOR_FAULT = int(Status.STOPPED), int(Status.SENSOR_FAULT)


@compiled
def _decide(memory: Memory, stopped: bool, silence: float, faulty: bool) -> int:
    """Decide the `Status`. All but following the commands is left by a return to them."""
    if stopped:
        status = STOPPED
    elif faulty:
        status = SENSOR_FAULT
    elif silence >= memory.limits.unload_after:
        status = RETREATING if memory.limits.retreats else UNLOADING
    elif silence >= memory.limits.hold_after:
        status = HOLDING
    else:
        return RETURNS if memory.returning else FOLLOWING
    memory.returning, memory.met = True, 0
    return status


@compiled
def _ahead(memory: Memory) -> float:
    """Commanded depth, in space of the commanded point, against the surface [m]."""
    return float(max(memory.aim, memory.nearest))


@compiled
def _fastest(memory: Memory, status: int, position: float, surface: float, free: float) -> float:
    """Largest speed at which it may go deeper, negative where it has to retreat [m/s]."""
    guard, limits = memory.guard, memory.limits
    aimed = AIMED * limits.force
    if status < HOLDING:
        ahead = _ahead(memory)
        untouched = not ahead < free and _proven(memory, ahead, aimed) == 0.0
        inwards = max(allowed_speed(guard, aimed, limits.most_damped if untouched else 0.0), -limits.speed)
        inwards = min(inwards, _approach(memory, free))
        return float(min(inwards, limits.return_speed) if memory.returning else inwards)
    if status == RETREATING and math.isfinite(surface) and not position < surface - CLEARANCE:
        return -float(limits.return_speed)
    unloads = status in (STOPPED, UNLOADING, RETREATING)
    back = max(allowed_speed(guard, UNLOADED if unloads else aimed, 0.0), -limits.speed)
    if (status == STOPPED or memory.faulty_for >= limits.unload_after) and _is_inside(memory):
        back = min(back, -limits.return_speed)
    return float(min(back, 0.0))


@compiled
def _is_inside(memory: Memory) -> bool:
    """Whether it has not yet left this contact along its path into it."""
    return bool(memory.motion.position[0] > memory.came - AWAY)


@compiled
def _proven(memory: Memory, position: float, allowed: float) -> float:
    """Speed at which a position may be crossed, by what the robot's motion has proven [m/s]."""
    return proven_speed(memory.way, position + memory.higher, allowed) if memory.holds else 0.0


@compiled
def _approach(memory: Memory, free: float) -> float:
    """Largest speed of approach to a possible obstacle [m/s], through air known to be free up to a position [m]."""
    way, limits, felt, aim = memory.way, memory.limits, memory.guard.force, _ahead(memory)
    if not (math.isfinite(felt) and abs(aim) < 1e6):
        return 0.0
    late = 0.5 * limits.acceleration * BRAKING_DELAY
    begin = max(aim, free) if math.isfinite(free) else aim
    first, fastest = math.floor(begin / CELL), limits.speed
    for cell in range(first, first + CELLS):
        away = max(max(cell * CELL, begin) - aim - MARGIN, 0.0)
        if math.sqrt(late * late + limits.acceleration * away) - late >= fastest:
            break
        middle = (cell + 0.5) * CELL
        pressed = middle + memory.higher
        # A robot that has left a material does not feel how hard it presses at that depth.
        hidden = max(felt, proven_force(way, pressed - CELL), proven_force(way, pressed))
        unproven = max(max(AIMED * limits.force - hidden, 0.0) / memory.impedance - memory.nearing, 0.0)
        allowed = max(_proven(memory, middle, PROVEN_FRACTION * limits.force), unproven) + late
        fastest = min(fastest, math.sqrt(allowed * allowed + limits.acceleration * away) - late)
    return float(fastest)


@compiled
def _rejoin(memory: Memory, desired: float, aim: float) -> None:
    """Follow again, once the return has kept up with the commands for long enough."""
    memory.met = 0 if desired > aim else memory.met + 1
    kept_up = memory.met > 0 if memory.fresh else memory.met * memory.period >= REJOINED_FOR
    memory.returning = memory.returning and not kept_up
    memory.fresh = memory.fresh and memory.returning


@compiled
def _clip(limits: Limits, wanted: float, surface: float) -> float:
    """Clip to depth and workspace."""
    lowest, highest = limits.workspace[0], limits.workspace[1]
    if math.isfinite(surface):
        highest = min(highest, max(surface + limits.depth, lowest))
    return float(min(max(wanted, lowest), highest))


@compiled
def _see(memory: Memory, position: float, force: float, in_contact: bool, faulty: bool) -> None:
    """Take the sensors' readings, if they can be believed."""
    guard = memory.guard
    memory.faulty_for = memory.faulty_for + memory.period if faulty else 0.0
    if faulty or not (math.isfinite(position) and math.isfinite(force)):
        observe(guard, math.nan, math.nan, False)
        return
    observe(guard, position, force, in_contact)
    observe_way(memory.way, position, force, memory.period)
    if math.isnan(guard.onset):
        memory.came = math.nan
    elif math.isnan(memory.came):
        path = memory.motion.position[0]
        memory.came = position if math.isnan(path) else path


@kernel("Tuple((f8, i8))(Memory[::1], b1, f8, f8, f8, b1, f8, f8, b1, b1, f8, b1)")
def keep_safe(
    memories: NDArray[np.void],
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
) -> tuple[float, int]:
    """One tick of one `Memory`, all but the limits of the motion: the aim [m] and the `Status`.

    Given are whether a stop is latched, and the commanded position [m]; the robot's position [m], the force on it [N],
    and whether that is contact; the surface that was felt [m], NaN for none; the time since the newest fresh command
    [s], infinite before the first; whether the sensors are wrong; whether the command was held back for a first touch;
    up to where the air is free though the robot has not gone there [m]; and whether the force is being judged:
    meanwhile it goes no deeper.
    """
    memory = memories[0]
    motion = memory.motion
    if math.isnan(motion.position[0]) and math.isfinite(position):
        memory.aim = position if abs(force) <= REST_FORCE else position - START_BACK
        begin(motion, memory.aim, 0.0, 0.0)
    _see(memory, position, force, in_contact, faulty)
    status = _decide(memory, stopped, silence, faulty)
    fastest = _fastest(memory, status, position, surface, free)
    if uncertain:
        fastest = min(fastest, 0.0)
    # The aim in the next tick, never more than 10 ms ahead of the path, for it would press on by itself; and the
    # displacement of the aim by that limit.
    path, shifted = motion.position[0], 0.0
    if not math.isnan(path):
        shifted = min(path + max(fastest, 0.0) * PATIENCE - memory.aim, 0.0)
    aim = memory.aim + shifted + fastest * memory.period
    if status < HOLDING:
        if math.isfinite(desired):
            _rejoin(memory, desired, aim)
        aim = min(desired if math.isfinite(desired) else memory.aim, aim)
    if guarded and status == FOLLOWING:
        status = GUARDED
    memory.aim = _clip(memory.limits, aim, surface)
    memory.fastest, memory.shifted = fastest, shifted
    return float(memory.aim), status


@kernel("f8(Memory[::1])")
def limit(memories: NDArray[np.void]) -> float:
    """Along a line, the position for the robot [m] with this tick's aim; NaN before the robot's position is known."""
    memory = memories[0]
    return limited(memory.motion, memory.aim, max(memory.fastest, 0.0), memory.shifted)


REST_SPEED, SEEN_AT_REST = 5e-3, 1e-2
"""Largest speed of the path, and largest velocity of the robot by its encoder, of a robot at rest [m/s]."""


@kernel("b1(Path, f8, f8)")
def may_release(path: Path, velocity: float, force: float) -> bool:
    """Whether a robot is at rest, and may be let follow again: its path, velocity [m/s], and the force on it [N]."""
    x, y, z = path.velocity[0], path.velocity[1], path.velocity[2]
    speed = math.sqrt(x * x + y * y + z * z)
    return bool(speed <= REST_SPEED and abs(velocity) <= SEEN_AT_REST and abs(force) <= REST_FORCE)
