"""The follower's step: takes commands and sensor samples; gives a robot position, telemetry and models.

The order is: which leader commands, which commands are fresh, whether the sensors are valid, learning, and last,
whatever was commanded, the robot's limits (`foretouch.session.safety.safety`). An exception in the earlier stages is
counted and reported, and the last stage runs all the same.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

from foretouch.identification import ContactSample, Estimator, Learner, SensorState, SensorWatch
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, FixtureBelief, ModelUpdate, Status, Telemetry
from foretouch.robot import RobotSample, RobotSpecification, SpatialSample
from foretouch.session.network.lease import ControlLease
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.network.playout import Arrival, Freshness, Playout
from foretouch.session.safety.force_guard import FirstTouch
from foretouch.session.safety.safety import Safety, SafetyLimits, Sensed
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.sensing import Failures, TickRate, calibrated
from foretouch.settings import SAFETY_LIMITS

# Constants used in every tick: a member of an enumeration costs more to look up than to compare.
GOOD = SensorState.GOOD
FRESH, FUTURE = Arrival.FRESH, Arrival.FUTURE
EFFORT_FROM, EFFORT_UNCERTAINTY = 0.3, 0.5
"""Fraction of the force ceiling above which the drive's force counts as felt, and the part of it [N] subtracted as
friction of the drive. A sensor that is dead from the start is pressed into bone with 16.2 N at a fraction of 0.5, 14.5
at 0.3 and 14.4 at 0.2."""

HOLDING, RETREATING = int(Status.HOLDING), int(Status.RETREATING)


@dataclass(slots=True)
class State:
    """State of the follower, updated in place in each tick.

    Attributes:
        specification: Specification of the robot, as calibrated: its tool is compensated in the force.
        start_ns: Clock at the first tick that had a command, None before it.
        held_ticks: Ticks in which the robot was held for want of a fresh command, since there was the first.
        guards: Whether this side's settings guard first touches.
        guarded: Whether they are guarded: by these, or because a command of this leader asks for it.
        free: Position up to which the air is free, though the robot has not gone there itself [m]: in space, before the
            surface; on a line that is never known.
        slid: Motion of the probe across the surface since the last tick [m]; on a line 0.
        felt_commands: Commands applied in the newest ticks that were learnt from, for the delay of the sensor.
        released_tick: Number of the first telemetry behind the newest release, 0 before the first release.
        before_release: Number of commands refused because their leader did not know of it.
        zero: Sensor reading in free air beside its tool [N]; None where it is estimated.
        compliance: Compliance of arm, sensor and tip in series [m/N].
    """

    specification: RobotSpecification
    learner: Learner
    run: int
    sender: ModelSender
    watch: SensorWatch = field(default_factory=SensorWatch)
    lease: ControlLease = field(default_factory=ControlLease)
    freshness: Freshness = field(default_factory=lambda: Freshness(0.5, SAMPLE_PERIOD))
    commands: SequenceCounter = field(default_factory=SequenceCounter)
    playout: Playout = field(default_factory=Playout)
    tick: int = 0
    start_ns: int | None = None
    first_touch: FirstTouch = field(default_factory=lambda: FirstTouch(0.02, 2.0, SAMPLE_PERIOD))
    safety: Safety = field(default_factory=lambda: Safety(SafetyLimits(), SAMPLE_PERIOD))
    held_ticks: int = 0
    faulty_ticks: int = 0
    guards: bool = False
    guarded: bool = False
    free: float = -math.inf
    slid: float = 0.0
    failures: Failures = field(default_factory=Failures)
    rate: TickRate = field(default_factory=TickRate)
    felt_commands: deque[int] = field(default_factory=lambda: deque(maxlen=1))
    released_tick: int = 0
    before_release: int = 0
    zero: float | None = None
    compliance: float = 0.0
    limits: SafetyLimits = field(default_factory=SafetyLimits)


Sample = TypeVar("Sample", RobotSample, SpatialSample)


class Inputs(NamedTuple, Generic[Sample]):
    """Inputs of a tick, along a line or in space.

    Attributes:
        commands: Commands that have arrived since the last tick.
        sample: Sample of the robot's sensors.
        period_ns: Time since the last tick began [ns].
        compute_ns: Computing time of the last tick [ns].
        stop: Why an emergency stop was requested; empty while none was.
        release: Whether the end of an emergency stop is requested at the robot, or a repair of the sensors reported.
        ended: Whether the session is over: the robot is left as after a long silence.
        beliefs: In space, beliefs of the fixture's pose that have arrived since the last tick.
    """

    commands: list[Command]
    sample: Sample
    period_ns: int
    compute_ns: int
    stop: str = ""
    release: bool = False
    ended: bool = False
    beliefs: Sequence[FixtureBelief] = ()


class Outputs(NamedTuple):
    """Position for the robot [m], telemetry for all subscribers, and the model for the leader when one is due."""

    desired_position: float
    telemetry: Telemetry
    model: ModelUpdate | None


def start(
    specification: RobotSpecification, settings: SessionSettings, estimator: Estimator | None = None, *, run: int = 1
) -> State:
    """State before the first tick, with the settings' estimator or another, as process `run` of this side.

    Raises as `calibrated` does.
    """
    known = calibrated(specification, settings)
    specification, force = known.specification, specification.sensor_range
    learner = Learner(
        settings.make_estimator() if estimator is None else estimator,
        force_offset=None if known.zero is None else 0.0,
        contact_floor=known.contact_floor,
        sensor_lag=known.sensor_lag,
    )
    limits = SafetyLimits(
        **{name: getattr(settings, setting) for name, setting in SAFETY_LIMITS.items()},
        workspace=specification.workspace,
        mass=specification.moved_mass,
        retreats=settings.on_silence == "retreat",
    )
    return State(
        specification,
        learner,
        run,
        ModelSender(round(1e9 / settings.model_rate), run),
        SensorWatch((-force, force), moving_mass=specification.moved_mass),
        freshness=Freshness(settings.queueing_allowance, SAMPLE_PERIOD),
        first_touch=FirstTouch(settings.approach_speed, settings.guarded_force, specification.sample_period),
        safety=Safety(limits, specification.sample_period),
        guards=settings.guards(simulated=specification.simulated),
        felt_commands=deque(maxlen=1 + round(known.sensor_lag / SAMPLE_PERIOD)),
        zero=known.zero,
        compliance=known.compliance,
        limits=limits,
    )


def step(state: State, inputs: Inputs[RobotSample], now_ns: int) -> tuple[State, Outputs]:
    """One tick of the follower, at a time of its monotonic clock [ns]; the state is updated in place and returned.

    Learning begins with the first command: no operator is active before, and a recording from the first command on
    holds all that was learnt from.
    """
    sample = inputs.sample
    desired_position = _commanded(state, inputs.commands, now_ns)
    position, force, validity = _sensed(state, sample, now_ns)
    model = _learn(state, position, force, validity, now_ns)
    desired_position = _allowed(state, desired_position, inputs, force, now_ns, validity is not GOOD)
    state.tick += 1
    learnt_from = state.learner.sample
    telemetry = Telemetry(
        VERSION,
        state.tick,
        now_ns,
        state.playout.applied,
        desired_position,
        position,
        learnt_from.velocity,
        force,
        learnt_from.force,
        sample.exact_force,
        learnt_from.in_contact,
        sample.clipped,
        state.sender.sequence,
        inputs.period_ns,
        inputs.compute_ns,
        state.first_touch.guarded,
        state.safety.status,
        validity,
        state.lease.epoch,
        state.run,
    )
    return state, Outputs(desired_position, telemetry, model)


def tip(state: State, sample: RobotSample) -> float:
    """Position of the tip [m]: p = x - F / k, with the encoders' x and the compliance 1 / k, if that is known."""
    give = state.compliance * _less_offset(state, sensor_force(state, sample)) if state.compliance else 0.0
    return sample.position - give if math.isfinite(give) else sample.position


def sensor_force(state: State, sample: RobotSample) -> float:
    """Sensor force less weight and inertia of the tool, which are no contact, and its calibrated zero [N]."""
    return sample.sensor_force - state.specification.tool_force(sample.acceleration) - (state.zero or 0.0)


def feel_plainly(state: State, force: float) -> None:
    """Take a sensor force [N] as the contact force, less the offset as far as it is known, without conditioning."""
    last, felt = state.learner.sample, _less_offset(state, force)
    state.learner.sample = ContactSample(last.time, last.depth, 0.0, felt, felt > CONTACT_FLOOR)


def _less_offset(state: State, force: float) -> float:
    offset = state.learner.conditioner.force_offset
    return force - offset if math.isfinite(offset) else force


def _commanded(state: State, commands: list[Command], now_ns: int) -> float:
    """Take the commands that have come; return the commanded position for now [m], NaN where there is none."""
    try:
        for command in commands:
            _take(state, command, now_ns)
        return state.playout.advance()  # NaN while no leader has sent a position
    except Exception as error:
        state.failures.note("its commands", error)
        return math.nan


def _sensed(state: State, sample: RobotSample, now_ns: int) -> tuple[float, float, SensorState]:
    """Position of the tip [m], force of the sensor [N], and validity of the sensors."""
    try:
        force = sensor_force(state, sample)
        tool_force = state.specification.tool_force(sample.acceleration)
        result = min(state.learner.conditioner.force_offset, state.specification.largest_offset)
        validity = state.watch.update(
            now_ns * 1e-9,
            sample.position,
            sample.sensor_force,
            tool_force,
            zero=result + (state.zero or 0.0),
            effort=sample.effort - state.specification.moved_mass * sample.acceleration,
            slid=state.slid,
        )
        return tip(state, sample), force, validity
    except Exception as error:
        state.failures.note("its sensors", error)
        return sample.position, math.nan, SensorState.NOT_FINITE


def _learn(state: State, position: float, force: float, validity: SensorState, now_ns: int) -> ModelUpdate | None:
    """Learn from this sample, if it is valid; return the model that is due."""
    playout, learner = state.playout, state.learner
    if state.start_ns is None:
        if not playout.applied:
            return None
        state.start_ns = now_ns
    time = (now_ns - state.start_ns) * 1e-9
    if state.failures.learns:
        try:
            delay = state.sender.round_trip.applied(playout.applied, now_ns)
            if delay is not None:
                learner.estimator.expect_delay(delay)
            if validity is GOOD:
                learner.update(time, position, force)
                state.felt_commands.append(playout.applied)
            # The state of the material is that of the newest sample that was learnt from, whatever is commanded since.
            felt = state.felt_commands[0] if state.felt_commands else 0
            state.sender.remembers = state.guarded
            return state.sender.due(learner, validity, felt, state.lease.epoch, now_ns)
        except Exception as error:
            state.failures.stop_learning("its learning", error)
    if validity is GOOD and learner.sample.time != time:  # learn nothing, but take the force that safety needs
        try:
            learner.feel(time, position, force)
        except Exception as error:
            state.failures.note("its conditioning", error)
            feel_plainly(state, force)
    return None


def _take(state: State, command: Command, now_ns: int) -> None:
    """Obey a command if its leader has control and it is fresh."""
    lease = state.lease
    holder, epoch = lease.holder, lease.epoch
    if not lease.admit(command.holder, command.epoch, now_ns):
        return
    if lease.epoch != epoch or lease.holder != holder:  # another leader: nothing of the one before is still valid
        state.freshness.begin()
        state.commands.restart()
        state.playout.restart()
        state.sender.round_trip.restart()
        state.felt_commands.clear()
        state.guarded = state.guards
    sequence, position = command.sequence, command.position
    if state.released_tick and (command.run != state.run or command.telemetry_sequence < state.released_tick):
        state.before_release += 1  # its leader did not know yet of the release
        state.commands.is_newest(sequence)
        return
    arrival = state.freshness.judge(sequence, command.time_ns, now_ns)
    if arrival is not FUTURE:
        state.commands.is_newest(sequence)
    if arrival is not FRESH:
        return
    if math.isfinite(position):  # a command without a position is never played
        state.playout.push(sequence, position, command.place)
        state.sender.round_trip.commanded(sequence, command.acknowledged_model)
    if command.guarded:
        state.guarded = True


def _stop_or_release(state: State, inputs: Inputs[RobotSample], felt: float, faulty: bool) -> bool:
    """Apply requests at the robot; return whether the commands hold."""
    safety, released = state.safety, False
    if inputs.stop:
        safety.stop(inputs.stop)
    elif inputs.release and faulty:
        state.watch.reset()  # a stop stays: the robot's force is known from the next samples on
        released = True
    elif inputs.release and safety.stop_reason:
        released = safety.release(state.learner.sample.velocity, felt)
    if released:
        state.released_tick = state.tick + 1  # the number of this tick's telemetry, the first to report it
    if released or safety.stop_reason:
        state.playout.forget()
        return False
    return True


def _allowed(
    state: State, desired_position: float, inputs: Inputs[RobotSample], force: float, now_ns: int, faulty: bool
) -> float:
    """Allowed position for a commanded one: the first touch, then safety [m]."""
    sample, learnt_from, safety, first_touch = inputs.sample, state.learner.sample, state.safety, state.first_touch
    # A follower that begins in contact learns that force as the sensor's offset: an excess over any offset is felt.
    unexplained = force - state.specification.largest_offset
    felt = max(learnt_from.force, unexplained)
    witnessed = state.watch.effort > EFFORT_FROM * state.limits.force  # where a wrong sensor would do harm
    if witnessed:
        felt = max(felt, state.watch.effort - EFFORT_UNCERTAINTY)
    touches = learnt_from.in_contact or unexplained > CONTACT_FLOOR or witnessed
    if not _stop_or_release(state, inputs, felt, faulty):
        desired_position = math.nan
    if state.compliance and not faulty and touches:  # commands give the position of the tip
        desired_position += state.compliance * min(max(felt, 0.0), state.limits.force)
    try:
        if not state.guarded or math.isnan(desired_position):
            first_touch.restart()
        else:
            desired_position = first_touch.update(
                desired_position, sample.position, math.nan if faulty else felt, touches, state.sender.known_surface()
            )
    except Exception as error:
        state.failures.note("its guard of the first touch", error)
        desired_position = math.nan
    heard_ns = state.freshness.newest_ns
    silence = math.inf if heard_ns is None or inputs.ended else (now_ns - heard_ns) * 1e-9
    too_slow = state.rate.update(inputs.period_ns)
    desired_position = safety.update(
        desired_position,
        Sensed(sample.position, felt, touches, faulty, state.watch.uncertain),
        surface=state.learner.conditioner.surface,
        silence=max(silence, state.limits.hold_after) if too_slow else silence,
        guarded=first_touch.guarded,
        free=state.free,
    )
    if faulty:
        state.faulty_ticks += 1
    if heard_ns is not None and HOLDING <= safety.status <= RETREATING:
        state.held_ticks += 1
    if too_slow and safety.status is Status.HOLDING:
        safety.status = Status.TOO_SLOW
    return desired_position
