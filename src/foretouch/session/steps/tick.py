"""A tick of the follower, compiled: what happens in it whether or not messages come, over one record.

Commands are played (`foretouch.session.network.playout`), `sense` watches the sensors, `learn_raw` of a contact map
conditions and learns, in space place by place, and `allow` guards the first touch and says how far the robot may go;
the limits of its motion come last. `tick` is all of them along a line, and in space that is
`foretouch.session.spatial.probe.tick`. Where another estimator learns, or something is requested at the robot, they are
called one by one.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.identification.conditioning.fault_kernels import GOOD
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR, Conditioning
from foretouch.identification.conditioning.kernel import Memory as Conditioner
from foretouch.identification.conditioning.watch import Watch, look
from foretouch.identification.contact_map.kernel import Learning, learn_raw
from foretouch.identification.contact_map.state import Bank
from foretouch.identification.scale_field_kernel import ScaleState
from foretouch.messages import Status
from foretouch.session.network.playout import Playing, advance
from foretouch.session.safety.force_guard import Touch, follow, guarded_position
from foretouch.session.safety.kernel import Memory, keep_safe, limit

LEAST_RATE, AGAIN_FROM = 500, 600
"""Tick rate below which a loop is too slow, half of that for which limits and filters are made, and from which it is
fast enough again [1/s]: the hysteresis keeps the judgement from flickering."""

WINDOW = 500  # Number of ticks over which the rate is taken: a second at the least rate, half a second at the usual one
LONGEST_NS = 250_000_000  # Largest time that one tick counts for [ns]: a process that stood still once is not slow
USUAL_NS = 1_000_000  # Period assumed of a loop before its first tick [ns]


class Rate(Record):
    """Whether a loop is too slow, by the time that its last 500 ticks took: constant time and memory a tick.

    It is too slow where they took longer than 1 s, that is below 500 a second, and until they have taken less than
    0.83 s, 600 a second.
    """

    periods: Annotated[NDArray[Any], int, WINDOW] = USUAL_NS  # type: ignore[assignment]  # ring [ns]
    total: int = WINDOW * USUAL_NS  # [ns]
    at: int  # index of the oldest
    too_slow: bool


@kernel("b1(Rate, i8)")
def is_too_slow(rate: Rate, period_ns: int) -> bool:
    """Take one tick, this time after the one before [ns], 0 in the first; whether the loop is too slow."""
    period_ns = min(max(period_ns, 0), LONGEST_NS)
    rate.total += period_ns - rate.periods[rate.at]
    rate.periods[rate.at] = period_ns
    rate.at = (rate.at + 1) % WINDOW
    rate.too_slow = rate.total * (AGAIN_FROM if rate.too_slow else LEAST_RATE) > WINDOW * 1_000_000_000
    return bool(rate.too_slow)


EFFORT_FROM, EFFORT_UNCERTAINTY = 0.3, 0.5
"""Fraction of the force ceiling above which the drive's force counts as felt, and the part of it [N] subtracted as
friction of the drive. A sensor that is dead from the start is pressed into bone with 16.2 N at a fraction of 0.5, 14.5
at 0.3 and 14.4 at 0.2."""


class Follower(Record):
    """What a follower knows of its robot, the state of what happens in each tick, and what a tick has sensed."""

    zero: float  # sensor reading in free air beside its tool [N], 0 where it is estimated
    compliance: float  # of arm, sensor and tip in series [m/N]
    tool_mass: float  # [kg]
    gravity: float  # along the approach [m/s^2]
    moved_mass: float  # [kg]
    largest_offset: float  # of the sensor [N]
    watch: Annotated[NDArray[Any], Watch, 1]
    touch: Annotated[NDArray[Any], Touch, 1]
    safety: Annotated[NDArray[Any], Memory, 1]
    playing: Annotated[NDArray[Any], Playing, 1]
    rate: Rate
    free: float = -math.inf  # position up to which the air is free though the robot has not gone there; in space [m]
    slid: float  # motion of the probe across the surface since the last tick, in space [m]
    position: float  # of the tip in this tick [m]
    force: float  # of the sensor less tool and zero in this tick [N]
    validity: int  # of the sensors in this tick
    status: int  # in this tick
    obstructed: bool  # the robot has met something on its way, and no command has led back since


HOLDING, TOO_SLOW, OBSTRUCTED = int(Status.HOLDING), int(Status.TOO_SLOW), int(Status.OBSTRUCTED)

_advance, _look, _guarded = advance.function, look.function, guarded_position.function
_keep_safe, _limit, _is_too_slow = keep_safe.function, limit.function, is_too_slow.function

Records = NDArray[np.void]
States = tuple[Records, Conditioner, Records]
"""Of the follower, of the conditioner, whose rings have room, and of the learner: what a tick writes."""

Showing = tuple[float, float, float, float, float, float, bool, float]
"""A `foretouch.robot.RobotSample`."""


@compiled
def sense(states: States, sample: Showing, now_ns: int) -> int:
    r"""Watch the sensors; write validity, position of the tip and sensor force of this tick, and return the first.

    .. math:: F = F_{sensor} - m (\ddot p - g) - F_0, \quad p = x - F / k

    with the encoders' x, and the compliance 1 / k less the offset of the force, if these are known.
    """
    follower, offset = states[0][0], states[1][0][0].zero
    position, sensor_force, acceleration, effort = sample[0], sample[1], sample[2], sample[7]
    tool_force, time = follower.tool_mass * (acceleration - follower.gravity), now_ns * 1e-9
    force = sensor_force - tool_force - follower.zero
    zero = min(offset, follower.largest_offset) + follower.zero
    effort -= follower.moved_mass * acceleration
    follower.validity = _look(follower.watch, time, position, sensor_force, tool_force, zero, effort, follower.slid)
    give = 0.0
    if follower.compliance > 0.0:
        give = follower.compliance * (force - offset if math.isfinite(offset) else force)
    follower.position, follower.force = position - give if math.isfinite(give) else position, force
    return int(follower.validity)


@compiled
def feel(states: States) -> tuple[float, bool]:
    """Force that counts as felt [N], and whether that is contact.

    A follower that begins in contact learns that force as the sensor's offset: an excess over any offset is felt. So is
    the effort of the drive, where a wrong sensor would do harm.
    """
    follower, newest = states[0][0], states[2][0].newest[0]
    unexplained, felt = follower.force - follower.largest_offset, newest.force
    effort = follower.watch[0].loss.effort
    witnessed = effort > EFFORT_FROM * follower.safety[0].limits.force
    felt = unexplained if unexplained > felt else felt
    if witnessed and effort - EFFORT_UNCERTAINTY > felt:
        felt = effort - EFFORT_UNCERTAINTY
    return felt, bool(newest.in_contact or unexplained > CONTACT_FLOOR or witnessed)


Times = tuple[int, int, int, int]
"""Of this tick; of the newest fresh command, negative before the first; since the last tick; and of the first tick that
was learnt from [ns]."""

NOTHING = -1  # What was done by learning where nothing is learnt


@compiled
def learn(states: States, banks: Records, fields: Records | None, times_ns: Times) -> tuple[int, bool]:
    """Learn, where the sensors are valid, and return what `learn_raw` does."""
    (followers, conditioner, learnings), done = states, (NOTHING, False)
    if followers[0].validity == GOOD:
        raw = (times_ns[0] - times_ns[3]) * 1e-9, followers[0].position, followers[0].force
        done = learn_raw(banks, fields, conditioner, learnings, raw, 0.0, False)
    return done


Allowed = tuple[float, int]
"""An aim, or along a line the position for the robot [m], and the `Status`."""


@compiled
def allow(states: States, position: float, times_ns: Times, guarded: bool, desired: float, stopped: bool) -> Allowed:
    """The aim for a commanded position, NaN for none, with the robot at a position [m]: first touch, then safety."""
    follower, touch, limits = states[0][0], states[0][0].touch[0], states[0][0].safety[0].limits
    now_ns, heard_ns, period_ns, _ = times_ns
    faulty = follower.validity != GOOD
    felt, touches = feel(states)
    if follower.compliance > 0.0 and not faulty and touches:  # commands give the position of the tip
        desired += follower.compliance * min(max(felt, 0.0), limits.force)
    known = follower.playing[0].surface  # to the leader
    if not guarded or math.isnan(desired):
        follow(touch)
    else:
        desired = _guarded(follower.touch, desired, position, math.nan if faulty else felt, touches, known)
    silence = math.inf if heard_ns < 0 else (now_ns - heard_ns) * 1e-9
    too_slow = _is_too_slow(follower.rate, period_ns)
    if too_slow or follower.obstructed:
        silence = max(silence, limits.hold_after)
    surface, held_back, uncertain = states[1][0][0].surface, touch.held_back != 0.0, follower.watch[0].loss.uncertain
    safety, free = follower.safety, follower.free
    aim, status = _keep_safe(
        safety, stopped, desired, position, felt, touches, surface, silence, faulty, held_back, free, uncertain
    )
    if status == HOLDING:
        status = OBSTRUCTED if follower.obstructed else TOO_SLOW if too_slow else HOLDING
    follower.status = status
    return aim, int(follower.status)


Shown = tuple[float, float, bool, float, float, bool]
"""Position of the tip [m]; sensor force less tool and zero [N]; whether the command was held back for a first touch;
then velocity [m/s], force [N] and contact that were learnt from."""

Acted = tuple[Allowed, int, Shown]
"""Of a tick: what is allowed, the validity of the sensors, and what is shown."""


@compiled
def show(states: States, allowed: Allowed) -> Acted:
    """What Python is told of a tick."""
    follower, newest = states[0][0], states[2][0].newest[0]
    position, force, held_back = follower.position, follower.force, follower.touch[0].held_back != 0.0
    shown = float(position), float(force), bool(held_back), newest.velocity, newest.force, newest.in_contact
    return allowed, int(follower.validity), shown


@compiled
def allow_on_axis(
    states: States, position: float, times_ns: Times, guarded: bool, desired: float, stopped: bool
) -> Acted:
    """`allow`, and the limits of the motion: the robot's position in place of the aim."""
    _, status = allow(states, position, times_ns, guarded, desired, stopped)
    return show(states, (_limit(states[0][0].safety), status))


@compiled
def tick(
    states: States, banks: Records, fields: Records | None, sample: Showing, times_ns: Times, guarded: bool
) -> tuple[Acted, bool, tuple[int, bool]]:
    """A tick along a line in which a contact map learns, and nothing is requested at the robot."""
    sense(states, sample, times_ns[0])
    desired = _advance(states[0][0].playing)
    learnt = learn(states, banks, fields, times_ns)
    return allow_on_axis(states, sample[0], times_ns, guarded, desired, False), False, learnt


LEARNT = Follower, Conditioning, Learning, Bank, ScaleState
STATES = "Tuple((Follower[::1], Tuple((Conditioning[::1], f8[:, ::1])), Learning[::1]))"
SAMPLE, GUARDED = "Tuple((f8, f8, f8, f8, f8, f8, b1, f8))", "UniTuple(i8, 4), b1"

tick_at_once = Kernel(tick, f"({STATES}, Bank[::1], none, {SAMPLE}, {GUARDED})", *LEARNT)
sense_alone = Kernel(sense, f"i8({STATES}, {SAMPLE}, i8)", *LEARNT)
feel_alone = Kernel(feel, f"({STATES},)", *LEARNT)
allow_alone: Kernel[..., Any] = Kernel(allow_on_axis, f"({STATES}, f8, {GUARDED}, f8, b1)", *LEARNT)
