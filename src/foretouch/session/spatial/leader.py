"""The leader's step in three dimensions: geometry about the step along a line.

The hand's position is projected onto the normal of the rendered surface; there the leader along a line renders,
mediates and accounts; and its force is brought back into space, with the friction along the surface added. The law is
that at the hand's position, from the newest field of materials, with its uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from foretouch.devices import DeviceSpecification
from foretouch.errors import DecodeError, InputError
from foretouch.messages import (
    VERSION,
    Command,
    FieldUpdate,
    LeaderSpace,
    LeaderState,
    ModelUpdate,
    Telemetry,
)
from foretouch.models import FIELD_DEPTH, MaterialField, QuadraticContact
from foretouch.models.contact_model import NO_STATE
from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.rendering import FrictionRenderer, SpatialEnergyAccount
from foretouch.rendering.surfaces import Surface
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import ClosestPoint, SurfaceLine
from foretouch.session.steps import leader
from foretouch.settings import NO_GRIP

FAR_FROM_LAW = 1e-3  # Displacement of the hand after which the material is looked up again [m]
NEAR = 5e-3  # Distance from the surface within which materials are taken from the field [m]

NOWHERE = (math.nan, math.nan, math.nan)


class TouchedMaterial:
    r"""The surface's material as a field over the surface, as the leader knows it.

    A field gives the standard deviation of the local stiffness K at 2 mm. The force there has the same relative
    standard deviation,

    .. math:: \sigma_F = F\, \sigma_K / K

    Attributes:
        uncertainty: sigma_K / K of the law that was taken last; NaN before the first.
        refused: Number of fields that could not be used.
    """

    __slots__ = ("_at", "_field", "_run", "_sequence", "refused", "uncertainty")

    def __init__(self) -> None:
        self._field: MaterialField | None = None
        self._sequence = self._run = 0
        self._at: Vector = NOWHERE
        self.uncertainty = math.nan
        self.refused = 0

    def take(self, update: FieldUpdate) -> None:
        """Take a field, unless a newer one of the same follower process is already there."""
        if update.run == self._run and update.sequence <= self._sequence:
            return
        self._sequence, self._run = update.sequence, update.run
        try:
            self._field = MaterialField.from_bytes(update.content)
        except (InputError, DecodeError):
            self.refused += 1

    def law(self, point: Vector, depth: float) -> QuadraticContact | None:
        """The law at a point, in the fixture's frame, for a hand at this depth [m]; None where unknown."""
        if self._field is None or depth < -NEAR:
            return None
        law, deviation, known = self._field.law_at(point)
        stiffness = law.stiffness + 2.0 * FIELD_DEPTH * law.stiffening
        self.uncertainty = deviation / stiffness if stiffness > 0.0 else math.nan
        if not known:
            return None
        self._at = point
        return law

    def is_elsewhere(self, point: Vector) -> bool:
        """Whether the law was never taken, or too far from this point to hold here."""
        return not norm(subtract(point, self._at)) <= FAR_FROM_LAW


MOST_FRICTION, MOST_VISCOUS = 2.0, 20.0
"""Largest coefficients of friction that are rendered, whatever a follower sends [-, N s/m]."""

REACH = 1e-4  # Interval over which the local stiffness is given [m]


@dataclass(slots=True)
class State:
    """State of the leader, updated in place in each tick.

    Attributes:
        line: Line of the hand.
        account: Energy account in all directions.
        largest_force: Largest force of the device [N].
        apart: Offset between the hand and its position in the world [m].
        hand: Position of the hand in the world [m].
        left: Commanded position of the follower [m].
        felt_deeper: How much deeper than believed the surface was felt [m].
        follower_at: Newest commanded position of the follower that was received [m].
        follower_run: Run of the follower process that sent it.
        offset: Offset of the line then [m].
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


class Outputs(NamedTuple):
    """Command, and records of this tick along the normal and in space; the latter has the force for the hand."""

    command: Command
    record: LeaderState
    space: LeaderSpace

    @property
    def force(self) -> Vector:
        """Force for the hand [N]."""
        return self.space.force_x, self.space.force_y, self.space.force_z


def start(
    settings: SessionSettings,
    surface: Surface,
    pose: tuple[float, ...],
    *,
    holder: str = "leader",
    epoch: int = 1,
    device: DeviceSpecification | None = None,
) -> State:
    """State before the first tick, with a surface in the fixture's frame and the believed pose of the fixture.

    `device` is one that a person holds and feels; None for none, or for a simulated one with a grip.
    """
    held, felt = settings.grip != NO_GRIP or device is not None, device
    device = settings.device if device is None else device
    stiffness = device.largest_stiffness(SAMPLE_PERIOD)
    if settings.largest_stiffness:
        stiffness = min(stiffness, settings.largest_stiffness)
    account = SpatialEnergyAccount.of(device if held else None, SAMPLE_PERIOD)
    damping, delay = (device.damping, device.delay) if held else (math.inf, 0.0)
    scales = settings.force_scale * settings.position_scale  # friction is rendered in the follower's lengths and forces
    return State(
        leader.start(settings, holder=holder, epoch=epoch, device=felt, account=account),
        SurfaceLine(surface, pose),
        FrictionRenderer(stiffness / scales, damping / scales, delay),
        account,
        settings.position_scale,
        settings.force_scale,
        device.force_limit,
    )


def step(state: State, inputs: leader.Inputs[Vector], now_ns: int) -> tuple[State, Outputs]:
    """One tick of the leader, at a time of its monotonic clock [ns]; the state is updated in place and returned."""
    for space in inputs.spaces:
        state.follower_at, state.follower_run = (space.desired_x, space.desired_y, space.desired_z), space.run
    for update in inputs.fields:
        if _is_current(state, update.run):
            state.material.take(update)
    models = [_take_model(state, model) for model in inputs.models]
    hand, telemetry = _couple(state, inputs)
    closest = state.line.follow(hand)
    seen = all(map(math.isfinite, inputs.position))
    period = leader.moving_time(inputs.period_ns, inputs.exact_position[0], now_ns, state.inner.newest_ns)
    state.account.observe(inputs.position, period)  # the device's own position, whatever it is coupled with
    models = [_local(state, model, closest) for model in models]
    if not models:
        _go_on(state, closest)
    state.offset = state.line.offset
    in_space: Any = inputs
    projected = in_space._replace(
        position=closest.along / state.position_scale if seen and math.isfinite(hand[0]) else math.nan,
        models=models,
        telemetry=telemetry,
        exact_position=_depth_of(state, inputs.exact_position),
        intended_position=_depth_of(state, inputs.intended_position),
    )
    _, led = leader.step(state.inner, projected, now_ns)
    position = led.command.position
    if math.isfinite(position):
        state.left = closest.place_at(position)
    force = _force(state, closest, led.record.rendered_force, period)
    point = state.left if math.isfinite(position) else ()
    command = msgspec.structs.replace(led.command, place=point)
    record, uncertainty = led.record, state.material.uncertainty
    if not math.isnan(uncertainty):  # else there is no field, and the model's own is known
        record = msgspec.structs.replace(record, standard_deviation=uncertainty * record.predicted_force)
    return state, Outputs(command, record, _space(state, closest, force, now_ns))


def _is_current(state: State, run: int) -> bool:
    """Whether this run of the follower is the current one; none is, before the first."""
    return state.inner.follower_view.run in (0, run)


def _take_model(state: State, model: ModelUpdate) -> ModelUpdate:
    """Take fixture and friction from a model, if it is the newest; return it with its surface on the line."""
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


def _couple(state: State, inputs: leader.Inputs[Vector]) -> tuple[Vector, list[Telemetry]]:
    """Position of the hand in the world, and the telemetry for a leader along the line.

    Hand and follower meet at the follower's commanded position, and after a clutch at the hand's last one.
    """
    proxy = state.inner.renderer.proxy
    here = scaled(inputs.position, state.position_scale)
    if not all(map(math.isfinite, here)):
        return state.hand, inputs.telemetry
    if not state.inner.renderer.closed_loop:
        state.hand = here
        return here, inputs.telemetry
    if proxy.engaged:
        state.hand = subtract(here, state.apart)
        return state.hand, inputs.telemetry
    was_left = not math.isnan(proxy.position) and math.isfinite(state.hand[0])
    newest = inputs.telemetry[-1].run if inputs.telemetry else state.inner.follower_view.run
    meet = state.hand if was_left else state.follower_at
    if not math.isfinite(meet[0]) or not (was_left or state.follower_run == newest):
        state.inner.follower_view.position = math.nan
        return NOWHERE, [msgspec.structs.replace(one, desired_position=math.nan) for one in inputs.telemetry]
    state.apart, state.hand = subtract(here, meet), meet
    along = state.line.follow(meet).along
    state.inner.follower_view.position = along
    return meet, [msgspec.structs.replace(one, desired_position=along) for one in inputs.telemetry]


def _local(state: State, model: ModelUpdate, closest: ClosestPoint) -> ModelUpdate:
    """A model with the law at the hand's position, where the field knows it."""
    if not model.valid:
        return model
    law = state.material.law(closest.inner_point, closest.depth)
    return model if law is None else msgspec.structs.replace(model, law=law.law, parameters=law.parameters, map=b"")


def _go_on(state: State, closest: ClosestPoint) -> None:
    """Take the law of another point, where no model came: the hand moves over the surface meanwhile."""
    predictor = state.inner.renderer.predictor
    elsewhere = state.material.is_elsewhere(closest.inner_point)
    if predictor.model is None or not (elsewhere or state.offset != state.line.offset):
        return
    law = state.material.law(closest.inner_point, closest.depth) or predictor.model
    if law is not predictor.model or state.offset != state.line.offset:
        surface = state.line.offset + state.felt_deeper
        memory = predictor.state if law is predictor.model else NO_STATE
        state.inner.renderer.adopt(law, surface, memory, message=predictor.message)


def _depth_of(state: State, place: Vector) -> float:
    """A recorded position as a coordinate along the normal of the hand's closest point [m]."""
    closest = state.line.closest
    if closest is None or not math.isfinite(place[0]):
        return math.nan
    here = subtract(scaled(place, state.position_scale), state.apart)
    return (closest.along - dot(subtract(here, state.hand), closest.normal)) / state.position_scale


def _force(state: State, closest: ClosestPoint, rendered: float, period: float) -> Vector:
    """Force for the hand: normal force as rendered, friction, within the limits of device and energy [N]."""
    pressed = rendered / state.force_scale
    friction = state.friction.update(
        closest.point, closest.normal, pressed, state.coefficient, state.viscous, min(period, SAMPLE_PERIOD)
    )
    force = scaled(closest.normal, rendered)
    beside = scaled(friction, state.force_scale)
    left = math.sqrt(max(state.largest_force**2 - rendered**2, 0.0))
    size = norm(beside)
    if size > left:
        beside = scaled(beside, left / size)
    force = add(force, beside)
    return state.account.hold(force)


def _space(state: State, closest: ClosestPoint, force: Vector, now_ns: int) -> LeaderSpace:
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
        *closest.point,
        *closest.normal,
        *force,
        closest.depth - state.felt_deeper,
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
