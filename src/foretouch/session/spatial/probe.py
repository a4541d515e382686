"""The robot's probe over a surface, with three degrees of freedom."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from foretouch.core import Record, compiled, kernel
from foretouch.identification import FrictionEstimator, MaterialFieldLearner
from foretouch.identification.contact_map.kernel import Learning
from foretouch.identification.friction import Friction, learn_friction
from foretouch.messages import VERSION, Command, FixtureBelief, FollowerSpace, ModelUpdate
from foretouch.quantities import pose as rigid
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Numbers3, add, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.line import Closest, rotate
from foretouch.robot import RobotSample, SpatialSample
from foretouch.session.network.model_sender import FieldSender
from foretouch.session.network.playout import NOWHERE, Playout
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import SurfaceLine
from foretouch.session.spatial.safety import VECTOR, Records, Space, SpatialSafety
from foretouch.session.spatial.way_in import MISSED, MISSED_TICKS
from foretouch.session.steps.axis import Finished, ProbeOnAxis
from foretouch.session.steps.follower import GOOD, HOLDING, Inputs, State

BIAS_RATE = 2e-4  # Weight per tick of the measured force in the sensor's offset in free air, once it is known from 5 s

QUIET, SETTLING = 0.3, 50
"""Largest deviation from the offset in free air [N], and number of ticks after which the offset is known."""

AFTER_CONTACT = 500
"""Ticks after a contact before free air begins: a probe that leaves slowly still feels a little below the threshold."""

SLIDING = 0.01
"""Speed below which the direction of sliding is unknown [m/s]: the encoders' noise turns it, and friction seems to be
less."""

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


@kernel(f"Tuple((i8, {VECTOR}))(Beside[::1], Space[::1], Learning[::1], {VECTOR}, b1, i8)", Space, Learning)
def learn_beside(
    besides: Records, spaces: Records, learnings: Records, force: Vector, good: bool, tick: int
) -> tuple[int, Vector]:
    """In free air the sensor's offset; in contact friction, and where the contact began.

    The law was learnt from the newest sample of the learner; the whole force is as measured [N]. Returns what is news,
    and the offset [N].
    """
    beside, line, course, newest = besides[0], spaces[0].probe, spaces[0].course, learnings[0].newest[0]
    point, sideways = vector(line.closest.inner_point), vector(course.resistance)
    moved = subtract(point, vector(beside.point))
    write(beside.point, point)
    if not newest.in_contact:
        return _in_free_air(beside, force, newest.depth > MISSED and good), vector(beside.bias)
    beside.free_ticks = -AFTER_CONTACT
    if math.isfinite(moved[0] + sideways[0] + sideways[1] + sideways[2]):
        rubbed, sliding = vector(beside.rubbed), vector(beside.sliding)
        speed = rotate(line, scaled(moved, 1.0 / SAMPLE_PERIOD))
        beside.pressed += SMOOTHED * (newest.force - beside.pressed)
        rubbed = add(rubbed, scaled(subtract(sideways, rubbed), SMOOTHED))
        sliding = add(sliding, scaled(subtract(speed, sliding), SMOOTHED))
        write(beside.rubbed, rubbed)
        write(beside.sliding, sliding)
        if norm(sliding) > SLIDING:
            learn_friction(beside.friction, beside.pressed, rubbed, sliding, SAMPLE_PERIOD)
    before = beside.touch.tick
    _feel(beside.touch, newest.force, line.closest, vector(course.here), tick)
    return (TOLD if beside.touch.tick != before else 0), vector(beside.bias)


NO_BELIEF = FixtureBelief(VERSION, 0, 0, (0.0,) * 6, (), math.inf, 0, 0, 0, "", epoch=0)
"""Belief before the first: no image has shown the fixture, and its error is unknown."""


class ProbeInSpace(ProbeOnAxis):
    """A probe with three degrees of freedom over a surface on a fixture.

    Commands, the probe and its force are projected onto the normal of the believed surface, and the allowed position is
    brought back into space.

    Args:
        surface: Surface that is touched, in the fixture's frame.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].

    Attributes:
        safety: Safety in space, with the lines of probe and commands.
        friction: Of the surface.
        bias: The force sensor's offset [N].
        touch: Onset of the newest contact that tells of the surface [m]; NaN before it.
        touch_tick: Tick in which that was known.
        belief: Newest belief of the fixture's pose, as its tracker sent it.
    """

    safety: SpatialSafety
    fields: FieldSender

    def __init__(self, surface: Surface, pose: tuple[float, ...]) -> None:
        self._surface, self._pose = surface, pose
        self.besides, self._beside = Beside.new(), learn_beside.entry
        self.friction = FrictionEstimator(self.besides["friction"])
        self.bias: Vector = (0.0, 0.0, 0.0)
        self.touch: Vector = NOWHERE
        self.touch_tick = 0
        self.belief, self._believed_ns = NO_BELIEF, 0  # it ages while no other comes
        self._shown: tuple[Any, float] = None, math.nan  # what the sensor showed, and its part along the normal [N]
        self._force = self._desired = self.bias

    @property
    def line(self) -> SurfaceLine:
        """Line of the probe."""
        return self.safety.line

    def join(self, state: State, settings: SessionSettings) -> None:
        """See `ProbeOnAxis.join`."""
        self.safety = SpatialSafety(state.safety, self._surface, self._pose, SAMPLE_PERIOD)
        self.fields, self._speeds = FieldSender(state.run), (settings.largest_speed, settings.approach_speed)
        self.besides["largest_offset"] = state.specification.largest_offset
        state.playout = Playout(self.safety.go)

    def arrive(self, state: State, inputs: Inputs, now_ns: int) -> RobotSample:
        """See `ProbeOnAxis.arrive`."""
        sample, safety, failures, learner = inputs.sample, self.safety, state.failures, state.learner
        try:
            for belief in inputs.beliefs:
                self._believe(state, belief, now_ns)
        except Exception as error:
            failures.note("what it believes of the fixture", error)
        force = self._force = rigid.subtract(sample.force, self.bias)
        told = (
            learner.conditioner.surface,
            self._speeds[state.first_touch.guarded],
            state.watch.state is GOOD,
            math.isfinite(self.belief.image_age),
            state.safety.status < HOLDING,
        )
        felt, self.free, self.slid, jump = safety.arrive(learner.learning, sample.place, force, told)
        closest = self._closest = safety.line.newest
        if jump:
            learner.conditioner.shift(jump)
        if failures.learns and isinstance(learner.estimator, MaterialFieldLearner):
            try:
                learner.estimator.touch_at(closest.inner_point)
            except Exception as error:
                failures.stop_learning("its learning in space", error)
        if sample.force == self._shown[0]:  # a sensor that hangs is to seem so along any normal
            felt = self._shown[1]
        self._shown = sample.force, felt
        along, exact = closest.along, rigid.norm(sample.exact_force)
        return RobotSample(along, felt, 0.0, exact, math.nan, along, sample.clipped)

    def _believe(self, state: State, belief: FixtureBelief, now_ns: int) -> None:
        known = self.belief
        if belief.run != state.run or (belief.epoch, belief.sequence) <= (known.epoch, known.sequence):
            return  # it is late, or of another process
        before = self.line.offset
        if self.safety.believe(belief) and belief.contacts == known.contacts:
            # The image shows that the fixture is elsewhere: so is the surface that was felt. A touch shows where it was
            # all the time.
            state.learner.conditioner.shift(self.line.offset - before)
        self.belief, self._believed_ns = belief, now_ns

    def wanted(self, command: Command) -> float:
        """See `ProbeOnAxis.wanted`; it says only whether there is a place: the course says where on the normal."""
        x, y, z = command.place if len(command.place) == 3 else NOWHERE
        known = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
        return max(abs(x), abs(y), abs(z)) if known else math.nan

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """See `ProbeOnAxis.finish`; along the normal and in all directions within the limits."""
        field = None
        if state.failures.learns:
            try:
                model = self._learn(state, inputs.sample.force, model, now_ns)
                field = self.fields.due(state.learner.estimator, now_ns)
            except Exception as error:
                state.failures.stop_learning("its learning in space", error)
                model = None
        self._desired, along = self.safety.limit(coordinate)
        return self._desired, along, self._report(inputs.sample), model, field

    def _learn(self, state: State, force: Vector, model: ModelUpdate | None, now_ns: int) -> ModelUpdate | None:
        """Offset of the sensor, friction, onset of a contact, a missed surface; returns the model with its fixture."""
        learner, good, (x, y, z) = state.learner, state.watch.state is GOOD, force
        spaces, tick = self.safety.spaces, state.tick
        news, self.bias = self._beside(self.besides, spaces, learner.learning, (x, y, z), good, tick)
        if news & LEFT:
            learner.conditioner.distrust_surface()
        if news & MISSED_IT:
            learner.conditioner.shift(learner.sample.depth)
        if news & TOLD:
            x, y, z = self.besides["touch"]["place"][0].tolist()
            self.touch, self.touch_tick = (x, y, z), tick
        return None if model is None else self._with_fixture(model, now_ns)

    def _with_fixture(self, model: ModelUpdate, now_ns: int) -> ModelUpdate:
        """A model with the fixture that it belongs to: its surface is how much deeper than believed it was felt."""
        friction = self.friction
        return msgspec.structs.replace(
            model,
            surface=model.surface - self.line.offset if model.valid else 0.0,
            fixture=self.line.pose,
            fixture_deviation=self.belief.deviation,
            fixture_age=self.belief.image_age + (now_ns - self._believed_ns) * 1e-9,
            friction=(friction.coefficient, friction.viscous, *friction.deviations) if friction.known else (),
        )

    def _report(self, sample: SpatialSample) -> FollowerSpace:
        """What there is to tell in space in this tick."""
        closest, fixture = self._closest, sample.fixture
        x, y, z, rx, ry, rz = fixture if len(fixture) == 6 else (*NOWHERE, *NOWHERE)
        told = (*sample.place, *self._desired, *self._force, *closest.normal, closest.depth, *self.line.pose)
        return FollowerSpace(*told, x, y, z, rx, ry, rz, *self.touch, self.touch_tick)

    def tip(self, state: State, sample: SpatialSample) -> Vector:
        """See `ProbeOnAxis.tip`."""
        return sample.place

    def back_off(self, state: State, sample: SpatialSample, position: Vector, way: float) -> Vector:
        """See `ProbeOnAxis.back_off`; whatever is believed of the fixture."""
        force = rigid.subtract(sample.force, self.bias)
        size = rigid.norm(force)
        if 0.0 < size < math.inf:
            state.feel_plainly(size)
            position = rigid.add(position, rigid.scaled(force, way / size))
            self.safety.begin(position)
        return position
