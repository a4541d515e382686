"""The leader's step in three dimensions: geometry about the step along a line.

The hand's place is brought onto the normal of the rendered surface; there the leader along a line renders, mediates and
accounts; and what it gives is brought back into space, with the friction along the surface beside it. The law is that
of the place where the hand is, from the newest field of materials, with its doubt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from foretouch.errors import DecodeError, InputError
from foretouch.messages import (
    VERSION,
    Command,
    FieldUpdate,
    FollowerSpace,
    LeaderSpace,
    LeaderState,
    ModelUpdate,
    Telemetry,
)
from foretouch.models import FIELD_DEPTH, MaterialField, QuadraticContact
from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.rendering import FrictionRenderer, NormalAccount, SpatialEnergyAccount
from foretouch.rendering.surfaces import Surface
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import Footing, SurfaceLine
from foretouch.session.steps import leader

FAR_FROM_LAW = 1e-3
"""The material of another place is taken once the hand is so far from where it was taken last [m]."""

NEAR = 5e-3
"""Materials are taken from the field within this way of the surface [m]."""

NOWHERE = (math.nan, math.nan, math.nan)


class TouchedMaterial:
    r"""What is known of the surface's material, place by place, at the leader.

    A field states the standard deviation of the local stiffness K at 2 mm. The force at a place is doubted in the same
    proportion,

    .. math:: \sigma_F = F\, \sigma_K / K

    Attributes:
        doubt: sigma_K / K of the law that was taken last; NaN before the first.
        refused: Fields that could not be used.
    """

    __slots__ = ("_at", "_field", "_run", "_sequence", "doubt", "refused")

    def __init__(self) -> None:
        self._field: MaterialField | None = None
        self._sequence = self._run = 0
        self._at: Vector = NOWHERE
        self.doubt = math.nan
        self.refused = 0

    def take(self, update: FieldUpdate) -> None:
        """Take a field, unless a newer one of the same process of the follower is there already."""
        if update.run == self._run and update.sequence <= self._sequence:
            return
        self._sequence, self._run = update.sequence, update.run
        try:
            self._field = MaterialField.from_bytes(update.content)
        except (InputError, DecodeError):
            self.refused += 1

    def law(self, point: Vector, depth: float) -> QuadraticContact | None:
        """The law of a place; None where nothing is known of it, or the hand is too far above.

        Args:
            point: On the surface, in the fixture's frame [m].
            depth: Of the hand below it [m].
        """
        if self._field is None or depth < -NEAR:
            return None
        law, deviation, known = self._field.law_at(point)
        stiffness = law.stiffness + 2.0 * FIELD_DEPTH * law.stiffening
        self.doubt = deviation / stiffness if stiffness > 0.0 else math.nan
        if not known:
            return None
        self._at = point
        return law

    def is_elsewhere(self, point: Vector) -> bool:
        """Whether the law was taken so far from this point, or never, that another may hold."""
        return not norm(subtract(point, self._at)) <= FAR_FROM_LAW


MOST_FRICTION, MOST_VISCOUS = 2.0, 20.0
"""Whatever a follower says, no more friction is rendered [-, N s/m]."""

REACH = 1e-4
"""Way over which the local stiffness is told [m]."""


@dataclass(slots=True)
class State:
    """What the leader remembers from tick to tick; updated in place.

    Attributes:
        inner: Of the leader along the surface's normal.
        line: Of the hand.
        friction: Renders it.
        account: Of the energy in all directions.
        position_scale: Follower's motion for the hand's.
        force_scale: Hand's force for the follower's.
        largest_force: That the device gives [N].
        apart: What the hand and its place in the world are apart [m].
        hand: Place of the hand in the world [m].
        left: Where the follower is told to be [m].
        material: Of the surface, place by place, as it came last.
        model: The newest model's message, None before.
        felt_deeper: How much deeper than believed the surface was felt [m].
        coefficient: Of Coulomb friction.
        viscous: Of viscous friction [N s/m].
        follower_at: Where the follower was told to be [m].
        follower_run: And which process of it.
        offset: Of the line then [m].
    """

    inner: leader.State
    line: SurfaceLine
    friction: FrictionRenderer
    account: SpatialEnergyAccount
    position_scale: float
    force_scale: float
    largest_force: float
    apart: Vector = (0.0, 0.0, 0.0)
    hand: Vector = NOWHERE
    left: Vector = NOWHERE
    material: TouchedMaterial = field(default_factory=TouchedMaterial)
    model: ModelUpdate | None = None
    felt_deeper: float = 0.0
    coefficient: float = 0.0
    viscous: float = 0.0
    follower_at: Vector = NOWHERE
    follower_run: int = 0
    offset: float = 0.0


class Inputs(NamedTuple):
    """What a tick is given: as `foretouch.session.steps.leader.Inputs`, in space.

    Attributes:
        place: Of the operator's hand, as the device's encoders show it [m].
        models: That have arrived since the last tick.
        telemetry: That has arrived since the last tick.
        spaces: Of the follower, that have arrived since the last tick.
        fields: That have arrived since the last tick.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took [ns].
        clutched: Whether the clutch is pressed.
        stopping: Whether an emergency stop was asked for here, and the follower has not said yet that it has stopped.
        exact_place: Of a simulated hand [m]; recorded only.
        intended: Where the hand wants to be [m]; recorded only.
    """

    place: Vector
    models: list[ModelUpdate]
    telemetry: list[Telemetry]
    spaces: list[FollowerSpace]
    fields: list[FieldUpdate]
    period_ns: int
    compute_ns: int
    clutched: bool = False
    stopping: bool = False
    exact_place: Vector = NOWHERE
    intended: Vector = NOWHERE


class Outputs(NamedTuple):
    """What a tick gives.

    Attributes:
        command: For the follower.
        record: Of this tick, along the normal.
        space: Of this tick, in space; its force is for the hand.
    """

    command: Command
    record: LeaderState
    space: LeaderSpace

    @property
    def force(self) -> Vector:
        """For the hand [N]."""
        return self.space.force_x, self.space.force_y, self.space.force_z


def start(
    settings: SessionSettings, surface: Surface, pose: tuple[float, ...], *, holder: str = "leader", epoch: int = 1
) -> State:
    """State before the first tick.

    Args:
        settings: Of the session.
        surface: Of the virtual scene, in the fixture's frame.
        pose: Of the fixture, as it is believed to be.
        holder: Name of this leader.
        epoch: Of this process.
    """
    held = settings.grip != NO_GRIP
    device = settings.device
    stiffness = device.largest_stiffness(SAMPLE_PERIOD)
    if settings.largest_stiffness:
        stiffness = min(stiffness, settings.largest_stiffness)
    account = SpatialEnergyAccount.of(device if held else None, SAMPLE_PERIOD)
    damping, delay = (device.damping, device.delay) if held else (math.inf, 0.0)
    scales = settings.force_scale * settings.position_scale  # friction is rendered in the follower's lengths and forces
    return State(
        leader.start(settings, holder=holder, epoch=epoch, account=NormalAccount(account)),
        SurfaceLine(surface, pose),
        FrictionRenderer(stiffness / scales, damping / scales, delay),
        account,
        settings.position_scale,
        settings.force_scale,
        device.force_limit,
    )


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader.

    Args:
        state: Updated in place and returned.
        inputs: Of this tick.
        now_ns: This side's monotonic clock [ns].
    """
    for space in inputs.spaces:
        state.follower_at, state.follower_run = (space.desired_x, space.desired_y, space.desired_z), space.run
    for update in inputs.fields:
        if _is_current(state, update.run):
            state.material.take(update)
    models = [_take_model(state, model) for model in inputs.models]
    hand, telemetry = _couple(state, inputs)
    footing = state.line.follow(hand)
    seen = all(map(math.isfinite, inputs.place))
    period = leader.moving_time(inputs.period_ns, inputs.exact_place[0], now_ns, state.inner.newest_ns)
    state.account.observe(inputs.place, period)  # the device's own, whatever it is coupled with
    models = [_local(state, model, footing) for model in models]
    if not models:
        _go_on(state, footing)
    state.offset = state.line.offset
    told = leader.Inputs(
        footing.along / state.position_scale if seen and math.isfinite(hand[0]) else math.nan,
        models,
        telemetry,
        inputs.period_ns,
        inputs.compute_ns,
        inputs.clutched,
        _depth_of(state, inputs.exact_place),
        _depth_of(state, inputs.intended),
        inputs.stopping,
    )
    _, led = leader.step(state.inner, told, now_ns)
    position = led.command.position
    if math.isfinite(position):
        state.left = footing.place_at(position)
    force = _force(state, footing, led.record.rendered_force, period)
    place = state.left if math.isfinite(position) else ()
    command = msgspec.structs.replace(led.command, place=place)
    record = msgspec.structs.replace(led.record, standard_deviation=state.material.doubt * led.record.predicted_force)
    return state, Outputs(command, record, _space(state, footing, force, now_ns))


def _is_current(state: State, run: int) -> bool:
    """Whether this follower's process is the one that is heard; none is, before the first."""
    return state.inner.heard.run in (0, run)


def _take_model(state: State, model: ModelUpdate) -> ModelUpdate:
    """Believe what a model says of fixture and friction, if it is the newest; its surface comes onto the line."""
    newest = state.model
    is_newest = newest is None or model.run != newest.run or model.sequence > newest.sequence
    if is_newest and _is_current(state, model.run):
        state.model = model
        if model.fixture:
            state.line.believe(model.fixture)
        if len(model.friction) >= 2 and all(0.0 <= value < math.inf for value in model.friction[:2]):
            state.coefficient = min(model.friction[0], MOST_FRICTION)
            state.viscous = min(model.friction[1], MOST_VISCOUS)
        if model.valid and math.isfinite(model.surface):
            state.felt_deeper = model.surface
    return msgspec.structs.replace(model, surface=state.line.offset + model.surface)


def _couple(state: State, inputs: Inputs) -> tuple[Vector, list[Telemetry]]:
    """Place of the hand in the world, and the telemetry as a leader along the line is to read it.

    Hand and follower meet where the follower is told to be, and after a clutch where the hand was.
    """
    proxy = state.inner.renderer.proxy
    here = scaled(inputs.place, state.position_scale)
    if not all(map(math.isfinite, here)):
        return state.hand, inputs.telemetry
    if not state.inner.renderer.closed_loop:
        state.hand = here
        return here, inputs.telemetry
    if proxy.engaged:
        state.hand = subtract(here, state.apart)
        return state.hand, inputs.telemetry
    was_left = not math.isnan(proxy.position) and math.isfinite(state.hand[0])
    newest = inputs.telemetry[-1].run if inputs.telemetry else state.inner.heard.run
    meet = state.hand if was_left else state.follower_at
    if not math.isfinite(meet[0]) or not (was_left or state.follower_run == newest):
        state.inner.heard.position = math.nan
        return NOWHERE, [msgspec.structs.replace(one, desired_position=math.nan) for one in inputs.telemetry]
    state.apart, state.hand = subtract(here, meet), meet
    along = state.line.follow(meet).along
    state.inner.heard.position = along
    return meet, [msgspec.structs.replace(one, desired_position=along) for one in inputs.telemetry]


def _local(state: State, model: ModelUpdate, footing: Footing) -> ModelUpdate:
    """A model with the law of the place where the hand is, where the field knows it."""
    if not model.valid:
        return model
    law = _law(state, footing)
    return model if law is None else msgspec.structs.replace(model, law=law.law, parameters=law.parameters, map=b"")


def _law(state: State, footing: Footing) -> QuadraticContact | None:
    return state.material.law(footing.inner_point, footing.depth)


def _go_on(state: State, footing: Footing) -> None:
    """Take the law of another place, where no model came: the hand goes over the surface meanwhile."""
    predictor = state.inner.renderer.predictor
    elsewhere = state.material.is_elsewhere(footing.inner_point)
    if predictor.model is None or not (elsewhere or state.offset != state.line.offset):
        return
    law = _law(state, footing) or predictor.model
    if law is not predictor.model or state.offset != state.line.offset:
        surface = state.line.offset + state.felt_deeper
        state.inner.renderer.adopt(law, surface, message=predictor.message)


def _depth_of(state: State, place: Vector) -> float:
    """A recorded place as a position along the normal of the hand's footing [m]."""
    footing = state.line.footing
    if footing is None or not math.isfinite(place[0]):
        return math.nan
    here = subtract(scaled(place, state.position_scale), state.apart)
    return (footing.along - dot(subtract(here, state.hand), footing.normal)) / state.position_scale


def _force(state: State, footing: Footing, rendered: float, period: float) -> Vector:
    """For the hand: along the normal as rendered, friction beside it, within the device and the energy [N]."""
    pressed = rendered / state.force_scale
    friction = state.friction.update(
        footing.point, footing.normal, pressed, state.coefficient, state.viscous, min(period, SAMPLE_PERIOD)
    )
    force = scaled(footing.normal, rendered)
    beside = scaled(friction, state.force_scale)
    left = math.sqrt(max(state.largest_force**2 - rendered**2, 0.0))
    size = norm(beside)
    if size > left:
        beside = scaled(beside, left / size)
    force = add(force, beside)
    return state.account.hold(force)


def _space(state: State, footing: Footing, force: Vector, now_ns: int) -> LeaderSpace:
    inner, model = state.inner, state.model
    predictor = inner.renderer.predictor
    known = model is not None and len(model.fixture_deviation) == 6
    deviation = model.fixture_deviation if model is not None and known else (math.nan,) * 6
    stiffness = math.nan if predictor.model is None else predictor.local_slopes(REACH)[0]
    return LeaderSpace(
        VERSION,
        inner.sequence,
        now_ns,
        *state.hand,
        *state.left,
        *footing.point,
        *footing.normal,
        *force,
        footing.depth - state.felt_deeper,
        stiffness,
        *state.line.pose,
        math.sqrt(sum(value * value for value in deviation[:3])),
        math.sqrt(sum(value * value for value in deviation[3:])),
        math.inf if model is None else model.fixture_age,
        state.coefficient,
        inner.renderer.energy,
        inner.renderer.energy_bound,
        inner.epoch,
        inner.renderer.late_energy,
    )
