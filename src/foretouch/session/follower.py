"""The follower's step: commands and sensors in; a robot position, telemetry and models out.

The order is: who may command, which of the commands are fresh, what the sensors are worth, what is learnt, and at the
end, whatever was said, what the robot may do (`foretouch.session.safety`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from foretouch.identification import Estimator, Learner, SensorState, SensorWatch
from foretouch.identification.conditioning import CONTACT_FLOOR
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, ModelUpdate, Status, Telemetry
from foretouch.robot import RobotSample, RobotSpecification
from foretouch.session.first_touch import FirstTouch
from foretouch.session.freshness import Arrival, Freshness
from foretouch.session.lease import ControlLease
from foretouch.session.model_sender import ModelSender
from foretouch.session.playout import Playout
from foretouch.session.safety import Safety, SafetyLimits
from foretouch.session.settings import SAFETY_LIMITS, SAMPLE_PERIOD, SessionSettings

__all__ = ["Inputs", "Outputs", "State", "start", "step"]

# What every tick asks for: a member of an enumeration costs more to look up than to compare.
GOOD = SensorState.GOOD
FRESH, FUTURE = Arrival.FRESH, Arrival.FUTURE
EFFORT_FROM, EFFORT_DOUBT = 0.5, 0.5
"""From this share of the force ceiling on, what the drive pushes with counts as felt, less so much [N]: friction of the
drive is in it."""

HOLDING, RETREATING = int(Status.HOLDING), int(Status.RETREATING)


@dataclass(slots=True)
class State:
    """What the follower remembers from tick to tick; updated in place.

    Attributes:
        specification: Of the robot: its tool is weighed out of the force.
        learner: Conditions and identifies.
        run: Epoch of this process, at least 1.
        sender: Sends models, and learns how late they are used.
        watch: Says what the sensors are worth.
        lease: Lets one leader command.
        freshness: Judges its commands.
        commands: Counts them.
        playout: Makes an even stream of them.
        tick: Number of the newest tick.
        start_ns: Clock at the first tick that had a command, None before it.
        first_touch: Guards the contact that the leader does not know of.
        safety: Stands before the robot.
        held_ticks: Ticks in which the robot was held for want of a fresh command, since there was the first.
        faulty_ticks: Ticks whose sensors were not believed.
        guards: Whether this side's settings guard first touches.
        guarded: Whether they are: by these, or because a command of this leader asks for it.
        surface_doubt: The air is free up to so far before the surface that was felt [m]: in space, where the robot comes
            to a place that it has not gone through itself; infinite on a line, where it has.
        slid: By how much the probe has moved across the surface since the last tick [m]; on a line it does not.
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
    surface_doubt: float = math.inf
    slid: float = 0.0


class Inputs(NamedTuple):
    """What a tick is given.

    Attributes:
        commands: That have arrived since the last tick.
        sample: What the robot's sensors show.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took [ns].
        stop: Why an emergency stop was asked for; empty while none was.
        release: Whether somebody at the robot asks to end an emergency stop, or says that the sensors are mended.
        ended: Whether the session is over: the robot is left as after a long silence.
    """

    commands: list[Command]
    sample: RobotSample
    period_ns: int
    compute_ns: int
    stop: str = ""
    release: bool = False
    ended: bool = False


class Outputs(NamedTuple):
    """What a tick gives.

    Attributes:
        desired_position: For the robot [m].
        telemetry: For all that watch.
        model: For the leader, when one is due.
    """

    desired_position: float
    telemetry: Telemetry
    model: ModelUpdate | None


def start(
    specification: RobotSpecification, settings: SessionSettings, estimator: Estimator | None = None, *, run: int = 1
) -> State:
    """State before the first tick.

    Args:
        specification: Of the robot.
        settings: Of the session.
        estimator: Fresh; None for the one that the settings name.
        run: Epoch of this process (`foretouch.session.lease.own_epoch`).
    """
    force = specification.sensor_range
    return State(
        specification,
        Learner(settings.make_estimator() if estimator is None else estimator),
        run,
        ModelSender(round(1e9 / settings.model_rate), run),
        SensorWatch((-force, force), moving_mass=specification.moved_mass),
        freshness=Freshness(settings.queueing_allowance, SAMPLE_PERIOD),
        first_touch=FirstTouch(settings.approach_speed, settings.guarded_force, specification.sample_period),
        safety=Safety(_limits(specification, settings), specification.sample_period),
        guards=settings.guards(simulated=specification.simulated),
    )


def _limits(specification: RobotSpecification, settings: SessionSettings) -> SafetyLimits:
    """Of the session, for this robot."""
    return SafetyLimits(
        **{name: getattr(settings, setting) for name, setting in SAFETY_LIMITS.items()},
        workspace=specification.workspace,
        mass=specification.moved_mass,
        retreats=settings.on_silence == "retreat",
    )


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the follower.

    Learning begins with the first command: nobody operates before, and who records a session from its first command
    holds all that was learnt from.

    Args:
        state: Updated in place and returned.
        inputs: Of this tick.
        now_ns: This side's monotonic clock [ns].
    """
    sample, playout, learner = inputs.sample, state.playout, state.learner
    for command in inputs.commands:
        _take(state, command, now_ns)
    desired_position = playout.advance()  # no number while no leader has said one
    # Weight and inertia of the tool beyond the sensor are no contact.
    tool_force = state.specification.tool_force(sample.acceleration)
    sensor_force = sample.sensor_force - tool_force
    validity = state.watch.update(
        now_ns * 1e-9,
        sample.position,
        sample.sensor_force,
        tool_force,
        zero=min(learner.conditioner.force_offset, state.specification.largest_offset),
        effort=sample.effort - state.specification.moved_mass * sample.acceleration,
        slid=state.slid,
    )
    faulty = validity is not GOOD
    model = None
    if state.start_ns is None and playout.applied:
        state.start_ns = now_ns
    if state.start_ns is not None:
        delay = state.sender.round_trip.applied(playout.applied, now_ns)
        if delay is not None:
            learner.estimator.expect_delay(delay)
        if not faulty:
            learner.update((now_ns - state.start_ns) * 1e-9, sample.position, sensor_force)
        state.sender.remembers = state.guarded
        model = state.sender.due(learner, validity, playout.applied, state.lease.epoch, now_ns)
    learnt_from = learner.sample
    desired_position = _allowed(state, desired_position, inputs, sensor_force, now_ns, faulty)
    state.tick += 1
    telemetry = Telemetry(
        VERSION,
        state.tick,
        now_ns,
        playout.applied,
        desired_position,
        sample.position,
        learnt_from.velocity,
        sensor_force,
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


def _take(state: State, command: Command, now_ns: int) -> None:
    """Obey a command if its leader has control and it is fresh."""
    lease = state.lease
    holder, epoch = lease.holder, lease.epoch
    if not lease.admit(command.holder, command.epoch, now_ns):
        return
    if lease.epoch != epoch or lease.holder != holder:  # another leader: nothing of the one before is valid any more
        state.freshness.begin()
        state.commands.restart()
        state.playout.restart()
        state.sender.round_trip.restart()
        state.guarded = state.guards
    sequence, position = command.sequence, command.position
    arrival = state.freshness.judge(sequence, command.time_ns, now_ns)
    if arrival is not FUTURE:
        state.commands.is_newest(sequence)
    if arrival is not FRESH:
        return
    if math.isfinite(position):  # what has no position is never played
        state.playout.push(sequence, position, command.place)
        state.sender.round_trip.commanded(sequence, command.acknowledged_model)
    if command.guarded:
        state.guarded = True


def _allowed(
    state: State, desired_position: float, inputs: Inputs, sensor_force: float, now_ns: int, faulty: bool
) -> float:
    """What the robot may do of what it is told to: the first touch, then safety [m]."""
    sample, learnt_from, safety, first_touch = inputs.sample, state.learner.sample, state.safety, state.first_touch
    # Who begins in contact learns that force as the sensor's offset: what no offset explains is felt.
    unexplained = sensor_force - state.specification.largest_offset
    felt = max(learnt_from.force, unexplained)
    if state.watch.effort > EFFORT_FROM * safety.limits.force:  # a second witness, where a wrong sensor would do harm
        felt = max(felt, state.watch.effort - EFFORT_DOUBT)
    touches = learnt_from.in_contact or unexplained > CONTACT_FLOOR
    if inputs.stop:
        safety.stop(inputs.stop)
    elif inputs.release and faulty:
        state.watch.reset()  # a stop stays: what the robot feels is known from the next samples on
    elif inputs.release:
        safety.release(learnt_from.velocity, felt)
    if safety.stop_reason:
        state.playout.forget()  # no command from before the release is obeyed after it
    if not state.guarded or math.isnan(desired_position):
        first_touch.restart()
    else:
        desired_position = first_touch.update(
            desired_position, sample.position, math.nan if faulty else felt, touches, state.sender.known_surface()
        )
    heard_ns = state.freshness.newest_ns
    desired_position = safety.update(
        desired_position,
        sample.position,
        felt,
        touches,
        surface=state.learner.conditioner.surface,
        silence=math.inf if heard_ns is None or inputs.ended else (now_ns - heard_ns) * 1e-9,
        faulty=faulty,
        guarded=first_touch.guarded,
        surface_doubt=state.surface_doubt,
        doubtful=state.watch.doubtful,
    )
    if faulty:
        state.faulty_ticks += 1
    if heard_ns is not None and HOLDING <= safety.status <= RETREATING:
        state.held_ticks += 1
    return desired_position
