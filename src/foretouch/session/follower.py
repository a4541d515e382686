"""The follower's step: commands and sensors in; a robot position, telemetry and models out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from foretouch.identification import Estimator, Learner, LearntModel
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, ModelUpdate, Telemetry, encode
from foretouch.models import ContactMap
from foretouch.robot import RobotSample, RobotSpecification
from foretouch.session.first_touch import FirstTouch
from foretouch.session.playout import Playout
from foretouch.session.round_trip import LARGEST_MEMORY, RoundTrip
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings

__all__ = ["Inputs", "Outputs", "State", "start", "step"]

SURFACE_CHANGE = 1e-4
"""A surface that has moved by more than this [m] since the last model is sent at once."""

BYTE_RATE, LARGEST_BURST = 45e3, 3e3
"""Models take so many bytes a second, and so many at once after a silence [bytes]: with the one that may exceed it, no
second holds more than 50 kB. What does not fit waits, and is sent as it is known by then."""

CHANGE_TOLD_NS = 2_000_000_000
"""Models say so long [ns] that the material has changed."""


@dataclass(slots=True)
class State:
    """What the follower remembers from tick to tick; updated in place.

    Attributes:
        specification: Of the robot: its tool is weighed out of the force.
        learner: Conditions and identifies.
        model_period_ns: Between two models while nothing changes [ns].
        commands: Counts arriving commands.
        playout: Makes an even stream of them.
        tick: Number of the newest tick.
        start_ns: Clock at the first tick that had a command, None before it.
        model_sequence: Of the newest model sent.
        sent: That model.
        sent_ns: When it was sent.
        allowance: Bytes that could have been sent beside it.
        changed: Whether something has changed since that is worth a model at once.
        changes: Sudden changes of the material that the estimator has found.
        changed_ns: When it found the newest, None before the first.
        round_trip: Learns how late models are used.
        first_touch: Guards the contact that the leader does not know of.
        guarded: Whether it does: by this side's settings, or because a command asks for it.
        surfaces: Of the models that were sent since the newest that the leader is known to have [m]; NaN where a model
            was not valid.
        known_model: The model that the leader renders from, as far as its applied commands say; 0 for none.
        known_surface: Its surface [m], or NaN.
    """

    specification: RobotSpecification
    learner: Learner
    model_period_ns: int
    commands: SequenceCounter = field(default_factory=SequenceCounter)
    playout: Playout = field(default_factory=Playout)
    tick: int = 0
    start_ns: int | None = None
    model_sequence: int = 0
    sent: LearntModel | None = None
    sent_ns: int = 0
    allowance: float = 0.0
    changed: bool = False
    changes: int = 0
    changed_ns: int | None = None
    round_trip: RoundTrip = field(default_factory=RoundTrip)
    first_touch: FirstTouch = field(default_factory=lambda: FirstTouch(0.02, 2.0, SAMPLE_PERIOD))
    guarded: bool = False
    surfaces: dict[int, float] = field(default_factory=dict)
    known_model: int = 0
    known_surface: float = math.nan


class Inputs(NamedTuple):
    """What a tick is given.

    Attributes:
        commands: That have arrived since the last tick.
        sample: What the robot's sensors show.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took [ns].
    """

    commands: list[Command]
    sample: RobotSample
    period_ns: int
    compute_ns: int


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


def start(specification: RobotSpecification, settings: SessionSettings, estimator: Estimator | None = None) -> State:
    """State before the first tick.

    Args:
        specification: Of the robot.
        settings: Of the session.
        estimator: Fresh; None for the one that the settings name.
    """
    return State(
        specification,
        Learner(settings.make_estimator() if estimator is None else estimator),
        round(1e9 / settings.model_rate),
        first_touch=FirstTouch(settings.approach_speed, settings.guarded_force, specification.sample_period),
        guarded=settings.guards(simulated=specification.simulated),
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
    sample = inputs.sample
    for command in inputs.commands:
        state.commands.is_newest(command.sequence)
        state.playout.push(command.sequence, command.position)
        state.round_trip.commanded(command.sequence, command.acknowledged_model)
        state.guarded = state.guarded or command.guarded
    desired_position = state.playout.advance()
    if math.isnan(desired_position):
        desired_position = sample.commanded_position
    # Weight and inertia of the tool beyond the sensor are no contact.
    sensor_force = sample.sensor_force - state.specification.tool_force(sample.acceleration)
    model = None
    if state.playout.applied:
        if state.start_ns is None:
            state.start_ns = now_ns
        delay = state.round_trip.applied(state.playout.applied, now_ns)
        if delay is not None:
            state.learner.estimator.expect_delay(delay)
        state.learner.update((now_ns - state.start_ns) * 1e-9, sample.position, sensor_force)
        model = _due_model(state, now_ns)
    learnt_from = state.learner.sample
    if state.guarded and state.playout.applied:
        desired_position = state.first_touch.update(
            desired_position, sample.position, learnt_from.force, learnt_from.in_contact, _known_surface(state)
        )
    state.tick += 1
    telemetry = Telemetry(
        VERSION,
        state.tick,
        now_ns,
        state.playout.applied,
        desired_position,
        sample.position,
        learnt_from.velocity,
        sensor_force,
        learnt_from.force,
        sample.exact_force,
        learnt_from.in_contact,
        sample.clipped,
        state.model_sequence,
        inputs.period_ns,
        inputs.compute_ns,
        state.first_touch.guarded,
    )
    return state, Outputs(desired_position, telemetry, model)


def _known_surface(state: State) -> float:
    """Surface of the newest model that the leader renders from, as far as its applied commands say [m]; or NaN."""
    current, surfaces = state.round_trip.current, state.surfaces
    if current != state.known_model:
        state.known_model = current
        state.known_surface = surfaces.get(current, math.nan)
        for sequence in [sequence for sequence in surfaces if sequence < current]:
            del surfaces[sequence]
    return state.known_surface


def _is_changed(state: State, now_ns: int) -> bool:
    """Whether the model became valid or not, its surface moved, or the material changed, since the last model.

    It is asked in every tick and packs no map for the answer.
    """
    learner, sent = state.learner, state.sent
    estimator = learner.estimator
    changes, state.changes = state.changes, estimator.changes
    if estimator.changes > changes:
        state.changed_ns = now_ns
        return True
    if sent is None:
        return True
    surface = learner.conditioner.surface - estimator.surface_correction
    if math.isnan(surface) or sent.model is None:
        return learner.learnt().model is not sent.model
    # A map stays valid until its estimator begins anew.
    valid = estimator.updates > 0 if isinstance(sent.model, ContactMap) else estimator.model is not None
    return not valid or abs(surface - sent.surface) > SURFACE_CHANGE


def _due_model(state: State, now_ns: int) -> ModelUpdate | None:
    """The model to send in this tick: on schedule, and at once on change, as far as the bytes allow."""
    state.changed = _is_changed(state, now_ns) or state.changed
    since_ns = now_ns - state.sent_ns
    if not (state.changed or since_ns >= state.model_period_ns):
        return None
    allowance = (
        LARGEST_BURST if state.sent is None else min(state.allowance + BYTE_RATE * since_ns * 1e-9, LARGEST_BURST)
    )
    if allowance <= 0.0:
        return None
    learnt = state.learner.learnt()
    state.sent, state.sent_ns, state.changed = learnt, now_ns, False
    state.model_sequence += 1
    model = learnt.model
    update = ModelUpdate(
        VERSION,
        state.model_sequence,
        now_ns,
        state.playout.applied,
        "" if model is None else model.law,
        () if model is None else model.parameters,
        learnt.state,
        learnt.surface,
        model is not None,
        _reason(state, learnt, now_ns),
        state.learner.estimator.name,
        model.map if isinstance(model, ContactMap) else b"",
    )
    state.allowance = allowance - len(encode(update))
    state.round_trip.sent(update.sequence, now_ns)
    if state.guarded:
        if len(state.surfaces) >= LARGEST_MEMORY:  # a leader that never answers fills nothing
            state.surfaces.clear()
        state.surfaces[update.sequence] = math.nan if model is None else learnt.surface
    return update


def _reason(state: State, learnt: LearntModel, now_ns: int) -> str:
    """What the learner says, or for a while after a change that there was one: the message that said so may be lost."""
    if learnt.model is None or state.changed_ns is None or now_ns - state.changed_ns > CHANGE_TOLD_NS:
        return learnt.reason
    return f"the material changed {(now_ns - state.changed_ns) * 1e-9:.1f} s ago: it is learnt anew"
