"""The robot's probe over a surface, with three degrees of freedom."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.identification import ContactMap, Estimator, FrictionEstimator, Learner, MaterialFieldLearner
from foretouch.identification.conditioning.kernel import Memory as Conditioner
from foretouch.identification.contact_map.kernel import Learning
from foretouch.identification.friction import Friction, learn_friction
from foretouch.messages import VERSION, Command, FixtureBelief, FollowerSpace, ModelUpdate
from foretouch.quantities import pose as rigid
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Numbers3, Triangle, add, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.god_object import MESH, Mesh
from foretouch.rendering.surfaces.line import Closest, rotate
from foretouch.robot import RobotSample, SpatialSample
from foretouch.session.network.model_sender import FieldSender
from foretouch.session.network.playout import NOWHERE, Playing
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import SurfaceLine, go
from foretouch.session.spatial.safety import VECTOR, Records, Space, SpatialSafety, arrive, limit
from foretouch.session.spatial.way_in import MISSED, MISSED_TICKS
from foretouch.session.steps.axis import Finished, Measured, ProbeOnAxis
from foretouch.session.steps.follower import GOOD, Inputs, State
from foretouch.session.steps.tick import LEARNT, OF_FIELD, OF_MAP, WANTED, Done, Follower, Times, Wanted, act

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


@kernel(f"i8(Beside[::1], Space[::1], Learning[::1], {VECTOR}, b1, i8)", Space, Learning)
def learn_beside(besides: Records, spaces: Records, learnings: Records, force: Vector, good: bool, tick: int) -> int:
    """In free air the sensor's offset; in contact friction, and where the contact began.

    The law was learnt from the newest sample of the learner; the whole force is as measured [N]. Returns what is news.
    """
    beside, line, course, newest = besides[0], spaces[0].probe, spaces[0].course, learnings[0].newest[0]
    point, sideways = vector(line.closest.inner_point), vector(course.resistance)
    moved = subtract(point, vector(beside.point))
    write(beside.point, point)
    if not newest.in_contact:
        return _in_free_air(beside, force, newest.depth > MISSED and good)
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
    return TOLD if beside.touch.tick != before else 0


Own = tuple[Records, Records, Records, Mesh]
"""Records of safety in space, of what is learnt beside, of the playout; and the shape of the surface."""

Said = tuple[float, float, float, float, float, float, float, float, float, float]
"""Position for the robot [m], force on the probe [N], normal and depth [m] of its closest point: of each axis."""

_arrive, _limit, _learn_beside = arrive.function, limit.function, learn_beside.function


@compiled
def tick(
    followers: Records,
    banks: Records | None,
    fields: Records | None,
    conditioner: Conditioner,
    learnings: Records,
    own: Own,
    seen: tuple[Vector, Vector, int],
    asked: tuple[Times, Wanted],
) -> tuple[Done, float, bool, int, Said]:
    """A tick in space, with place and force of the probe and the tick's number, as `act` is one along the normal.

    Returns:
        What `act` does, with the robot's coordinate; that of the probe [m]; whether it went on though the probe did not
        move; what `learn_beside` returns; and what there is to say.
    """
    (spaces, besides, playings, mesh), (place, force, number), (times_ns, wanted) = own, seen, asked
    space, line, bias = spaces[0], spaces[0].probe, vector(besides[0].bias)
    felt, jumped = _arrive(spaces, followers, conditioner, learnings, mesh, (place, force, bias))
    along, point, position = line.closest.along, vector(line.closest.inner_point), wanted[0]
    if fields is not None and math.isfinite(point[0] + point[1] + point[2]):
        write(fields[0].point, point)
    if not math.isnan(position):
        position = go(space.course, mesh, vector(playings[0].place))
    sample = along, felt, 0.0, math.nan, math.nan, along, False, math.nan
    (aim, status), validity, shown, learnt = act(
        followers, banks, fields, conditioner, learnings, sample, times_ns, (position, wanted[1], wanted[2])
    )
    news = _learn_beside(besides, spaces, learnings, force, validity == GOOD, number)
    told, coordinate = _limit(spaces, followers[0].safety, mesh, aim)
    said = (*told, *subtract(force, bias), *vector(line.closest.normal), line.closest.depth)
    return ((coordinate, status), validity, shown, learnt), along, jumped, news, said


IN_SPACE = f"""Tuple((Space[::1], Beside[::1], Playing[::1], {MESH})), Tuple(({VECTOR}, {VECTOR}, i8)),
    Tuple(({WANTED}))"""
tick_with_map = Kernel(tick, f"({OF_MAP}, {IN_SPACE})", *LEARNT, Follower, Playing, Triangle)
tick_with_field = Kernel(tick, f"({OF_FIELD}, {IN_SPACE})", *LEARNT, Follower, Playing, Triangle)
WHOLE: dict[type[Estimator], Kernel[..., Any]] = {ContactMap: tick_with_map, MaterialFieldLearner: tick_with_field}


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
        touch: Onset of the newest contact that tells of the surface [m]; NaN before it.
        touch_tick: Tick in which that was known.
        belief: Newest belief of the fixture's pose, as its tracker sent it.
    """

    safety: SpatialSafety
    fields: FieldSender
    whole = WHOLE

    def __init__(self, surface: Surface, pose: tuple[float, ...]) -> None:
        self._surface, self._pose = surface, pose
        self.besides, self._beside = Beside.new(), learn_beside.entry
        self.friction = FrictionEstimator(self.besides["friction"])
        self.touch: Vector = NOWHERE
        self.touch_tick = 0
        self.belief, self._believed_ns = NO_BELIEF, 0  # it ages while no other comes
        self._news, self._said = 0, (0.0,) * 10  # see `tick`

    @property
    def line(self) -> SurfaceLine:
        """Line of the probe."""
        return self.safety.line

    @property
    def bias(self) -> Vector:
        """The force sensor's offset [N]."""
        x, y, z = self.besides["bias"][0].tolist()
        return x, y, z

    def join(self, state: State, settings: SessionSettings) -> None:
        """See `ProbeOnAxis.join`."""
        self.safety = SpatialSafety(state.safety, self._surface, self._pose, SAMPLE_PERIOD)
        self.fields = FieldSender(state.run)
        self.besides["largest_offset"] = state.specification.largest_offset
        if self.safety.python:
            self.whole = {}

    def hear(self, state: State, inputs: Inputs, now_ns: int) -> None:
        """See `ProbeOnAxis.hear`."""
        try:
            for belief in inputs.beliefs:
                self._believe(state, belief, now_ns)
        except Exception as error:
            state.failures.note("what it believes of the fixture", error)

    def at_once(
        self, tick: Callable[..., Any], states: Any, state: State, inputs: Inputs, asked: Any
    ) -> tuple[Done, Measured]:
        """See `ProbeOnAxis.at_once`."""
        sample, safety = inputs.sample, self.safety
        own, exact = (
            (safety.spaces, self.besides, state.playout.playings, safety.line.shape),
            rigid.norm(sample.exact_force),
        )
        seen = (*sample.place,), (*sample.force,), state.tick + 1  # a driver may give a list
        done, along, jumped, self._news, self._said = tick(*states, own, seen, asked)
        if jumped:
            state.learner.conditioner.recall()
        return done, (along, exact, sample.clipped)

    def arrive(self, state: State, inputs: Inputs) -> RobotSample:
        """See `ProbeOnAxis.arrive`."""
        sample, failures, learner = inputs.sample, state.failures, state.learner
        (x, y, z), force, bias, conditioner = sample.place, sample.force, self.bias, learner.conditioner
        self._force = rigid.subtract(force, bias)
        felt, jumped = self.safety.arrive(state.memory, conditioner.memory, learner.learning, ((x, y, z), force, bias))
        if jumped:
            conditioner.recall()
        closest = self.line.newest
        if failures.learns and isinstance(learner.estimator, MaterialFieldLearner):
            try:
                learner.estimator.touch_at(closest.inner_point)
            except Exception as error:
                failures.stop_learning("its learning in space", error)
        along, exact = closest.along, rigid.norm(sample.exact_force)
        return RobotSample(along, felt, 0.0, exact, math.nan, along, sample.clipped)

    def go(self, state: State, position: float) -> float:
        """See `ProbeOnAxis.go`; the course goes to the place that is played."""
        return position if math.isnan(position) else self.safety.go(state.playout.place)

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
        self.safety.spaces["seen"] = math.isfinite(belief.image_age)

    def wanted(self, command: Command) -> float:
        """See `ProbeOnAxis.wanted`; it says only whether there is a place: the course says where on the normal."""
        x, y, z = command.place if len(command.place) == 3 else NOWHERE
        known = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
        return max(abs(x), abs(y), abs(z)) if known else math.nan

    def limit(self, state: State, inputs: Inputs, aim: float) -> float:
        """See `ProbeOnAxis.limit`; along the normal and in all directions within the limits."""
        self._news, good, (x, y, z) = 0, state.watch.state is GOOD, inputs.sample.force
        if state.failures.learns:
            learnings = state.learner.learning
            self._news = self._beside(self.besides, self.safety.spaces, learnings, (x, y, z), good, state.tick + 1)
        desired, along = self.safety.limit(aim)
        closest = self.line.newest
        self._said = *desired, *self._force, *closest.normal, closest.depth
        return along

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """See `ProbeOnAxis.finish`."""
        field = None
        if state.failures.learns:
            try:
                if self._news:
                    self._learn(state.learner, state.tick)
                model = None if model is None else self._with_fixture(model, now_ns)
                field = self.fields.due(state.learner.estimator, now_ns)
            except Exception as error:
                state.failures.stop_learning("its learning in space", error)
                model = None
        x, y, z, *_ = self._said
        return (x, y, z), self._report(inputs.sample), model, field

    def _learn(self, learner: Learner, tick: int) -> None:
        """Take over what is news of a contact, or of a missed surface."""
        news = self._news
        if news & LEFT:
            learner.conditioner.distrust_surface()
        if news & MISSED_IT:
            learner.conditioner.shift(learner.sample.depth)
        if news & TOLD:
            x, y, z = self.besides["touch"]["place"][0].tolist()
            self.touch, self.touch_tick = (x, y, z), tick

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
        fixture = sample.fixture if len(sample.fixture) == 6 else (*NOWHERE, *NOWHERE)
        return FollowerSpace(*sample.place, *self._said, *self.line.pose, *fixture, *self.touch, self.touch_tick)

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
