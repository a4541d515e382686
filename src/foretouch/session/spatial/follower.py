"""The follower's step in three dimensions: geometry about the step along a line.

Commands, the probe and its force are projected onto the normal of the believed surface; there the follower along a
line decides which leader commands, learns, guards and limits; and the allowed position is brought back into space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from foretouch.identification import Estimator, FrictionEstimator, MaterialFieldLearner, SensorState
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
from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.rendering.surfaces import Surface
from foretouch.robot import RobotSample, RobotSpecification, SpatialSample
from foretouch.session.network.model_sender import FieldSender
from foretouch.session.network.playout import Playout
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import ClosestPoint, Course, SurfaceLine, Way
from foretouch.session.spatial.safety import MISSED, MISSED_TICKS, LastLimit, WayIn
from foretouch.session.steps import follower

BIAS_RATE = 2e-4  # Weight per tick of the measured force in the sensor's offset in free air, once it is known from 5 s

QUIET, SETTLING = 0.3, 50
"""Largest deviation from the offset in free air [N], and number of ticks after which the offset is known."""

LARGEST_PULL, PULL_SHARE = 0.5, 0.02
"""Pull above which a force is reduced [N], and fraction of it kept: enough that a sensor does not seem stuck."""

AFTER_CONTACT = 500
"""Ticks after a contact before free air begins: a probe that leaves slowly still feels a little below the threshold."""

SLIDING = 0.01
"""Speed below which the direction of sliding is unknown [m/s]: the encoders' noise turns it, and friction seems to be
less."""

NAN3 = (math.nan, math.nan, math.nan)
POSE_NUMBERS = 6


LATEST = 2e-3  # Depth at which a contact may have been noticed at most [m]; one noticed deeper tells no surface

FELT_WAY, TOUCH_EXPONENT = 1e-3, 1.15
"""The surface is known from how the force grows over this way [m], with this exponent of depth."""

SMOOTHED = -math.expm1(-2.0 * math.pi * 20.0 * SAMPLE_PERIOD)
"""Weight of a tick in a low-pass of 20 Hz: the speed of one tick is mostly the encoders' noise."""


class FeltSurface:
    r"""Where a contact began, once it is 1 mm deep.

    A contact is noticed late, at a force F_1 that the surface gives at a depth d. With F_2 after h more,

    .. math:: d = \frac{r h}{1 - r}, \quad r = (F_1 / F_2)^{1 / n}

    for a law of exponent n, here 1.15: a spring has 1, and Hertz's ball 1.5.

    Attributes:
        ticks: Ticks since this contact began; 0 while there is none.
        place: Onset of the newest contact that tells of the surface [m]; NaN before it.
        tick: Tick in which that was known.
    """

    __slots__ = ("_known", "_onset", "place", "tick", "ticks")

    def __init__(self) -> None:
        self._onset = 0.0, 0.0  # force at which this contact began [N], and the position along the normal then [m]
        self._known = False
        self.place: Vector = NAN3
        self.tick = self.ticks = 0

    def leave(self) -> bool:
        """Nothing is felt in this tick; whether something was in the one before."""
        left, self.ticks = self.ticks > 0, 0
        return left

    def feel(self, force: float, place: Vector, closest: ClosestPoint, tick: int) -> None:
        """Feel a force along the normal [N] at a place of the probe [m] in a tick."""
        self.ticks += 1
        if self.ticks == 1:
            self._onset, self._known = (force, closest.along), False
        began, at = self._onset
        way = closest.along - at
        if self._known or way < FELT_WAY:
            return
        self._known = True
        ratio = (began / force) ** (1.0 / TOUCH_EXPONENT) if 0.0 < began < force else 1.0
        if ratio * way <= LATEST * (1.0 - ratio):  # else it hardly grew: its onset is unknown
            self.place, self.tick = add(place, scaled(closest.normal, way / (1.0 - ratio))), tick


NO_BELIEF = FixtureBelief(VERSION, 0, 0, (0.0,) * 6, (), math.inf, 0, 0, 0, "", epoch=0)
"""Belief before the first: no image has shown the fixture, and its error is unknown."""


@dataclass(slots=True)
class State:
    """State of the follower, updated in place in each tick.

    Attributes:
        line: Line of the probe.
        approach_speed: Speed along a surface whose first touch is guarded [m/s].
        largest_speed: Largest speed of the robot [m/s].
        smoothed: Force along the normal and along the surface [N], and velocity along it [m/s], low-passed alike.
        bias_ticks: Number of ticks that it is known from.
        free_ticks: Ticks since free air began; negative for a while after a contact.
        belief: Newest belief of the fixture's pose, as its tracker sent it.
        believed_ns: Clock at its arrival: it ages while no other comes [ns].
        point: Point of the surface, in the fixture, in the tick before [m].
        shown: What the sensor showed then, and its part along the normal [N].
    """

    inner: follower.State
    line: SurfaceLine
    course: Course
    last: LastLimit
    way_in: WayIn
    fields: FieldSender
    approach_speed: float
    largest_speed: float
    friction: FrictionEstimator = field(default_factory=FrictionEstimator)
    smoothed: tuple[float, Vector, Vector] = (0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    bias: Vector = (0.0, 0.0, 0.0)
    bias_ticks: int = 0
    free_ticks: int = 0
    missed_ticks: int = 0
    belief: FixtureBelief = NO_BELIEF
    believed_ns: int = 0
    touch: FeltSurface = field(default_factory=FeltSurface)
    point: Vector = NAN3
    shown: tuple[Vector, float] = (NAN3, math.nan)


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
    ceiling, speed = settings.force_ceiling, settings.largest_speed
    probe, gone, reported = (SurfaceLine(surface, pose, leads=leads) for leads in (True, True, False))
    course = Course(gone, ceiling, speed, settings.return_speed, SAMPLE_PERIOD)
    inner.playout = Playout(course.go)
    last = LastLimit(inner.safety, reported, SAMPLE_PERIOD)
    way_in, fields = WayIn(surface), FieldSender(inner.run)
    return State(inner, probe, course, last, way_in, fields, settings.approach_speed, speed)


def step(state: State, inputs: follower.Inputs[SpatialSample], now_ns: int) -> tuple[State, Outputs]:
    """One tick of the follower, at a time of its monotonic clock [ns]; the state is updated in place and returned."""
    inner, sample, line, course = state.inner, inputs.sample, state.line, state.course
    failures = inner.failures
    try:
        for belief in inputs.beliefs:
            _believe(state, belief, now_ns)
    except Exception as error:
        failures.note("what it believes of the fixture", error)
    before = line.offset
    closest = line.follow(sample.place)
    if line.offset != before:  # the proxy has let go: the coordinate went on, and what was felt is elsewhere
        inner.learner.conditioner.shift(line.offset - before)
        state.last.line.offset = line.offset
    state.way_in.come_to(inner, line, closest, seen=math.isfinite(state.belief.image_age))
    force = subtract(sample.force, state.bias)
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
    # A pulling force is no contact of this surface: learnt as the sensor's offset, it would hide one.
    felt = dot(force, closest.normal)
    if felt < -LARGEST_PULL:
        felt = PULL_SHARE * (felt + LARGEST_PULL) - LARGEST_PULL
    if sample.force == state.shown[0]:  # a sensor that hangs is to seem so along any normal
        felt = state.shown[1]
    state.shown = sample.force, felt
    sideways = subtract(force, scaled(closest.normal, felt))
    if course.closest is None and all(map(math.isfinite, sample.place)):
        course.begin(sample.place)
        state.last.begin(sample.place)
    state.last.observe(sample.place, force, closest.normal)
    course.way = _way(state, sample, sideways)
    course.meet(line.offset)
    along = RobotSample(
        position=closest.along,
        sensor_force=felt,
        acceleration=0.0,
        exact_force=norm(sample.exact_force),
        exact_position=math.nan,
        commanded_position=closest.along,
        clipped=sample.clipped,
    )
    in_space: Any = inputs
    _, allowed = follower.step(inner, in_space._replace(commands=commands, sample=along), now_ns)
    model, materials = None, None
    if failures.learns:
        try:
            _learn_beside_the_law(state, closest, sample, sideways)
            model = None if allowed.model is None else _with_fixture(state, allowed.model, now_ns)
            materials = state.fields.due(estimator, now_ns)
        except Exception as error:
            failures.stop_learning("its learning in space", error)
            model = None
    desired, desired_along = state.last.update(course, allowed.desired_position, free=closest.along < inner.free)
    space = _space(state, sample, closest, force, desired, now_ns)
    telemetry = msgspec.structs.replace(allowed.telemetry, desired_position=desired_along)
    return state, Outputs(desired, telemetry, model, space, materials)


def _way(state: State, sample: SpatialSample, sideways: Vector) -> Way:
    """Inputs of the course, from this tick's sensors and the decisions of the tick before."""
    inner, fastest = state.inner, state.largest_speed
    if inner.first_touch.guarded:
        fastest = state.approach_speed
    if state.line.closest is not None:
        fastest = state.way_in.along_speed(inner, state.line.closest, state.last.going, fastest)
    return Way(
        inner.safety.status < Status.HOLDING,
        sample.place,
        sideways,
        inner.learner.sample.force,
        state.last.slide(fastest),
        inner.safety.fastest,
    )


def _believe(state: State, belief: FixtureBelief, now_ns: int) -> None:
    known = state.belief
    if belief.run != state.inner.run or (belief.epoch, belief.sequence) <= (known.epoch, known.sequence):
        return  # it is late, or of another process
    before = state.line.offset
    if state.line.believe(belief.pose):
        if belief.contacts == known.contacts:
            # The image shows that the fixture is elsewhere: so is the surface that was felt. A touch shows where it was
            # all the time.
            state.inner.learner.conditioner.shift(state.line.offset - before)
        state.course.line.believe(belief.pose)
        state.last.believe(belief.pose, state.line.offset)
    state.way_in.believe(belief)
    state.belief, state.believed_ns = belief, now_ns


def _with_position(command: Command) -> Command:
    """A command whose position says only whether it has a place: the course says where that is on the normal."""
    position = command.place
    known = len(position) == 3 and all(map(math.isfinite, position))
    return msgspec.structs.replace(command, position=max(map(abs, position)) if known else math.nan)


def _learn_beside_the_law(state: State, closest: ClosestPoint, sample: SpatialSample, sideways: Vector) -> None:
    """The sensor's offset in free air; in contact friction, and where the contact began."""
    inner, point = state.inner, closest.inner_point
    learnt_from, moved = inner.learner.sample, subtract(point, state.point)
    state.point = point
    if not learnt_from.in_contact:
        if state.touch.leave():
            inner.learner.conditioner.distrust_surface()
        state.free_ticks += 1
        _miss_surface(state)
        still = not norm(subtract(sample.force, state.bias)) > QUIET or state.bias_ticks < SETTLING
        if state.free_ticks > 0 and still and norm(sample.force) < inner.specification.largest_offset:
            state.bias_ticks += 1
            rate = max(1.0 / state.bias_ticks, BIAS_RATE)
            state.bias = add(state.bias, scaled(subtract(sample.force, state.bias), rate))
        return
    state.free_ticks = -AFTER_CONTACT
    if math.isfinite(moved[0] + sideways[0] + sideways[1] + sideways[2]):
        pressed, rubbed, sliding = state.smoothed
        speed = state.line.motion.rotate(scaled(moved, 1.0 / SAMPLE_PERIOD))
        pressed += SMOOTHED * (learnt_from.force - pressed)
        rubbed = add(rubbed, scaled(subtract(sideways, rubbed), SMOOTHED))
        sliding = add(sliding, scaled(subtract(speed, sliding), SMOOTHED))
        state.smoothed = pressed, rubbed, sliding
        if norm(sliding) > SLIDING:
            state.friction.update(pressed, rubbed, sliding, SAMPLE_PERIOD)
    state.touch.feel(learnt_from.force, sample.place, closest, inner.tick)


def _miss_surface(state: State) -> None:
    """Detect a missed surface: the robot is deeper than where it was felt, and feels nothing for a while."""
    inner, depth = state.inner, state.inner.learner.sample.depth
    state.missed_ticks = state.missed_ticks + 1 if depth > MISSED and inner.watch.state is SensorState.GOOD else 0
    if state.missed_ticks >= MISSED_TICKS:
        inner.learner.conditioner.shift(depth)
        state.missed_ticks = 0


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
        *state.touch.place,
        state.touch.tick,
        inner.run,
    )
