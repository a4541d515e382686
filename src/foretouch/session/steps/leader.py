"""The leader's step: the operator's motion in; a command and the force of the virtual environment out.

Hand and follower belong together from the first that is known of both, but for a pressed clutch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from foretouch.devices import DeviceSpecification
from foretouch.errors import InputError
from foretouch.messages import VERSION, Command, LeaderState, ModelUpdate, Telemetry
from foretouch.models import make_model
from foretouch.quantities import LARGEST_POSITION
from foretouch.rendering import Proxy, Renderer
from foretouch.rendering.energy import RenderingAccount
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.heard import Heard


def meeting_place(proxy: Proxy, hand: float, follower: float, *, clutched: bool) -> float:
    """Where a hand and a proxy that are apart are to be coupled in this tick [m]; NaN where they are not to be.

    They meet where the follower is, and after a clutch where the proxy was left; a pressed clutch lets the hand go.

    Args:
        proxy: Of the hand.
        hand: Its position [m]; one that is no number is not coupled.
        follower: Where the follower is, as far as it is known [m]; NaN before.
        clutched: Whether the clutch is pressed.
    """
    if clutched:
        proxy.release()
    if clutched or proxy.engaged or not math.isfinite(hand):
        return math.nan
    return follower if math.isnan(proxy.position) else proxy.position


def moving_time(period_ns: int, exact_position: float, now_ns: int, newest_ns: int | None) -> float:
    """Time in which the hand moved to where it is in this tick [s].

    A hand of flesh is where it is when a tick really begins, late as that may be. A simulated one is where it is at the
    tick's own time, on an even grid: what it does while the machine sleeps is seen a tick later. Booked by when ticks
    really began, a motion of many milliseconds would count as one of one millisecond, and widen the bound of energy.

    Args:
        period_ns: Since the last tick really began [ns].
        exact_position: Of a simulated hand [m]; no number for one of flesh.
        now_ns: Time of this tick [ns].
        newest_ns: Of the last one [ns]; None for none.
    """
    if newest_ns is None or not math.isfinite(exact_position):
        return period_ns * 1e-9
    return (now_ns - newest_ns) * 1e-9


SAME_SURFACE = 1e-3
"""Surfaces that two processes have found are one if they are no further apart [m]."""


@dataclass(slots=True)
class State:
    """What the leader remembers from tick to tick; updated in place.

    Attributes:
        renderer: Makes the force for the hand from the newest model.
        guarded: Whether the follower is asked to guard the first touch.
        holder: Name of this leader.
        epoch: Of this process, at least 1.
        heard: What the follower says. Its force is recorded and never rendered.
        start_ns: Clock at the first tick, None before it.
        newest_ns: Clock at the newest tick, None before the first.
        sequence: Of the newest command.
        inherits: Whether the model is of a follower's process that is gone, and the one in its place knows less yet.
        refused: Models that could not be used, whatever they claimed.
    """

    renderer: Renderer = field(default_factory=Renderer)
    guarded: bool = False
    holder: str = "leader"
    epoch: int = 1
    heard: Heard = field(default_factory=lambda: Heard(1))
    start_ns: int | None = None
    newest_ns: int | None = None
    sequence: int = 0
    inherits: bool = False
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
        stopping: Whether an emergency stop was asked for here, and the follower has not said yet that it has stopped.
    """

    position: float
    models: list[ModelUpdate]
    telemetry: list[Telemetry]
    period_ns: int
    compute_ns: int
    clutched: bool = False
    exact_position: float = math.nan
    intended_position: float = math.nan
    stopping: bool = False


class Outputs(NamedTuple):
    """What a tick gives: a command for the follower, and its own record, whose `rendered_force` is for the hand."""

    command: Command
    record: LeaderState


def start(
    settings: SessionSettings | None = None,
    *,
    holder: str = "leader",
    epoch: int = 1,
    device: DeviceSpecification | None = None,
    account: RenderingAccount | None = None,
) -> State:
    """State before the first tick.

    Args:
        settings: Of the session.
        holder: Name of this leader, not empty: who else would command is told it.
        epoch: Of this process (`foretouch.session.network.lease.own_epoch`).
        device: That a person holds and feels; None where there is none, or a simulated one with a grip.
        account: Of the energy; None for one along this line.
    """
    settings = SessionSettings() if settings is None else settings
    guarded = settings.guards(simulated=device is None)  # a person who feels it is not simulated either
    if device is None and settings.grip != NO_GRIP:
        device = settings.device
    renderer = Renderer(
        device,
        position_scale=settings.position_scale,
        force_scale=settings.force_scale,
        largest_stiffness=settings.largest_stiffness,
        guarded=guarded,
        sample_period=SAMPLE_PERIOD,
        account=account,
    )
    return State(renderer, guarded, holder, epoch, Heard(epoch))


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader.

    The force comes from the newest model at the operator's own motion alone. The delayed force is noted for those
    who compare and goes nowhere else.

    A hand that feels the force is coupled with the follower once it is known where that is, and again each time that
    the clutch is let go, without a jump of either; until then commands carry no position. While an emergency stop is
    latched, or the follower obeys another leader, it is let go and feels nothing. Where another process has taken the
    follower's place the model stays, for the material is the same, until that process knows as much (`Heard`).

    Args:
        state: Updated in place and returned.
        inputs: Of this tick.
        now_ns: This side's monotonic clock [ns].
    """
    if state.start_ns is None:
        state.start_ns = now_ns
    renderer, heard = state.renderer, state.heard
    predictor, proxy = renderer.predictor, renderer.proxy
    for telemetry in inputs.telemetry:
        heard.take_telemetry(telemetry)
    ours = [model for model in inputs.models if heard.is_for_us(model)] if inputs.models else inputs.models
    renewed = heard.take_renewed()
    if renewed:
        _renew(state)
    for model in ours:
        _adopt(state, model)
    free = inputs.stopping or heard.stopped or not heard.in_control
    if renderer.closed_loop and not free and not renewed:  # let go for a tick, so that the force leaves as models do
        _couple(state, inputs)
    period = moving_time(inputs.period_ns, inputs.exact_position, now_ns, state.newest_ns)
    state.newest_ns = now_ns
    rendered = renderer.update((now_ns - state.start_ns) * 1e-9, inputs.position, period, free=free)
    state.sequence += 1
    command = Command(
        VERSION,
        state.sequence,
        now_ns,
        proxy.position,
        predictor.message,
        state.guarded,
        state.holder,
        state.epoch,
        telemetry_sequence=heard.telemetry.newest,
        run=heard.run,
    )
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        proxy.position,
        predictor.velocity,
        predictor.force,
        rendered,
        heard.force,
        heard.telemetry.newest,
        heard.models.newest,
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
        state.epoch,
        heard.run,
        renderer.late_energy,
    )
    return state, Outputs(command, record)


def _couple(state: State, inputs: Inputs) -> None:
    renderer, hand, clutched = state.renderer, inputs.position, inputs.clutched
    if renderer.proxy.engaged and not clutched:
        return
    place = meeting_place(renderer.proxy, hand, state.heard.position, clutched=clutched)
    if math.isfinite(place):
        renderer.engage(hand, place)


def _renew(state: State) -> None:
    """Another process has taken the follower's place: it is elsewhere, and knows nothing yet."""
    renderer = state.renderer
    renderer.predictor.disown()
    state.inherits = renderer.predictor.model is not None
    if renderer.closed_loop:
        renderer.proxy.leave()


def _adopt(state: State, update: ModelUpdate) -> None:
    """Predict from an arrived model; one that claims to be valid and cannot be run counts as no model."""
    if state.inherits and not (update.valid and state.heard.has_relearnt):
        predictor = state.renderer.predictor
        if update.valid and abs(update.surface - predictor.surface) < SAME_SURFACE:
            predictor.message = update.sequence  # its surface is known here
        return
    if not update.valid:
        state.renderer.adopt(None, update.surface, message=update.sequence)
        return
    state.inherits = False
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
