"""The leader's step: takes the operator's motion; gives a command and the force of the virtual environment.

Hand and follower are coupled as soon as both positions are known, except while the clutch is pressed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple, TypeAlias

from foretouch.core import Held
from foretouch.devices import DeviceSpecification
from foretouch.errors import InputError
from foretouch.messages import VERSION, Command, LeaderState, Message, ModelUpdate, Telemetry
from foretouch.models import ContactModel, make_model
from foretouch.quantities.pose import Vector
from foretouch.rendering import EnergyAccount, FrictionRenderer, Renderer, SpatialEnergyAccount
from foretouch.rendering.renderer import ON_AXIS
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps import leading
from foretouch.session.steps.axis import HandOnAxis
from foretouch.session.steps.follower_view import FollowerView
from foretouch.settings import NO_GRIP

ACCOUNTS: dict[int, type[Any]] = {account.axes: account for account in (EnergyAccount, SpatialEnergyAccount)}

Position: TypeAlias = float | Vector


class State(Held):
    """State of the leader, updated in place in each tick: a record (`foretouch.session.steps.leading.Leader`).

    Args:
        renderer: Renders for the hand.
        guarded: Whether the follower is asked to guard the first touch.
        holder: Name of this leader.
        follower_view: Messages received from the follower. Its force is recorded and never rendered.
        hand: The operator's hand, on an axis or in space.

    Attributes:
        inherits: Whether the model is of a follower's process that is gone, and its successor knows less yet.
        refused: Number of models that could not be used, whatever they claimed.
        sequence: Number of the newest command, 0 before the first.
    """

    sequence: int
    inherits: bool
    refused: int
    guarded: bool

    def __init__(
        self, renderer: Renderer, guarded: bool, holder: str, follower_view: FollowerView, hand: HandOnAxis
    ) -> None:
        super().__init__(leading.Leader.new(guarded=guarded, axis=ON_AXIS))
        self.renderer, self.holder, self.follower_view, self.hand = renderer, holder, follower_view, hand
        self.epoch = follower_view.epoch
        own = self.records
        renderer.move_into(own["renderings"][0], own["accounts"][0], own["predictions"][0])
        own["views"][0], follower_view.records = follower_view.records, own["views"][0]
        for kernel in leading.ENTRIES:
            kernel.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop


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
    return State(renderer, guarded, holder, FollowerView(epoch), hand)


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
    renderer, view, hand, record = state.renderer, state.follower_view, state.hand, state.records[0]
    ours, came = _take(state, inputs.arrived)
    free, couples = leading.decide_entry.entry(record, inputs.stopping, inputs.clutched)
    time, measured, even = leading.begin_entry.entry(record, now_ns, inputs.period_ns)
    now = time, measured, even, free, came or couples
    (at, exact, intended), frame, rendered = hand.come_to(inputs, renderer, view, now)
    if rendered is None:
        for model in ours:
            _adopt(state, model)
        if not came:
            hand.go_on(renderer)
        if couples:
            leading.couple_entry.entry(record, at, inputs.clutched)
        period = even if math.isfinite(exact) else measured  # the same where the tick is done at once
        rendered = renderer.update(time, at, period, free=free, frame=frame)
    position, engaged, clipped, mediated, step_by_models, share = renderer.shown
    energy, energy_bound, late_energy = renderer.booked
    velocity, predicted, jump, _ = renderer.predicted
    sequence = state.sequence
    place, deviation, space = hand.finish(renderer)
    telemetry, force, run = view.telemetry.newest, view.force, view.run
    command = Command(
        VERSION,
        sequence,
        now_ns,
        position,
        renderer.predictor.message,
        state.guarded,
        state.holder,
        state.epoch,
        place,
        telemetry,
        run,
    )
    record = LeaderState(
        VERSION,
        sequence,
        now_ns,
        position,
        velocity,
        predicted,
        rendered,
        force,
        telemetry,
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
        run,
        late_energy,
        space,
    )
    return state, Outputs(command, record)


def _take(state: State, arrived: Sequence[Message]) -> tuple[list[ModelUpdate], bool]:
    """Take messages of the follower; the models that are for this leader, and whether there were any.

    Models of a process that has just been followed by another are adopted before that is known.
    """
    view, came = state.follower_view, False
    ours: list[ModelUpdate] = []
    for message in arrived:
        model = message if type(message) is ModelUpdate else None
        if type(message) is Telemetry:
            view.take_telemetry(message)
        state.hand.take(message, state.renderer, view)
        came = came or model is not None
        mine = model is not None and view.is_for_us(model)
        if view.take_renewed():
            for former in ours:
                _adopt(state, former)
            ours.clear()
            leading.renew_entry.entry(state.records[0], state.renderer.predictor.model is not None)
            state.renderer.predictor.disown()
        if model is not None and mine:
            ours.append(model)
    return ours, came


def _adopt(state: State, update: ModelUpdate) -> None:
    """Predict from an arrived model; one that claims to be valid and cannot be evaluated counts as no model."""
    renderer, surface = state.renderer, state.hand.offset + update.surface
    model: ContactModel | None = None
    if update.valid:
        with suppress(InputError):
            model = make_model(update.law, update.parameters, update.map)
    done = leading.judge_entry.entry(state.records[0], update.valid, model is not None, surface, update.sequence)
    if done == leading.ADOPTED:
        renderer.adopt(model, surface, update.state, update.command_sequence, update.sequence)
        state.hand.adopt(update, renderer)
    elif done == leading.NOTHING_RENDERED:
        renderer.adopt(None, surface, message=update.sequence)
    elif done == leading.REFUSED:
        renderer.adopt(None, 0.0)
