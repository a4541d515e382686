"""The leader's step: takes the operator's motion; gives a command and the force of the virtual environment.

Hand and follower are coupled as soon as both positions are known, except while the clutch is pressed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

from foretouch.devices import DeviceSpecification
from foretouch.errors import InputError
from foretouch.messages import VERSION, Command, LeaderState, Message, ModelUpdate, Telemetry
from foretouch.models import NO_STATE, make_model
from foretouch.quantities import LARGEST_POSITION
from foretouch.quantities.pose import Vector
from foretouch.rendering import EnergyAccount, FrictionRenderer, Renderer, SpatialEnergyAccount
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.axis import HandOnAxis
from foretouch.session.steps.follower_view import FollowerView
from foretouch.settings import NO_GRIP

ACCOUNTS: dict[int, type[Any]] = {account.axes: account for account in (EnergyAccount, SpatialEnergyAccount)}

Position: TypeAlias = float | Vector


SAME_SURFACE = 1e-3  # Largest distance of surfaces found by two processes that count as the same surface [m]


@dataclass(slots=True)
class State:
    """State of the leader, updated in place in each tick.

    Attributes:
        guarded: Whether the follower is asked to guard the first touch.
        follower_view: Messages received from the follower. Its force is recorded and never rendered.
        hand: The operator's hand, on an axis or in space.
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
    hand: HandOnAxis = field(default_factory=HandOnAxis)
    start_ns: int | None = None
    newest_ns: int | None = None
    sequence: int = 0
    inherits: bool = False
    refused: int = 0


class Inputs(NamedTuple):
    """Inputs of a tick; positions are numbers on an axis, and vectors in space.

    Attributes:
        position: Position of the operator's hand, from the device's encoders [m].
        arrived: Messages of the follower that have arrived since the last tick.
        period_ns: Time since the last tick began [ns].
        compute_ns: Computing time of the last tick [ns].
        clutched: Whether the clutch is pressed: the hand moves and the follower stays.
        exact_position: Position of a simulated hand [m]; recorded only.
        intended_position: Intended position of the hand [m]; recorded only.
        stopping: Whether an emergency stop was requested here, and the follower has not yet confirmed it.
    """

    position: Position
    arrived: Sequence[Message]
    period_ns: int
    compute_ns: int
    clutched: bool = False
    exact_position: Position = math.nan
    intended_position: Position = math.nan
    stopping: bool = False


class Outputs(NamedTuple):
    """Outputs of a tick: a command for the follower, and its own record.

    The force for the hand is `rendered_force` of the record, and in space `force_x`, `force_y` and `force_z` there.
    """

    command: Command
    record: LeaderState


def start(
    settings: SessionSettings | None = None,
    *,
    holder: str = "leader",
    epoch: int = 1,
    device: DeviceSpecification | None = None,
    hand: HandOnAxis | None = None,
) -> State:
    """State before the first tick.

    Args:
        settings: Session settings.
        holder: Name of this leader, not empty; it is sent to leaders that contend for control.
        epoch: Epoch of this process (`foretouch.session.network.lease.own_epoch`).
        device: Device that a person holds and feels; None for none, or for a simulated one with a grip.
        hand: A hand in space; None for one on an axis.
    """
    settings = SessionSettings() if settings is None else settings
    hand = HandOnAxis() if hand is None else hand
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
        account=ACCOUNTS[hand.axes].of(device, SAMPLE_PERIOD),
        friction=_friction(settings, device),
    )
    return State(renderer, guarded, holder, epoch, FollowerView(epoch), hand)


def _friction(settings: SessionSettings, device: DeviceSpecification | None) -> FrictionRenderer:
    """Friction as the device carries it, in the follower's lengths and forces."""
    scales = settings.force_scale * settings.position_scale
    stiffness = (settings.device if device is None else device).largest_stiffness(SAMPLE_PERIOD)
    if settings.largest_stiffness:
        stiffness = min(stiffness, settings.largest_stiffness)
    damping, delay = (math.inf, 0.0) if device is None else (device.damping, device.delay)
    return FrictionRenderer(stiffness / scales, damping / scales, delay)


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader, at a time of its monotonic clock [ns]; the state is updated in place and returned.

    The force comes from the newest model at the operator's own motion alone. The delayed force is recorded for
    comparison and used nowhere else.

    A hand that feels the force is coupled with the follower once the follower's position is known, and again each time
    the clutch is released, without a jump of either; until then commands carry no position. While an emergency stop is
    latched, or the follower obeys another leader, it is let go and feels nothing. Where another follower process has
    started the model stays, for the material is the same, until that process knows as much (`FollowerView`).

    A human hand is measured when a tick really begins, `period_ns` after the last one. A simulated one, whose exact
    position is known, is evaluated at the tick's nominal time, on an even grid. Timed by the real starts of ticks, a
    motion of many milliseconds would count as one of one millisecond, and widen the bound of energy.
    """
    if state.start_ns is None:
        state.start_ns = now_ns
    renderer, view, hand = state.renderer, state.follower_view, state.hand
    ours, came = _take(state, inputs.arrived)
    renewed = view.take_renewed()
    if renewed:
        _renew(state)
    free = inputs.stopping or view.stopped or not view.in_control
    # A renewed hand is let go for a tick, so that the force leaves as models do.
    couples = renderer.closed_loop and not (free or renewed) and (inputs.clutched or not renderer.proxy.engaged)
    time, measured = (now_ns - state.start_ns) * 1e-9, inputs.period_ns * 1e-9
    even = measured if state.newest_ns is None else (now_ns - state.newest_ns) * 1e-9
    state.newest_ns = now_ns
    now = time, measured, even, free, came or couples
    (at, exact, intended), frame, rendered = hand.come_to(inputs, renderer, view, now)
    if rendered is None:
        for model in ours:
            _adopt(state, model)
        if not came:
            hand.go_on(renderer)
        if couples:
            _couple(state, at, clutched=inputs.clutched)
        period = even if math.isfinite(exact) else measured  # the same where the tick is done at once
        rendered = renderer.update(time, at, period, free=free, frame=frame)
    position, engaged, clipped, mediated, step_by_models, share = renderer.shown
    energy, energy_bound, late_energy = renderer.booked
    velocity, predicted, jump, _ = renderer.predicted
    state.sequence += 1
    place, deviation, space = hand.finish(renderer)
    command = Command(
        VERSION,
        state.sequence,
        now_ns,
        position,
        renderer.predictor.message,
        state.guarded,
        state.holder,
        state.epoch,
        place,
        view.telemetry.newest,
        view.run,
    )
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        position,
        velocity,
        predicted,
        rendered,
        view.force,
        view.telemetry.newest,
        view.models.newest,
        jump,
        clipped,
        inputs.period_ns,
        inputs.compute_ns,
        deviation,
        at,
        exact,
        intended,
        mediated,
        step_by_models,
        energy,
        energy_bound,
        share,
        engaged,
        state.epoch,
        view.run,
        late_energy,
        space,
    )
    return state, Outputs(command, record)


def _take(state: State, arrived: Sequence[Message]) -> tuple[list[ModelUpdate], bool]:
    """Take messages of the follower; the models that are for this leader, and whether there were any."""
    view, ours, came = state.follower_view, [], False
    for message in arrived:
        kind = type(message)
        if kind is Telemetry:
            view.take_telemetry(message)  # type: ignore[arg-type]
        state.hand.take(message, state.renderer, view)
        if kind is ModelUpdate:
            came = True
            if view.is_for_us(message):  # type: ignore[arg-type]
                ours.append(message)
    return ours, came  # type: ignore[return-value]


def _couple(state: State, hand: float, *, clutched: bool) -> None:
    """Couple a hand [m] where it was left, at first where the follower is; a pressed clutch lets it go."""
    renderer, proxy = state.renderer, state.renderer.proxy
    if clutched:
        proxy.release()
        return
    position = state.follower_view.position if math.isnan(proxy.position) else proxy.position
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
    renderer, surface = state.renderer, state.hand.offset + update.surface
    if state.inherits and not (update.valid and state.follower_view.has_relearnt):
        predictor = renderer.predictor
        if update.valid and abs(surface - predictor.surface) < SAME_SURFACE:
            predictor.message = update.sequence  # its surface is known here
        return
    if not update.valid:
        renderer.adopt(None, surface, message=update.sequence)
        return
    state.inherits = False
    model, remembered = None, NO_STATE
    if abs(surface) <= LARGEST_POSITION:
        with suppress(InputError):
            model, remembered = make_model(update.law, update.parameters, update.map), update.state
    if model is None:
        state.refused += 1  # render and acknowledge nothing: the follower must not assume that its surface is known
        renderer.adopt(None, 0.0)
    else:
        renderer.adopt(model, surface, remembered, update.command_sequence, update.sequence)
        state.hand.adopt(update, renderer)
