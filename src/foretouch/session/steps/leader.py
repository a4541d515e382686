"""The leader's step: takes the operator's motion; gives a command and the force of the virtual environment.

Hand and follower are coupled as soon as both positions are known, except while the clutch is pressed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

from foretouch.devices import DeviceSpecification
from foretouch.errors import InputError
from foretouch.messages import VERSION, Command, FieldUpdate, FollowerSpace, LeaderState, ModelUpdate, Telemetry
from foretouch.models import make_model
from foretouch.quantities import LARGEST_POSITION
from foretouch.quantities.pose import Vector
from foretouch.rendering import Proxy, Renderer, SpatialEnergyAccount
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.follower_view import FollowerView
from foretouch.settings import NO_GRIP


def meeting_place(proxy: Proxy, hand: float, follower: float, *, clutched: bool) -> float:
    """Position at which a hand and a proxy that are apart are coupled in this tick [m]; NaN where they are not.

    They meet where the follower is, NaN while unknown, and after a clutch where the proxy was left; a pressed clutch
    lets the hand go.
    """
    if clutched:
        proxy.release()
    if clutched or proxy.engaged or not math.isfinite(hand):
        return math.nan
    return follower if math.isnan(proxy.position) else proxy.position


def moving_time(period_ns: int, exact_position: float, now_ns: int, newest_ns: int | None) -> float:
    """Time in which the hand moved to its position in this tick [s].

    A human hand is measured when a tick really begins, `period_ns` after the last one. A simulated one, whose exact
    position is known, is evaluated at the tick's nominal time, on an even grid. Timed by the real starts of ticks, a
    motion of many milliseconds would count as one of one millisecond, and widen the bound of energy.
    """
    if newest_ns is None or not math.isfinite(exact_position):
        return period_ns * 1e-9
    return (now_ns - newest_ns) * 1e-9


SAME_SURFACE = 1e-3  # Largest distance of surfaces found by two processes that count as the same surface [m]


@dataclass(slots=True)
class State:
    """State of the leader, updated in place in each tick.

    Attributes:
        guarded: Whether the follower is asked to guard the first touch.
        follower_view: Messages received from the follower. Its force is recorded and never rendered.
        start_ns: Clock at the first tick, None before it.
        newest_ns: Clock at the newest tick, None before the first.
        inherits: Whether the model is of a follower's process that is gone, and its successor knows less yet.
        refused: Number of models that could not be used, whatever they claimed.
    """

    renderer: Renderer = field(default_factory=Renderer)
    guarded: bool = False
    holder: str = "leader"
    epoch: int = 1
    follower_view: FollowerView = field(default_factory=lambda: FollowerView(1))
    start_ns: int | None = None
    newest_ns: int | None = None
    sequence: int = 0
    inherits: bool = False
    refused: int = 0


Position = TypeVar("Position", float, Vector)


class Inputs(NamedTuple, Generic[Position]):
    """Inputs of a tick, along a line or in space.

    Attributes:
        position: Position of the operator's hand, from the device's encoders [m].
        models: Models that have arrived since the last tick.
        telemetry: Telemetry that has arrived since the last tick.
        period_ns: Time since the last tick began [ns].
        compute_ns: Computing time of the last tick [ns].
        clutched: Whether the clutch is pressed: the hand moves and the follower stays.
        exact_position: Position of a simulated hand [m]; recorded only.
        intended_position: Intended position of the hand [m]; recorded only.
        stopping: Whether an emergency stop was requested here, and the follower has not yet confirmed it.
        spaces: Spatial telemetry of the follower that has arrived since the last tick.
        fields: Fields of materials that have arrived since the last tick.
    """

    position: Position
    models: list[ModelUpdate]
    telemetry: list[Telemetry]
    period_ns: int
    compute_ns: int
    clutched: bool = False
    exact_position: Position = math.nan  # type: ignore[assignment]  # in space it is always given
    intended_position: Position = math.nan  # type: ignore[assignment]
    stopping: bool = False
    spaces: Sequence[FollowerSpace] = ()
    fields: Sequence[FieldUpdate] = ()


class Outputs(NamedTuple):
    """Outputs of a tick: a command for the follower, and its own record, whose `rendered_force` is for the hand."""

    command: Command
    record: LeaderState


def start(
    settings: SessionSettings | None = None,
    *,
    holder: str = "leader",
    epoch: int = 1,
    device: DeviceSpecification | None = None,
    account: SpatialEnergyAccount | None = None,
) -> State:
    """State before the first tick.

    Args:
        settings: Session settings.
        holder: Name of this leader, not empty; it is sent to leaders that contend for control.
        epoch: Epoch of this process (`foretouch.session.network.lease.own_epoch`).
        device: Device that a person holds and feels; None for none, or for a simulated one with a grip.
        account: Energy account in space; None for one along this line.
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
    return State(renderer, guarded, holder, epoch, FollowerView(epoch))


def step(state: State, inputs: Inputs[float], now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader, at a time of its monotonic clock [ns]; the state is updated in place and returned.

    The force comes from the newest model at the operator's own motion alone. The delayed force is recorded for
    comparison and used nowhere else.

    A hand that feels the force is coupled with the follower once the follower's position is known, and again each time
    the clutch is released, without a jump of either; until then commands carry no position. While an emergency stop is
    latched, or the follower obeys another leader, it is let go and feels nothing. Where another follower process has
    started the model stays, for the material is the same, until that process knows as much (`FollowerView`).
    """
    if state.start_ns is None:
        state.start_ns = now_ns
    renderer, follower_view = state.renderer, state.follower_view
    predictor = renderer.predictor
    for telemetry in inputs.telemetry:
        follower_view.take_telemetry(telemetry)
    ours = [model for model in inputs.models if follower_view.is_for_us(model)] if inputs.models else inputs.models
    renewed = follower_view.take_renewed()
    if renewed:
        _renew(state)
    for model in ours:
        _adopt(state, model)
    free = inputs.stopping or follower_view.stopped or not follower_view.in_control
    if renderer.closed_loop and not free and not renewed:  # let go for a tick, so that the force leaves as models do
        _couple(state, inputs)
    period = moving_time(inputs.period_ns, inputs.exact_position, now_ns, state.newest_ns)
    state.newest_ns = now_ns
    rendered = renderer.update((now_ns - state.start_ns) * 1e-9, inputs.position, period, free=free)
    position, engaged, clipped, mediated, step_by_models, share = renderer.shown
    energy, energy_bound, late_energy = renderer.booked
    state.sequence += 1
    command = Command(
        VERSION,
        state.sequence,
        now_ns,
        position,
        predictor.message,
        state.guarded,
        state.holder,
        state.epoch,
        telemetry_sequence=follower_view.telemetry.newest,
        run=follower_view.run,
    )
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        position,
        predictor.velocity,
        predictor.force,
        rendered,
        follower_view.force,
        follower_view.telemetry.newest,
        follower_view.models.newest,
        predictor.jump,
        clipped,
        inputs.period_ns,
        inputs.compute_ns,
        predictor.standard_deviation,
        inputs.position,
        inputs.exact_position,
        inputs.intended_position,
        mediated,
        step_by_models,
        energy,
        energy_bound,
        share,
        engaged,
        state.epoch,
        follower_view.run,
        late_energy,
    )
    return state, Outputs(command, record)


def _couple(state: State, inputs: Inputs[float]) -> None:
    renderer, hand, clutched = state.renderer, inputs.position, inputs.clutched
    if renderer.proxy.engaged and not clutched:
        return
    position = meeting_place(renderer.proxy, hand, state.follower_view.position, clutched=clutched)
    if math.isfinite(position):
        renderer.engage(hand, position)


def _renew(state: State) -> None:
    """Start again with another follower process: it is elsewhere, and knows nothing yet."""
    renderer = state.renderer
    renderer.predictor.disown()
    state.inherits = renderer.predictor.model is not None
    if renderer.closed_loop:
        renderer.proxy.leave()


def _adopt(state: State, update: ModelUpdate) -> None:
    """Predict from an arrived model; one that claims to be valid and cannot be evaluated counts as no model."""
    if state.inherits and not (update.valid and state.follower_view.has_relearnt):
        predictor = state.renderer.predictor
        if update.valid and abs(update.surface - predictor.surface) < SAME_SURFACE:
            predictor.message = update.sequence  # its surface is known here
        return
    if not update.valid:
        state.renderer.adopt(None, update.surface, message=update.sequence)
        return
    state.inherits = False
    model = None
    if abs(update.surface) <= LARGEST_POSITION:
        with suppress(InputError):
            model = make_model(update.law, update.parameters, update.map)
    if model is None:  # render and acknowledge nothing: the follower must not assume that its surface is known
        state.refused += 1
        state.renderer.adopt(None, 0.0)
    else:
        state.renderer.adopt(model, update.surface, update.state, update.command_sequence, update.sequence)
