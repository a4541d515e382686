"""The follower's step in three dimensions: geometry about the step along a line.

Commands, the probe and its force are projected onto the normal of the believed surface; there the follower along a
line decides which leader commands, learns, guards and limits; and the allowed position is brought back into space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.identification import Estimator, FrictionEstimator, MaterialFieldLearner, SensorState
from foretouch.identification.friction import Friction, learn_friction
from foretouch.messages import (
    VERSION,
    Command,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    ModelUpdate,
    Status,
    Telemetry,
)
from foretouch.quantities import pose as rigid
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Numbers3, add, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.line import Closest, rotate
from foretouch.robot import RobotSample, RobotSpecification, SpatialSample
from foretouch.session.network.model_sender import FieldSender
from foretouch.session.network.playout import Playout
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import ClosestPoint, SurfaceLine
from foretouch.session.spatial.safety import Space, SpatialSafety
from foretouch.session.spatial.way_in import MISSED, MISSED_TICKS, Known
from foretouch.session.steps import follower

BIAS_RATE = 2e-4  # Weight per tick of the measured force in the sensor's offset in free air, once it is known from 5 s

QUIET, SETTLING = 0.3, 50
"""Largest deviation from the offset in free air [N], and number of ticks after which the offset is known."""

AFTER_CONTACT = 500
"""Ticks after a contact before free air begins: a probe that leaves slowly still feels a little below the threshold."""

SLIDING = 0.01
"""Speed below which the direction of sliding is unknown [m/s]: the encoders' noise turns it, and friction seems to be
less."""

POSE_NUMBERS = 6


LATEST = 2e-3  # Depth at which a contact may have been noticed at most [m]; one noticed deeper tells no surface

FELT_WAY, TOUCH_EXPONENT = 1e-3, 1.15
"""The surface is known from how the force grows over this way [m], with this exponent of depth."""

SMOOTHED = -math.expm1(-2.0 * math.pi * 20.0 * SAMPLE_PERIOD)
"""Weight of a tick in a low-pass of 20 Hz: the speed of one tick is mostly the encoders' noise."""


class FeltSurface(Record):
    r"""Where a contact began, once it is 1 mm deep.

    A contact is noticed late, at a force F_1 that the surface gives at a depth d. With F_2 after h more,

    .. math:: d = \frac{r h}{1 - r}, \quad r = (F_1 / F_2)^{1 / n}

    for a law of exponent n, here 1.15: a spring has 1, and Hertz's ball 1.5.
    """

    place: Numbers3 = math.nan  # type: ignore[assignment]  # newest onset that tells of the surface [m]
    tick: int  # in which that was known
    ticks: int  # since this contact began; 0 while there is none
    began: float  # force at which this contact began [N]
    at: float  # position along the normal then [m]
    known: bool  # whether this contact needs no more


@compiled(error_model="numpy")
def _feel(touch: FeltSurface, force: float, closest: Closest, place: Vector, tick: int) -> None:
    """Feel a force along the normal [N] at a place of the probe [m] in a tick."""
    touch.ticks += 1
    if touch.ticks == 1:
        touch.began, touch.at, touch.known = force, closest.along, False
    way = closest.along - touch.at
    if touch.known or way < FELT_WAY:
        return
    touch.known = True
    ratio = (touch.began / force) ** (1.0 / TOUCH_EXPONENT) if 0.0 < touch.began < force else 1.0
    if ratio * way <= LATEST * (1.0 - ratio):  # else it hardly grew: its onset is unknown
        write(touch.place, add(place, scaled(vector(closest.normal), way / (1.0 - ratio))))
        touch.tick = tick


class Beside(Record):
    """What is learnt beside the law."""

    touch: FeltSurface
    friction: Friction
    pressed: float  # force along the normal [N], low-passed
    rubbed: Numbers3  # force along the surface [N], low-passed alike
    sliding: Numbers3  # velocity along it [m/s], low-passed alike
    largest_offset: float  # of the sensor, which is no contact [N]
    bias: Numbers3  # the sensor's offset [N]
    bias_ticks: int  # number of ticks that it is known from
    free_ticks: int  # since free air began; negative for a while after a contact
    missed_ticks: int  # in which the surface was missed
    point: Numbers3 = math.nan  # type: ignore[assignment]  # of the surface, in the fixture, in the tick before [m]


LEFT, MISSED_IT, TOLD = 1, 2, 4
"""Of a tick: contact was left; the surface was missed; the onset of a contact is known."""


@compiled(error_model="numpy")
def _in_free_air(beside: Beside, force: Vector, missed: bool) -> int:
    """Learn the sensor's offset. A robot that is deeper than where it was felt and feels nothing has missed it."""
    news, beside.touch.ticks = LEFT if beside.touch.ticks > 0 else 0, 0
    beside.free_ticks += 1
    beside.missed_ticks = beside.missed_ticks + 1 if missed else 0
    if beside.missed_ticks >= MISSED_TICKS:
        beside.missed_ticks = 0
        news |= MISSED_IT
    away = subtract(force, vector(beside.bias))
    still = not norm(away) > QUIET or beside.bias_ticks < SETTLING
    if beside.free_ticks > 0 and still and norm(force) < beside.largest_offset:
        beside.bias_ticks += 1
        rate = max(1.0 / beside.bias_ticks, BIAS_RATE)
        write(beside.bias, add(vector(beside.bias), scaled(away, rate)))
    return news


@kernel("i8(Beside[::1], Space[::1], UniTuple(f8, 3), f8, f8, b1, b1, i8)", Space)
def learn_beside(
    besides: NDArray[np.void],
    spaces: NDArray[np.void],
    force: Vector,
    pressed: float,
    depth: float,
    in_contact: bool,
    good: bool,
    tick: int,
) -> int:
    """In free air the sensor's offset; in contact friction, and where the contact began. Returns what is news.

    The law was learnt from a force along the normal, pressed [N], and a depth [m]; the whole force is as measured [N].
    """
    beside, line, course = besides[0], spaces[0].probe, spaces[0].course
    point, sideways = vector(line.closest.inner_point), vector(course.resistance)
    moved = subtract(point, vector(beside.point))
    write(beside.point, point)
    if not in_contact:
        return _in_free_air(beside, force, depth > MISSED and good)
    beside.free_ticks = -AFTER_CONTACT
    if math.isfinite(moved[0] + sideways[0] + sideways[1] + sideways[2]):
        rubbed, sliding = vector(beside.rubbed), vector(beside.sliding)
        speed = rotate(line, scaled(moved, 1.0 / SAMPLE_PERIOD))
        beside.pressed += SMOOTHED * (pressed - beside.pressed)
        rubbed = add(rubbed, scaled(subtract(sideways, rubbed), SMOOTHED))
        sliding = add(sliding, scaled(subtract(speed, sliding), SMOOTHED))
        write(beside.rubbed, rubbed)
        write(beside.sliding, sliding)
        if norm(sliding) > SLIDING:
            learn_friction(beside.friction, beside.pressed, rubbed, sliding, SAMPLE_PERIOD)
    before = beside.touch.tick
    _feel(beside.touch, pressed, line.closest, vector(course.here), tick)
    return TOLD if beside.touch.tick != before else 0


NO_BELIEF = FixtureBelief(VERSION, 0, 0, (0.0,) * 6, (), math.inf, 0, 0, 0, "", epoch=0)
"""Belief before the first: no image has shown the fixture, and its error is unknown."""


@dataclass(slots=True)
class State:
    """State of the follower, updated in place in each tick.

    Attributes:
        safety: Safety in space, with the lines of probe and commands.
        approach_speed: Speed along a surface whose first touch is guarded [m/s].
        largest_speed: Largest speed of the robot [m/s].
        besides: One `Beside`.
        friction: Of the surface.
        learn: `learn_beside`, loaded before the loop.
        bias: The force sensor's offset [N].
        touch: Onset of the newest contact that tells of the surface [m]; NaN before it.
        touch_tick: Tick in which that was known.
        belief: Newest belief of the fixture's pose, as its tracker sent it.
        believed_ns: Clock at its arrival: it ages while no other comes [ns].
        shown: What the sensor showed in the tick before, and its part along the normal [N].
    """

    inner: follower.State
    safety: SpatialSafety
    fields: FieldSender
    approach_speed: float
    largest_speed: float
    besides: NDArray[np.void]
    friction: FrictionEstimator
    learn: Callable[..., int] = field(default_factory=lambda: learn_beside.entry)
    bias: Vector = (0.0, 0.0, 0.0)
    touch: Vector = (math.nan, math.nan, math.nan)
    touch_tick: int = 0
    belief: FixtureBelief = NO_BELIEF
    believed_ns: int = 0
    shown: tuple[Vector, float] = ((math.nan, math.nan, math.nan), math.nan)

    @property
    def line(self) -> SurfaceLine:
        """Line of the probe."""
        return self.safety.line


class Outputs(NamedTuple):
    """Position for the robot [m], telemetry for all subscribers, and model and field for the leader when due."""

    desired: Vector
    telemetry: Telemetry
    model: ModelUpdate | None
    space: FollowerSpace
    field: FieldUpdate | None


def start(
    specification: RobotSpecification,
    settings: SessionSettings,
    surface: Surface,
    pose: tuple[float, ...],
    estimator: Estimator | None = None,
    *,
    run: int = 1,
) -> State:
    """State before the first tick.

    Args:
        specification: Specification of the robot; its tool is already compensated.
        settings: Session settings.
        surface: Surface that is touched, in the fixture's frame.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].
        estimator: New estimator; None for the one that the settings name.
        run: Epoch of this process.
    """
    inner = follower.start(specification, settings, estimator, run=run)
    safety, besides = SpatialSafety(inner.safety, surface, pose, SAMPLE_PERIOD), Beside.new()
    besides["largest_offset"] = inner.specification.largest_offset
    inner.playout = Playout(safety.go)
    friction, fields = FrictionEstimator(besides["friction"]), FieldSender(inner.run)
    return State(inner, safety, fields, settings.approach_speed, settings.largest_speed, besides, friction)


def step(state: State, inputs: follower.Inputs[SpatialSample], now_ns: int) -> tuple[State, Outputs]:
    """One tick of the follower, at a time of its monotonic clock [ns]; the state is updated in place and returned."""
    inner, sample, safety = state.inner, inputs.sample, state.safety
    failures, learnt_from = inner.failures, inner.learner.sample
    try:
        for belief in inputs.beliefs:
            _believe(state, belief, now_ns)
    except Exception as error:
        failures.note("what it believes of the fixture", error)
    force = rigid.subtract(sample.force, state.bias)
    known = Known(
        inner.learner.conditioner.surface,
        learnt_from.force,
        inner.safety.fastest,
        state.approach_speed if inner.first_touch.guarded else state.largest_speed,
        learnt_from.in_contact,
        inner.watch.state is SensorState.GOOD,
        math.isfinite(state.belief.image_age),
        inner.safety.status < Status.HOLDING,
    )
    felt, inner.free, inner.slid, jump = safety.arrive(sample.place, force, known)
    closest = safety.line.newest
    if jump:
        inner.learner.conditioner.shift(jump)
    try:
        commands = [_with_position(command) for command in inputs.commands]
    except Exception as error:
        failures.note("its commands in space", error)
        commands = []
    estimator = inner.learner.estimator
    if failures.learns and isinstance(estimator, MaterialFieldLearner):
        try:
            estimator.touch_at(closest.inner_point)
        except Exception as error:
            failures.stop_learning("its learning in space", error)
    if sample.force == state.shown[0]:  # a sensor that hangs is to seem so along any normal
        felt = state.shown[1]
    state.shown = sample.force, felt
    along = RobotSample(
        position=closest.along,
        sensor_force=felt,
        acceleration=0.0,
        exact_force=rigid.norm(sample.exact_force),
        exact_position=math.nan,
        commanded_position=closest.along,
        clipped=sample.clipped,
    )
    in_space: Any = inputs
    _, allowed = follower.step(inner, in_space._replace(commands=commands, sample=along), now_ns)
    model, materials = None, None
    if failures.learns:
        try:
            _learn_beside_the_law(state, sample.force)
            model = None if allowed.model is None else _with_fixture(state, allowed.model, now_ns)
            materials = state.fields.due(estimator, now_ns)
        except Exception as error:
            failures.stop_learning("its learning in space", error)
            model = None
    desired, desired_along = safety.limit(allowed.desired_position)
    space = _space(state, sample, closest, force, desired, now_ns)
    telemetry = msgspec.structs.replace(allowed.telemetry, desired_position=desired_along)
    return state, Outputs(desired, telemetry, model, space, materials)


def _believe(state: State, belief: FixtureBelief, now_ns: int) -> None:
    known = state.belief
    if belief.run != state.inner.run or (belief.epoch, belief.sequence) <= (known.epoch, known.sequence):
        return  # it is late, or of another process
    before = state.line.offset
    if state.safety.believe(belief) and belief.contacts == known.contacts:
        # The image shows that the fixture is elsewhere: so is the surface that was felt. A touch shows where it was all
        # the time.
        state.inner.learner.conditioner.shift(state.line.offset - before)
    state.belief, state.believed_ns = belief, now_ns


def _with_position(command: Command) -> Command:
    """A command whose position says only whether it has a place: the course says where that is on the normal."""
    position = command.place
    known = len(position) == 3 and all(map(math.isfinite, position))
    return msgspec.structs.replace(command, position=max(map(abs, position)) if known else math.nan)


def _learn_beside_the_law(state: State, force: Vector) -> None:
    """See `learn_beside`, and take what is news."""
    inner, besides = state.inner, state.besides
    learnt, good, spaces = inner.learner.sample, inner.watch.state is SensorState.GOOD, state.safety.spaces
    x, y, z = force
    news = state.learn(besides, spaces, (x, y, z), learnt.force, learnt.depth, learnt.in_contact, good, inner.tick)
    if not learnt.in_contact:
        x, y, z = besides["bias"][0].tolist()
        state.bias = x, y, z
    if news & LEFT:
        inner.learner.conditioner.distrust_surface()
    if news & MISSED_IT:
        inner.learner.conditioner.shift(learnt.depth)
    if news & TOLD:
        x, y, z = besides["touch"]["place"][0].tolist()
        state.touch, state.touch_tick = (x, y, z), inner.tick


def _with_fixture(state: State, model: ModelUpdate, now_ns: int) -> ModelUpdate:
    """A model with the fixture that it belongs to: its surface is how much deeper than believed it was felt."""
    friction = state.friction
    return msgspec.structs.replace(
        model,
        surface=model.surface - state.line.offset if model.valid else 0.0,
        fixture=state.line.pose,
        fixture_deviation=state.belief.deviation,
        fixture_age=state.belief.image_age + (now_ns - state.believed_ns) * 1e-9,
        friction=(friction.coefficient, friction.viscous, *friction.deviations) if friction.known else (),
    )


def _space(
    state: State, sample: SpatialSample, closest: ClosestPoint, force: Vector, desired: Vector, now_ns: int
) -> FollowerSpace:
    inner = state.inner
    x, y, z, rx, ry, rz = sample.fixture if len(sample.fixture) == POSE_NUMBERS else (math.nan,) * POSE_NUMBERS
    return FollowerSpace(
        VERSION,
        inner.tick,
        now_ns,
        *sample.place,
        *desired,
        *force,
        *closest.normal,
        closest.depth,
        *state.line.pose,
        *(x, y, z, rx, ry, rz),
        *state.touch,
        state.touch_tick,
        inner.run,
    )
