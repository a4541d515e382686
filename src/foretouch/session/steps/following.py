"""The follower's step along a line in which a contact map learns, compiled: for callers without Python.

It is made of what `foretouch.session.steps.follower` calls one by one.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.identification.conditioning.fault_kernels import GOOD
from foretouch.identification.conditioning.kernel import Conditioning, is_full
from foretouch.identification.conditioning.watch import Watch
from foretouch.identification.contact_map.kernel import Learning
from foretouch.identification.contact_map.scores import LONGEST_HORIZON
from foretouch.identification.contact_map.state import Bank
from foretouch.identification.exact.belief import FEWEST_UPDATES
from foretouch.messages.schema import LONGEST_NAME
from foretouch.models.contact_map.layout import SIZE, Map
from foretouch.models.contact_map.wire import shrink
from foretouch.models.predictor_kernel import copy
from foretouch.quantities.pose import Vector
from foretouch.session.network.freshness import FRESH
from foretouch.session.network.lease import number_of_bytes
from foretouch.session.network.model_sender import begin_sending, is_due, note_size
from foretouch.session.network.playout import advance, forget
from foretouch.session.network.round_trip import note_applied
from foretouch.session.safety.kernel import may_release
from foretouch.session.steps import tick as stages
from foretouch.session.steps.hearing import Hearing, felt_command, hear, note_felt, obey
from foretouch.session.steps.tick import Follower, Showing

_advance, _hear, _obey = advance.function, hear.function, obey.function
_shrink, _may_release = shrink.function, may_release.function

RING_ROOM = 1024  # Samples of the newest 50 ms for which there is room: twenty times as many as a loop at 1 kHz has

NOWHERE: Vector = (math.nan, math.nan, math.nan)


class ShownFollower(Record):
    """What a tick came to; the fields of `foretouch.messages.Telemetry` of the same names."""

    desired_position: float = math.nan  # for the robot [m]; NaN before its position is known
    position: float = math.nan  # of the tip [m]
    velocity: float  # of the tip [m/s]
    sensor_force: float  # less tool and zero [N]
    force: float  # that is learnt from [N]
    in_contact: bool
    guarded: bool  # whether the command was held back for a first touch
    status: int  # see `foretouch.messages.Status`
    validity: int  # whether its sensors are believed; see `foretouch.identification.SensorState`
    command_sequence: int  # newest command at or before the playback point
    sequence: int  # number of the tick


class Published(Record):
    """A model that is due, as it crosses the network; the fields of `foretouch.messages.ModelUpdate` of these names."""

    sequence: int
    command_sequence: int
    epoch: int  # of the leader of that command
    valid: bool
    surface: float  # [m]
    parameters: Annotated[NDArray[Any], float, 4]
    state: Annotated[NDArray[Any], float, 6]
    count: int  # numbers of the map
    map: Annotated[NDArray[Any], np.float32, SIZE]  # that a force can be computed from
    sent: Annotated[NDArray[Any], Map, 1]  # scratch


class ReceivedCommand(Record):
    """A `foretouch.messages.Command` along a line as it came; the fields of these names."""

    holder: Annotated[NDArray[Any], np.uint8, 4 * LONGEST_NAME]  # in UTF-8
    holder_size: int  # [bytes]
    epoch: int
    sequence: int
    time_ns: int  # [ns]
    telemetry_sequence: int
    run: int
    position: float = math.nan  # [m]
    acknowledged_model: int
    guarded: bool


class Following(Record):
    """A follower: what it learns, what it hears, and what it told its robot."""

    followers: Annotated[NDArray[Any], Follower, 1]
    conditionings: Annotated[NDArray[Any], Conditioning, 1]
    rings: Annotated[NDArray[Any], float, (5, RING_ROOM)]
    learnings: Annotated[NDArray[Any], Learning, 1]
    banks: Annotated[NDArray[Any], Bank, 1]
    hearings: Annotated[NDArray[Any], Hearing, 1]
    watches: Annotated[NDArray[Any], Watch, 1]  # the watch of the sensors as it begins
    stopped: bool  # whether an emergency stop is latched
    start_ns: int = -1  # clock at the first tick that had a command, negative before it
    received: ReceivedCommand
    shown: ShownFollower
    published: Annotated[NDArray[Any], Published, 1]


@kernel("i8(Following, i8)")
def take(following: Following, now_ns: int) -> int:
    """Take the command in `Following.received`, which has arrived now [ns]: see `hear` and `obey` of hearing."""
    hearing, playings, c = following.hearings[0], following.followers[0].playing, following.received
    holder = number_of_bytes(c.holder[: c.holder_size])
    heard = _hear(hearing, playings, (holder, c.epoch, c.sequence, c.time_ns, c.telemetry_sequence, c.run), now_ns)
    if heard == FRESH:
        asked = c.position, 0.0, 0.0
        _obey(hearing, playings, c.sequence, c.position, NOWHERE, asked, c.acknowledged_model, c.guarded)
    return int(heard)


@compiled
def _holds(following: Following, stop: bool, release: bool, felt: float) -> bool:
    """Apply what is requested at the robot; whether the commands hold."""
    follower, hearing = following.followers[0], following.hearings[0]
    released, safety = False, follower.safety[0]
    if stop:
        following.stopped = True
    elif release and follower.validity != GOOD:  # a stop stays: the force is known from the next samples on
        copy(following.watches.view(np.float64), follower.watch.view(np.float64))
        released = True
    elif release and following.stopped:
        released = _may_release(safety.motion, following.learnings[0].newest[0].velocity, felt)
        following.stopped = not released
    if released:
        hearing.released_tick = following.shown.sequence + 1  # the first telemetry to report it
    if released or following.stopped:
        forget(follower.playing[0])
        return False
    return True


@kernel("f8(Following, Tuple((f8, f8, f8, f8, f8, f8, b1, f8)), i8, i8, b1, b1, b1)")
def tick(
    following: Following, sample: Showing, now_ns: int, period_ns: int, stop: bool, release: bool, ended: bool
) -> float:
    """A tick along a line, as `foretouch.session.steps.follower.step` says.

    Args:
        following: Written; see `ShownFollower`.
        sample: What the robot shows, as `foretouch.robot.RobotSample` has it.
        now_ns: Time of this tick by a monotonic clock [ns].
        period_ns: Time since the last tick began [ns].
        stop: Whether an emergency stop is requested.
        release: Whether its end is requested at the robot, or a repair of the sensors reported.
        ended: Whether the session is over: the robot is left as after a long silence.

    Returns:
        Position for the robot [m].
    """
    follower, hearing, shown = following.followers[0], following.hearings[0], following.shown
    conditioner = following.conditionings, following.rings
    states = following.followers, conditioner, following.learnings
    desired = _advance(follower.playing)
    if following.start_ns < 0 and follower.playing[0].applied > 0:
        following.start_ns = now_ns
    stages.sense(states, sample, now_ns)
    heard_ns = -1 if ended else hearing.judgings[0].newest_ns
    times_ns = now_ns, heard_ns, period_ns, max(following.start_ns, 0)
    if follower.validity == GOOD and following.start_ns >= 0 and not is_full(conditioner):
        stages.learn(states, following.banks, None, times_ns)
        note_felt(hearing, follower.playing[0].applied)
    felt, _ = stages.feel(states)
    if not _holds(following, stop, release, felt):
        desired = math.nan
    stopped = following.stopped
    (position, status), validity, show = stages.allow_on_axis(
        states, sample[0], times_ns, hearing.guarded, desired, stopped
    )
    shown.desired_position, shown.status, shown.validity = position, status, validity
    shown.position, shown.sensor_force, shown.guarded, shown.velocity, shown.force, shown.in_contact = show
    shown.command_sequence = follower.playing[0].applied
    shown.sequence += 1
    return float(position)


@compiled
def _publish(following: Following, now_ns: int) -> None:
    """Write the model that there is."""
    bank, learnt, hearing = following.banks[0], following.published[0], following.hearings[0]
    surface, notes = following.conditionings[0].surface, following.banks[0].notes[0]
    touched, known = not math.isnan(surface), notes.updates - notes.begun >= FEWEST_UPDATES
    maps = bank.remembered.shown if bank.coarse.traced > 0 else bank.map
    learnt.count = 0
    if touched and known:
        learnt.count = _shrink(maps, learnt.sent, learnt.map)
    learnt.valid, learnt.surface = learnt.count > 0, surface if touched else 0.0
    for index in range(4):
        learnt.parameters[index] = learnt.sent[0].law[index]
    for index in range(6):
        learnt.state[index] = bank.memory[index]
    learnt.command_sequence, learnt.epoch = felt_command(hearing), hearing.leases[0].epoch
    learnt.sequence = begin_sending(hearing.sendings[0], learnt.surface, learnt.valid, now_ns)


@kernel("b1(Following, i8)")
def publish(following: Following, now_ns: int) -> bool:
    """After a tick: whether a model is due, which is then written into `Following.published`."""
    if following.start_ns < 0:
        return False
    hearing, bank = following.hearings[0], following.banks[0]
    sending, notes = hearing.sendings[0], bank.notes[0]
    delay = note_applied(sending.trip, following.followers[0].playing[0].applied, now_ns)
    if math.isfinite(delay):
        bank.horizon = min(max(delay, 0.0), LONGEST_HORIZON)
    sending.remembers = hearing.guarded
    surface, known = following.conditionings[0].surface, notes.updates - notes.begun >= FEWEST_UPDATES
    stays = not math.isnan(surface) and (notes.updates > 0 if sending.had_model else known)
    due = is_due(sending, bank.changes, surface, stays, now_ns)
    if due:
        _publish(following, now_ns)
    return due


@kernel("(Following, i8)")
def published(following: Following, size: int) -> None:
    """Count the bytes of the model that was just written."""
    note_size(following.hearings[0].sendings[0], size)
