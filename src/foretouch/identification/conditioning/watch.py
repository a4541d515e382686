"""Watches a force sensor and an encoder, and says at every sample whether they can be believed.

The types of what is compiled are stated: a driver that returns an integer where a float came before must cause no new
compilation in a loop.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.fault_kernels import (
    DROPOUT,
    ENCODER_JUMP,
    GOOD,
    HOLD,
    LEAST,
    LEAST_STEP,
    NOT_FINITE,
    OFFSET_STEP,
    SATURATED,
    SPIKE,
    STUCK,
    Loss,
    SensorState,
    Step,
    begin_loss,
    find_loss,
    find_step,
    restart_steps,
)

LEAST_SPIKE = 0.5  # Smaller spikes than this [N] are not looked for
END_RATIO = 0.02  # Distance from an end of the range that counts as at it, as a fraction of it

SENSOR_SENTENCES: Final[dict[SensorState, str]] = {
    SensorState.GOOD: "the sensors are as they should be",
    SensorState.NOT_FINITE: "force, position or time is no finite number: check the sensor's driver",
    SensorState.DROPOUT: "force and position repeat exactly: no new values come; check the cable and the bus",
    SensorState.STUCK: "the force stands although its noise should move it: the force sensor hangs",
    SensorState.SATURATED: "the force is at the end of the sensor's range: the true force may be larger",
    SensorState.OFFSET_STEP: "the force has stepped and nothing was touched: the sensor's zero is lost",
    SensorState.SPIKE: "single force samples are far off their neighbours: check the sensor's cable",
    SensorState.ENCODER_JUMP: "the position has jumped faster than the robot can move: the encoder is lost",
    SensorState.CONTACT_LOST: "the force has gone and the probe is as deep as before: the sensor has lost the contact",
    SensorState.FORCE_DISAGREES: "the drive pushes with another force than is felt: the force sensor is wrong",
}
"""Sentence of each state."""

PASSING = NOT_FINITE, DROPOUT, SPIKE
"""States that pass after `QUIET_TIME` without another finding; the others stay until `SensorWatch.reset`."""

QUIET_TIME = 0.5  # Time without another finding after which a transient fault is over [s]
DROPOUT_TIME = 0.02  # Time after which force and position that both repeat exactly are not new values [s]
STUCK_TIME = 0.1  # Time after which a force that alone repeats exactly is stuck [s]

REPEAT_FACTOR = 4.0
"""Least ratio of a repetition to the longest so far to be unusual: converters with few bits repeat too."""

NOISY_RATIO = 0.2  # Least fraction of reversing changes of a force with noise, which cannot repeat; white noise has 2/3
NOISE_SAMPLES = 50  # Number of changes over which noise is judged, about
SPIKE_FACTOR = 10.0  # Least size of a spike, as a multiple of the mean change between samples
ACTIVITY_TIME = 0.02  # Time constant of the mean change between samples [s]
LARGEST_IMPEDANCE = 600.0  # Largest ratio of the force of an impact to its speed [N s/m]
LONGEST_GAP = 0.1  # Longest gap in time [s] across which samples are compared
LARGEST_VALUE = 1e6  # Largest magnitude of a valid measurement [m, N, s: times up to 1e12]

Array = NDArray[np.float64]


class Repetition(Record):
    """How long values have repeated exactly [s]."""

    now: float
    longest: float  # so far


class Watch(Record):
    """State of a `SensorWatch`, with its settings."""

    state: int
    time: float = -math.inf  # of the newest sample [s]
    bad_until: float = -math.inf  # end of a transient fault [s]
    activity: float  # mean change of the force between samples [N]
    noisy: float  # fraction of changes that reverse
    changes: int
    change: float  # the newest [N]
    both: Repetition  # of force and position
    alone: Repetition  # of the force alone
    near_end: bool  # whether the newest sample was at an end of the range
    known: int  # of the three samples before
    force: float  # of the newest of them [N]
    positions: Annotated[Array, float, 3]  # [m], the newest first
    contacts: Annotated[Array, float, 3]  # force less the tool's [N], the newest first
    lowest: float  # end of the range [N]
    highest: float  # end of the range [N]
    largest_speed: float  # [m/s]
    mass: float  # [kg]
    step: Step
    loss: Loss


@compiled
def _restart(watch: Watch) -> None:
    """Forget the samples for comparison."""
    watch.known = 0
    watch.both.now = watch.alone.now = watch.change = 0.0
    watch.near_end = False
    restart_steps(watch.step)
    begin_loss(watch.loss)


@compiled
def _judge(watch: Watch, result: int, time: float) -> int:
    """Update the judgement: a lasting fault stays, a transient one passes a while after the last finding."""
    state = int(watch.state)
    if state != GOOD and state not in PASSING:
        return state
    if result != GOOD:
        state, watch.bad_until = result, time + QUIET_TIME
    elif time >= watch.bad_until:
        state = GOOD
    watch.state = state
    return state


@compiled
def _is_repeated(repetition: Repetition, is_new: bool, period: float, limit: float) -> bool:
    """Whether a value repeats for longer than a limit [s], and than some times its longest repetition below that."""
    if is_new and repetition.now < limit:
        repetition.longest = max(repetition.longest, repetition.now)
    repetition.now = 0.0 if is_new else repetition.now + period
    slack = 0.5 * min(period, DROPOUT_TIME / 10.0)  # sums of periods are not exact
    return bool(repetition.now + slack > max(limit, REPEAT_FACTOR * repetition.longest))


@compiled
def _repeats(watch: Watch, position: float, force: float, period: float) -> int:
    """Whether nothing new comes, from sensors that have shown noise."""
    change = force - watch.force
    if change != 0.0:
        watch.changes += 1
        reverses = 1.0 if change * watch.change < 0.0 else 0.0
        watch.noisy += (reverses - watch.noisy) / min(watch.changes, NOISE_SAMPLES)
        watch.change = change
    dropped = _is_repeated(watch.both, change != 0.0 or position != watch.positions[0], period, DROPOUT_TIME)
    stuck = _is_repeated(watch.alone, change != 0.0, period, STUCK_TIME)
    if watch.changes < NOISE_SAMPLES or watch.noisy < NOISY_RATIO:
        return GOOD
    return DROPOUT if dropped else STUCK if stuck else GOOD


@compiled
def _is_spike(watch: Watch, position: float, force: float, period: float) -> bool:
    """Whether the sample before this one stands far out, and no impact explains it."""
    if watch.known < 3:
        return False
    near, further, furthest = watch.positions[0], watch.positions[1], watch.positions[2]
    peak, before, earlier = watch.contacts[0], watch.contacts[1], watch.contacts[2]
    up, down = peak - before, peak - force
    size = min(abs(up), abs(down)) if up * down > 0.0 else 0.0
    threshold = max(LEAST_SPIKE, SPIKE_FACTOR * watch.activity)
    result = size > threshold and abs(force - before) < 0.5 * size and abs(before - earlier) < 0.5 * size
    if result and up > 0.0:
        speed = (further - furthest) / period
        slowed = speed - min(near - further, position - near) / period
        result = speed * LARGEST_IMPEDANCE < size or slowed < 0.5 * size * period / watch.mass
    weight = 1.0 - math.exp(-period / ACTIVITY_TIME)
    watch.activity += weight * (min(abs(force - peak), 3.0 * threshold) - watch.activity)
    return bool(result)


@compiled
def _compare(watch: Watch, position: float, force: float, contact: float, period: float, zero: float) -> int:
    """Compare a sample with those before it."""
    if watch.known == 0:
        return GOOD
    since = period + watch.both.now  # a value that is new
    repeated = _repeats(watch, position, force, period)
    last_but_one = (watch.positions[1], watch.contacts[1]) if watch.known == 3 else (math.nan, math.nan)
    stepped = find_step(watch.step, last_but_one, position, contact, period, zero)
    was_near, near = watch.near_end, not watch.lowest < force < watch.highest
    watch.near_end = near
    if near and was_near:
        return SATURATED
    # 20 um: an encoder's count and noise, which at high rates are fast
    if abs(position - watch.positions[0]) > watch.largest_speed * since + 2e-5:
        _restart(watch)
        return ENCODER_JUMP
    if repeated != GOOD:
        return repeated
    if _is_spike(watch, position, contact, period):
        return SPIKE
    return OFFSET_STEP if stepped else GOOD


@kernel("i8(Watch[::1], f8, f8, f8, f8, f8, f8, f8)")
def look(
    watches: NDArray[np.void],
    time: float,
    position: float,
    force: float,
    tool_force: float,
    zero: float,
    effort: float,
    slid: float,
) -> int:
    """Take one sample, as `SensorWatch.update` does: its `state` after it."""
    watch = watches[0]
    loss, step = watch.loss, watch.step
    loss.uncertain = False
    if not (
        abs(position) < LARGEST_VALUE
        and abs(force) < LARGEST_VALUE
        and abs(tool_force) < LARGEST_VALUE
        and abs(time) < 1e6 * LARGEST_VALUE
    ):
        _restart(watch)
        return _judge(watch, NOT_FINITE, watch.time)
    period = time - watch.time
    if not period > 0.0:
        return int(watch.state)
    contact, result = force - tool_force, GOOD
    if period > LONGEST_GAP:
        _restart(watch)
    else:
        result = _compare(watch, position, force, contact, period, zero)
    zero = zero if math.isfinite(zero) else 0.0
    lost = find_loss(loss, time, position, contact, zero, effort, slid if slid > 0.0 else 0.0)
    result = lost if result == GOOD else result
    watch.time, watch.force = time, force
    for past, newest in ((watch.positions, position), (watch.contacts, contact)):
        past[2], past[1], past[0] = past[1], past[0], newest
    watch.known = min(watch.known + 1, 3)
    # An operator who presses deeper would not feel how hard: the step being judged lowers the force, or it is too low.
    loss.uncertain = (step.age < HOLD and step.rise < 0.0 and not step.catches) or loss.low > 0
    return _judge(watch, result, time)


class SensorWatch:
    r"""Finds faults of the sensors from what they show, sample by sample and causally.

    ==================  ==============================================================================  =============
    state               found when                                                                      at the latest
    ==================  ==============================================================================  =============
    `NOT_FINITE`        time, position or force is no finite number                                     at once
    `DROPOUT`           force and position repeat exactly for 20 ms                                     20 ms
    `STUCK`             the force repeats exactly for 0.1 s while the position changes                  0.1 s
    `SATURATED`         two samples within 2 % of an end of the range                                   2 samples
    `OFFSET_STEP`       the force changes and nothing is touched: see `fault_kernels`                   50 ms, still
    `SPIKE`             a sample is far off both neighbours, and no impact explains it                  2 samples
    `ENCODER_JUMP`      the position moves faster than the largest speed                                1 sample
    `CONTACT_LOST`      the force falls and no retreat or slowing down explains it (`fault_kernels`)    3 samples
    `FORCE_DISAGREES`   the drive's own effort is another force: see `fault_kernels`                    0.1 s
    ==================  ==============================================================================  =============

    Repetitions count only once the force has shown noise, and from four times the longest repetition so far.
    A spike is larger than 0.5 N and than ten times the mean change between samples (20 ms), and twice what the samples
    around it differ by. A contact of one sample is none: the probe came fast enough for it (600 N s/m) and was slowed
    as that impulse slows a mass,

    .. math:: v \ge F / Z, \quad \Delta v \ge F T / (2 m)

    The first lasting fault stays until `reset`; the transient ones pass 0.5 s after the last finding. `update` never
    raises, costs the same at every sample, and holds a fixed number of numbers. A sample that is not later than the one
    before is left out.

    What it cannot see: an offset step below 0.3 N or the contact floor; one in contact while the probe moves, of a
    robot that does not measure the effort of its drive; drift; a wrong scale; and a sensor that is dead before it
    touches.

    Args:
        force_range: Smallest and largest force that the sensor can show [N]; infinite for an end that is not known, or
            at which the sensor may rest; None for both.
        largest_speed: No motion is faster [m/s], positive; an encoder's count is allowed on top.
        moving_mass: The most that an impact slows: carriage and tool [kg], positive.
        contact_floor: Friction and the like show at most this as a force [N], not negative: it steps by as much.
        memory: Array of one `Watch` for the state, part of another record; None for one of its own.

    Attributes:
        state: The newest judgement.

    Raises:
        SettingError: A setting out of range.
    """

    __slots__ = ("_first", "_look", "_memory", "state")

    def __init__(
        self,
        force_range: tuple[float, float] | None = None,
        *,
        largest_speed: float = 1.0,
        moving_mass: float = 1.0,
        contact_floor: float = 0.0,
        memory: NDArray[np.void] | None = None,
    ) -> None:
        low, high = (-math.inf, math.inf) if force_range is None else force_range
        if not low < high:
            raise SettingError("force_range", force_range, "the largest force must be above the smallest")
        require("largest_speed", largest_speed, above=0.0)
        require("moving_mass", moving_mass, above=0.0)
        require("contact_floor", contact_floor, at_least=0.0)
        near = [0.0 if math.isinf(end) else END_RATIO * abs(end) for end in (low, high)]
        ends = {"lowest": low + near[0], "highest": high - near[1]}
        self._first = Watch.new(**ends, largest_speed=largest_speed, mass=moving_mass)
        self._first["step"]["least"] = max(LEAST_STEP, contact_floor)
        self._first["loss"]["least"] = max(LEAST, contact_floor)
        self._look, self._memory = look.entry, Watch.new() if memory is None else memory
        self.reset()

    def reset(self) -> None:
        """Believe the sensors again, and forget all samples: say this when they have been looked after."""
        self._memory[:] = self._first
        self.state = SensorState.GOOD

    def update(
        self,
        time: float,
        position: float,
        force: float,
        tool_force: float = 0.0,
        *,
        zero: float = math.nan,
        effort: float = math.nan,
        slid: float = 0.0,
    ) -> SensorState:
        """Take one sample and judge the sensors.

        Args:
            time: [s], of a monotonic clock.
            position: [m].
            force: As the sensor gives it [N]: what is computed from it no longer repeats when the sensor does.
            tool_force: The part of it that the tool's weight and inertia make [N], where that is known: without it, a
                jerked tool can look like a fault.
            zero: What is left of it in free air [N]; NaN where that is not known.
            effort: What the drive pushes inwards with, beyond weight and inertia [N]; NaN where it is not measured.
            slid: By how much the probe has moved across the surface since the sample before [m].
        """
        return self.taken(self._look(self._memory, time, position, force, tool_force, zero, effort, slid))

    def taken(self, state: int) -> SensorState:
        """Take over the judgement of compiled code."""
        if state != self.state:
            self.state = SensorState(state)
        return self.state
