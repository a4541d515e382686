"""The leader's step: the operator's motion in; a command and the force of the virtual environment out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from foretouch.errors import InputError
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, LeaderState, ModelUpdate, Telemetry
from foretouch.models import Predictor, make_model
from foretouch.rendering import ForceLimiter
from foretouch.session.settings import SAMPLE_PERIOD

__all__ = ["Inputs", "Outputs", "State", "start", "step"]


@dataclass(slots=True)
class State:
    """What the leader remembers from tick to tick; updated in place.

    Attributes:
        start_ns: Clock at the first tick, None before it.
        sequence: Of the newest command.
        predictor: Runs the newest model at the operator's motion.
        limiter: The clamps.
        models: Counts arriving models.
        telemetry: Counts arriving telemetry.
        delayed_force: Newest force that has arrived [N]; recorded, never rendered.
        refused: Models that could not be used, whatever they claimed.
    """

    start_ns: int | None = None
    sequence: int = 0
    predictor: Predictor = field(default_factory=Predictor)
    limiter: ForceLimiter = field(default_factory=ForceLimiter)
    models: SequenceCounter = field(default_factory=SequenceCounter)
    telemetry: SequenceCounter = field(default_factory=SequenceCounter)
    delayed_force: float = 0.0
    refused: int = 0


class Inputs(NamedTuple):
    """What a tick is given.

    Attributes:
        position: Of the operator's hand [m], in the frame of the probe.
        models: That have arrived since the last tick.
        telemetry: That has arrived since the last tick.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took [ns].
    """

    position: float
    models: list[ModelUpdate]
    telemetry: list[Telemetry]
    period_ns: int
    compute_ns: int


class Outputs(NamedTuple):
    """What a tick gives: a command for the follower, and its own record, whose `rendered_force` is for the hand."""

    command: Command
    record: LeaderState


def start() -> State:
    """State before the first tick."""
    return State()


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader.

    The force comes from the newest model at the operator's own motion alone. The delayed force is noted for those
    who compare and goes nowhere else.

    Args:
        state: Updated in place and returned.
        inputs: Of this tick.
        now_ns: This side's monotonic clock [ns].
    """
    if state.start_ns is None:
        state.start_ns = now_ns
    for telemetry in inputs.telemetry:
        if state.telemetry.is_newest(telemetry.sequence):
            state.delayed_force = telemetry.force
    for model in inputs.models:
        if state.models.is_newest(model.sequence):
            _adopt(state, model)
    predictor = state.predictor
    predicted = predictor.update((now_ns - state.start_ns) * 1e-9, inputs.position)
    # A tick that came late is no reason for a larger step of force.
    rendered = state.limiter.update(predicted, min(inputs.period_ns * 1e-9, SAMPLE_PERIOD))
    state.sequence += 1
    command = Command(VERSION, state.sequence, now_ns, inputs.position, state.models.newest)
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        inputs.position,
        predictor.velocity,
        predicted,
        rendered,
        state.delayed_force,
        state.telemetry.newest,
        state.models.newest,
        predictor.jump,
        state.limiter.clipped,
        inputs.period_ns,
        inputs.compute_ns,
        predictor.standard_deviation,
    )
    return state, Outputs(command, record)


def _adopt(state: State, update: ModelUpdate) -> None:
    """Predict from an arrived model; one that claims to be valid and cannot be run counts as no model."""
    if not update.valid:
        state.predictor.adopt(None, update.surface)
        return
    try:
        model = make_model(update.law, update.parameters, update.map)
        state.predictor.adopt(model, update.surface, update.state, update.command_sequence)
    except InputError:
        state.refused += 1
        state.predictor.adopt(None, update.surface)
