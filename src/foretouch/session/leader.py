"""The leader's step: the operator's motion in; a command and the force of the virtual environment out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from foretouch.errors import InputError
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, LeaderState, ModelUpdate, Telemetry
from foretouch.models import make_model
from foretouch.quantities import LARGEST_POSITION
from foretouch.rendering import Renderer
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings

__all__ = ["Inputs", "Outputs", "State", "start", "step"]


@dataclass(slots=True)
class State:
    """What the leader remembers from tick to tick; updated in place.

    Attributes:
        renderer: Makes the force for the hand from the newest model.
        guarded: Whether the follower is asked to guard the first touch.
        start_ns: Clock at the first tick, None before it.
        sequence: Of the newest command.
        models: Counts arriving models.
        telemetry: Counts arriving telemetry.
        delayed_force: Newest force that has arrived [N]; recorded, never rendered.
        follower_position: Where the follower was told to be, as the newest telemetry says [m]; NaN before the first.
        refused: Models that could not be used, whatever they claimed.
    """

    renderer: Renderer = field(default_factory=Renderer)
    guarded: bool = False
    start_ns: int | None = None
    sequence: int = 0
    models: SequenceCounter = field(default_factory=SequenceCounter)
    telemetry: SequenceCounter = field(default_factory=SequenceCounter)
    delayed_force: float = 0.0
    follower_position: float = math.nan
    refused: int = 0


class Inputs(NamedTuple):
    """What a tick is given.

    Attributes:
        position: Of the operator's hand, as the device's encoder shows it [m].
        models: That have arrived since the last tick.
        telemetry: That has arrived since the last tick.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took [ns].
        clutched: Whether the clutch is pressed: the hand moves and the follower stays.
        exact_position: Of a simulated hand [m]; recorded only.
        intended_position: Where the hand wants to be [m]; recorded only.
    """

    position: float
    models: list[ModelUpdate]
    telemetry: list[Telemetry]
    period_ns: int
    compute_ns: int
    clutched: bool = False
    exact_position: float = math.nan
    intended_position: float = math.nan


class Outputs(NamedTuple):
    """What a tick gives: a command for the follower, and its own record, whose `rendered_force` is for the hand."""

    command: Command
    record: LeaderState


def start(settings: SessionSettings | None = None) -> State:
    """State before the first tick, of a session with these settings."""
    settings = SessionSettings() if settings is None else settings
    guarded = settings.guards()
    renderer = Renderer(
        None if settings.grip == NO_GRIP else settings.device,
        position_scale=settings.position_scale,
        force_scale=settings.force_scale,
        largest_stiffness=settings.largest_stiffness,
        guarded=guarded,
        sample_period=SAMPLE_PERIOD,
    )
    return State(renderer, guarded)


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader.

    The force comes from the newest model at the operator's own motion alone. The delayed force is noted for those
    who compare and goes nowhere else.

    A hand that feels the force is coupled with the follower once it is known where that is, and again each time that
    the clutch is let go, without a jump of either; until then commands carry no position.

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
            state.follower_position = telemetry.desired_position
    for model in inputs.models:
        if state.models.is_newest(model.sequence):
            _adopt(state, model)
    renderer = state.renderer
    _couple(state, inputs)
    period = inputs.period_ns * 1e-9
    rendered = renderer.update((now_ns - state.start_ns) * 1e-9, inputs.position, period)
    predictor, proxy = renderer.predictor, renderer.proxy
    state.sequence += 1
    command = Command(VERSION, state.sequence, now_ns, proxy.position, predictor.message, state.guarded)
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        proxy.position,
        predictor.velocity,
        predictor.force,
        rendered,
        state.delayed_force,
        state.telemetry.newest,
        state.models.newest,
        predictor.jump,
        renderer.limiter.clipped,
        inputs.period_ns,
        inputs.compute_ns,
        predictor.standard_deviation,
        inputs.position,
        inputs.exact_position,
        inputs.intended_position,
        renderer.mediation.force,
        renderer.mediation.step,
        renderer.energy,
        renderer.energy_bound,
        renderer.share,
        proxy.engaged,
    )
    return state, Outputs(command, record)


def _couple(state: State, inputs: Inputs) -> None:
    """Couple hand and proxy, or let the hand go alone while the clutch is pressed."""
    proxy = state.renderer.proxy
    if proxy.engaged and inputs.clutched:
        proxy.release()
    elif not (proxy.engaged or inputs.clutched) and math.isfinite(inputs.position):
        if not math.isnan(proxy.position):
            state.renderer.engage(inputs.position, proxy.position)
        elif state.renderer.closed_loop and math.isfinite(state.follower_position):
            state.renderer.engage(inputs.position, state.follower_position)


def _adopt(state: State, update: ModelUpdate) -> None:
    """Predict from an arrived model; one that claims to be valid and cannot be run counts as no model."""
    if not update.valid:
        state.renderer.adopt(None, update.surface, message=update.sequence)
        return
    if not abs(update.surface) <= LARGEST_POSITION:
        _refuse(state)
        return
    try:
        model = make_model(update.law, update.parameters, update.map)
    except InputError:
        _refuse(state)
        return
    state.renderer.adopt(model, update.surface, update.state, update.command_sequence, update.sequence)


def _refuse(state: State) -> None:
    """Render nothing, and acknowledge nothing: the follower is not to think that its surface is known."""
    state.refused += 1
    state.renderer.adopt(None, 0.0)
