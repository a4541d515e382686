"""The robot's probe over a surface, with three degrees of freedom."""

from __future__ import annotations

import math
from typing import Any, Protocol

import msgspec
import numpy as np

from foretouch.core import Kernel, compiled
from foretouch.identification import ContactMap, FrictionEstimator, ScaleFieldLearner
from foretouch.identification.friction import learn_friction, let_go
from foretouch.messages import MOST_JOINTS, VERSION, Command, FixtureBelief, FollowerSpace, ModelUpdate
from foretouch.quantities import pose as rigid
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Triangle, add, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.god_object import MESH, Mesh
from foretouch.rendering.surfaces.line import Closest, just_touching_within, rotate
from foretouch.robot import SpatialSample
from foretouch.session.network.model_sender import FieldSender
from foretouch.session.network.playout import NOWHERE, advance
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.course import SurfaceLine, go
from foretouch.session.spatial.proven_places import SAME_HEIGHT
from foretouch.session.spatial.safety import VECTOR, Beside, FeltSurface, Space, SpatialSafety, arrive, limit
from foretouch.session.spatial.way_in import MISSED, MISSED_TICKS
from foretouch.session.steps import tick as stages
from foretouch.session.steps.axis import Finished, ProbeOnAxis
from foretouch.session.steps.follower import GOOD, Inputs, State
from foretouch.session.steps.tick import Acted, Records, States, Times

BIAS_RATE = 2e-4  # Weight per tick of the measured force in the sensor's offset in free air, once it is known from 5 s

QUIET, SETTLING = 0.3, 50
"""Largest deviation from the offset in free air [N], and number of ticks after which the offset is known."""

AFTER_CONTACT = 500
"""Ticks after a contact before free air begins: a probe that leaves slowly still feels a little below the threshold."""

LATEST = 2e-3  # Depth at which a contact may have been noticed at most [m]; one noticed deeper tells no surface

FELT_WAY, TOUCH_EXPONENT = 1e-3, 1.15
"""The surface is known from how the force grows over this way [m], with this exponent of depth."""


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


@compiled(error_model="numpy")
def _in_free_air(beside: Beside, states: States, force: Vector) -> bool:
    """Learn the sensor's offset. A robot that is deeper than where it was felt and feels nothing has missed it."""
    follower, state, newest = states[0][0], states[1][0][0], states[2][0].newest[0]
    deeper = newest.depth > MISSED and follower.watch[0].state == GOOD
    if beside.touch.ticks > 0:  # the surface is found anew where the next contact begins: the probe goes elsewhere
        beside.touch.ticks, state.surface_threshold = 0, 0.0
    beside.free_ticks += 1
    beside.missed_ticks = beside.missed_ticks + 1 if deeper else 0
    missed = beside.missed_ticks >= MISSED_TICKS
    if missed:
        beside.missed_ticks = 0
    away = subtract(force, vector(beside.bias))
    still = not norm(away) > QUIET or beside.bias_ticks < SETTLING
    if beside.free_ticks > 0 and still and norm(force) < follower.largest_offset:
        beside.bias_ticks += 1
        rate = max(1.0 / beside.bias_ticks, BIAS_RATE)
        write(beside.bias, add(vector(beside.bias), scaled(away, rate)))
    return bool(missed)


@compiled
def learn_beside(space: Space, states: States, force: Vector, tick: int) -> bool:
    """In free air the sensor's offset; in contact friction, and where the contact began.

    The law was learnt from the newest sample of the learner; the whole force is as measured [N]. Returns whether the
    surface was missed.
    """
    beside, line, course, newest = space.beside, space.probe, space.course, states[2][0].newest[0]
    point, sideways = just_touching_within(line), vector(course.resistance)
    moved = subtract(point, vector(beside.point))
    write(beside.point, point)
    if not newest.in_contact:
        let_go(beside.friction)
        return _in_free_air(beside, states, force)
    beside.free_ticks = -AFTER_CONTACT
    if math.isfinite(moved[0] + sideways[0] + sideways[1] + sideways[2]):
        sliding = rotate(line, scaled(moved, 1.0 / SAMPLE_PERIOD))
        learn_friction(beside.friction, newest.force, sideways, sliding, SAMPLE_PERIOD)
    _feel(beside.touch, newest.force, line.closest, vector(course.here), tick)
    return False


Given = tuple[Records, Mesh, Vector, Vector, int]
"""The record of safety in space; the shape of the surface; place of the probe [m], force that its sensor shows [N], and
number of the tick."""

Told = tuple[bool, tuple[float, float, float, float, float, float, float, float, float, float], Vector, int]
"""Whether the surface was missed; position for the robot [m], force on the probe [N], normal of its closest point, and
depth [m]; onset of the newest contact that tells of the surface [m], NaN before it, and the tick when it was known."""


_advance = advance.function


@compiled
def sense_in_space(states: States, given: Given, now_ns: int, position: float) -> tuple[float, bool]:
    """`stages.sense` along the normal; and the course, unless there is no position to be played (NaN).

    Returns:
        The coordinate that is wanted [m], and whether that of the probe went on though it did not move.
    """
    (spaces, mesh, place, raw, _), followers = given, states[0]
    space = spaces[0]
    felt, jumped = arrive(space, states, mesh, place, raw, subtract(raw, vector(space.beside.bias)))
    if not math.isnan(position):
        position = go(space.course, mesh, vector(followers[0].playing[0].place))
    along = float(space.probe.closest.along)
    stages.sense(states, (along, felt, 0.0, math.nan, math.nan, along, False, math.nan), now_ns)
    return position, jumped


@compiled
def allow_in_space(
    states: States, given: Given, times_ns: Times, guarded: bool, desired: float, stopped: bool, learns: bool
) -> tuple[Acted, Told]:
    """`stages.allow` along the normal, learning beside the law, and the limits of the motion."""
    (spaces, mesh, _, raw, number), missed = given, False
    space, closest, touch = spaces[0], spaces[0].probe.closest, spaces[0].beside.touch
    aim, status = stages.allow(states, closest.along, times_ns, guarded, desired, stopped)
    force = subtract(raw, vector(space.beside.bias))
    if learns:
        missed = learn_beside(space, states, raw, number)
    place, coordinate = limit(space, states[0][0].safety[0], mesh, aim)
    said = (*place, *force, *vector(closest.normal), float(closest.depth))
    return stages.show(states, (coordinate, status)), (missed, said, vector(touch.place), int(touch.tick))


@compiled
def tick(
    states: States, banks: Records, fields: Records, given: Given, times_ns: Times, guarded: bool
) -> tuple[Acted, Told, tuple[int, bool]]:
    """A tick in space, as `stages.tick` is one along a line."""
    position = _advance(states[0][0].playing)
    desired, jumped = sense_in_space(states, given, times_ns[0], position)
    x, y, _ = vector(given[0][0].probe.closest.inner_point)
    if math.isfinite(x + y):
        fields[0].point[0], fields[0].point[1] = x, y
    done, news = stages.learn(states, banks, fields, times_ns)
    acted, told = allow_in_space(states, given, times_ns, guarded, desired, False, True)
    return acted, told, (done, news or jumped)


GIVEN = f"Tuple((Space[::1], {MESH}, {VECTOR}, {VECTOR}, i8))"
sense_alone = Kernel(sense_in_space, f"({stages.STATES}, {GIVEN}, i8, f8)", *stages.LEARNT, Triangle)
allow_alone: Kernel[..., Any] = Kernel(
    allow_in_space, f"({stages.STATES}, {GIVEN}, {stages.GUARDED}, f8, b1, b1)", *stages.LEARNT, Triangle
)
tick_at_once: Kernel[..., Any] = Kernel(
    tick, f"({stages.STATES}, Bank[::1], ScaleState[::1], {GIVEN}, {stages.GUARDED})", *stages.LEARNT, Triangle
)


NO_BELIEF = FixtureBelief(VERSION, 0, 0, (0.0,) * 6, (), math.inf, 0, 0, 0, "", epoch=0)
"""Belief before the first: no image has shown the fixture, and its error is unknown."""


KEPT_EVERY = 500  # Ticks between two copies of what is learnt: a bump is noticed sooner


class Learns(Protocol):
    """What learns, in one record."""

    states: Records

    def go_back(self, earlier: Records) -> None:
        """Forget what was learnt since a copy of `states` was taken."""


class Earlier:
    """What was learnt one to two times `KEPT_EVERY` ago, to go back to where a bump spoilt it since."""

    def __init__(self, law: ContactMap, *others: Learns) -> None:
        self._law = law
        every: tuple[Learns, ...] = law, *others
        self._learners = [(one, [one.states.copy(), one.states.copy()]) for one in every]
        self._below = [math.nan, math.nan]

    def keep(self, tick: int, below: float) -> None:
        """Copy what is learnt, if that is due; `below` is how much deeper than believed the surface was felt [m]."""
        turn = tick % KEPT_EVERY  # a tick has time for one copy
        if turn == 0:
            for _, copies in self._learners:
                copies.reverse()
            self._below.reverse()
            self._below[1] = math.nan if self._law.model is None else below
        if turn < len(self._learners):
            one, copies = self._learners[turn]
            _copy(one.states, copies[1])

    def go_back(self) -> float:
        """Forget what was learnt since the older copy; how much deeper the surface was then felt [m], NaN for none."""
        if not math.isnan(self._below[0]):
            for one, (older, newer) in self._learners:
                one.go_back(older)
                _copy(older, newer)
            self._below[1] = self._below[0]
        return self._below[0]


def _copy(states: Records, kept: Records) -> None:
    kept.view(np.uint8)[:] = states.view(np.uint8)  # quicker than field by field


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
        belief: Newest belief of the fixture's pose, as its tracker sent it.
    """

    safety: SpatialSafety
    fields: FieldSender
    told: Told
    places: ScaleFieldLearner
    alone = sense_alone, allow_alone
    whole: Kernel[..., Any] | None = tick_at_once

    def __init__(self, surface: Surface, pose: tuple[float, ...]) -> None:
        self._surface, self._pose = surface, pose
        self.places = ScaleFieldLearner()
        self.belief, self._believed_ns = NO_BELIEF, 0  # it ages while no other comes

    @property
    def line(self) -> SurfaceLine:
        """Line of the probe."""
        return self.safety.line

    @property
    def learners(self) -> tuple[Learns, ...]:
        """What learns beside the material's law, and goes back with it after a bump."""
        return (self.places,)

    def join(self, state: State, settings: SessionSettings) -> None:
        """See `ProbeOnAxis.join`."""
        self.safety = SpatialSafety(state.safety, self._surface, self._pose, SAMPLE_PERIOD)
        self.fields = FieldSender(state.run)
        law = state.learner.estimator
        self._earlier = Earlier(law, *self.learners) if isinstance(law, ContactMap) else None
        self.friction = FrictionEstimator(self.safety.spaces["beside"]["friction"])
        if self.safety.python:
            self.whole = None

    def hear(self, state: State, inputs: Inputs, now_ns: int) -> None:
        """See `ProbeOnAxis.hear`."""
        try:
            for belief in inputs.beliefs:
                self._believe(state, belief, now_ns)
        except Exception as error:
            state.failures.note("what it believes of the fixture", error)

    def given(self, state: State, sample: SpatialSample) -> Given:
        """See `ProbeOnAxis.given`."""
        (x, y, z), (a, b, c) = sample.place, sample.force  # a driver may give lists
        return self.safety.spaces, self.line.shape, (x, y, z), (a, b, c), state.tick + 1

    def exact_force(self, sample: SpatialSample) -> float:
        """See `ProbeOnAxis.exact_force`."""
        return rigid.norm(sample.exact_force)

    def sense(self, state: State, given: Given, now_ns: int, position: float) -> float:
        """See `ProbeOnAxis.sense`; the course goes to the place that is played."""
        failures, safety = state.failures, self.safety
        if safety.python:
            safety.touch(given[2])
        desired, _ = sense_alone.entry(state.states, given, now_ns, position)
        state.watch.taken(state.memory["validity"].item())
        if safety.python and not math.isnan(position):
            desired = safety.settle()
        if failures.learns:
            try:
                self.places.touch_at(self.line.newest.inner_point)
            except Exception as error:
                failures.stop_learning("its learning in space", error)
        return desired

    def allow(self, state: State, given: Given, *asked: Any) -> Acted:
        """See `ProbeOnAxis.allow`; along the normal and in all directions within the limits."""
        acted: Acted
        acted, self.told = allow_alone.entry(state.states, given, *asked, state.failures.learns)
        if self.safety.python and math.isfinite(acted[0][0]):
            self.safety.went(self.told[1][:3])
        return acted

    def _believe(self, state: State, belief: FixtureBelief, now_ns: int) -> None:
        known = self.belief
        if belief.run != state.run or (belief.epoch, belief.sequence) <= (known.epoch, known.sequence):
            return  # it is late, or of another process
        before = self.line.offset
        elsewhere = self.safety.believe(belief)
        moved = self.line.offset - before
        if elsewhere and belief.contacts == known.contacts and belief.images > known.images:
            # The image shows that the fixture is elsewhere: so is the surface that was felt. A touch shows where it was
            # all the time.
            conditioner = state.learner.conditioner
            if abs(moved) > SAME_HEIGHT and self._earlier is not None:  # what was felt or missed since was so for that
                anew = self._earlier.go_back() + self.line.offset - conditioner.surface
                moved = anew if math.isfinite(anew) else moved
            conditioner.shift(moved)
        self.belief, self._believed_ns = belief, now_ns
        self.safety.spaces["seen"] = math.isfinite(belief.image_age)

    def wanted(self, command: Command) -> float:
        """See `ProbeOnAxis.wanted`; it says only whether there is a place: the course says where on the normal."""
        x, y, z = command.place if len(command.place) == 3 else NOWHERE
        known = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
        return max(abs(x), abs(y), abs(z)) if known else math.nan

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """See `ProbeOnAxis.finish`."""
        field = None
        if state.failures.learns:
            try:
                if self._earlier is not None:
                    self._earlier.keep(state.tick, state.learner.conditioner.surface - self.line.offset)
                if self.told[0]:
                    state.learner.conditioner.shift(state.learner.sample.depth)
                model = None if model is None else self._with_fixture(model, now_ns)
                field = self.fields.due(self.places, now_ns)
            except Exception as error:
                state.failures.stop_learning("its learning in space", error)
                model = None
        return self.told[1][:3], self._report(inputs.sample), model, field

    def _with_fixture(self, model: ModelUpdate, now_ns: int) -> ModelUpdate:
        """A model with the fixture that it belongs to: its surface is how much deeper than believed it was felt."""
        friction = self.friction
        return msgspec.structs.replace(
            model,
            surface=model.surface - self.line.offset if model.valid else 0.0,
            fixture=self.line.pose,
            fixture_deviation=self.belief.deviation,
            fixture_age=self.belief.image_age + (now_ns - self._believed_ns) * 1e-9,
            friction=friction.numbers,
        )

    def _report(self, sample: SpatialSample) -> FollowerSpace:
        """What there is to tell in space in this tick."""
        x, y, z, rx, ry, rz = sample.fixture if len(sample.fixture) == 6 else (*NOWHERE, *NOWHERE)
        _, said, touch, tick = self.told
        joints = sample.joints if len(sample.joints) <= MOST_JOINTS else ()
        return FollowerSpace(*sample.place, *said, *self.line.pose, x, y, z, rx, ry, rz, *touch, tick, *joints)

    def tip(self, state: State, sample: SpatialSample) -> Vector:
        """See `ProbeOnAxis.tip`."""
        return sample.place

    def commanded_velocity(self, state: State) -> Vector:
        """See `ProbeOnAxis.commanded_velocity`."""
        x, y, z = self.safety.spaces["path"]["velocity"][0].tolist()
        return x, y, z

    def stand(self, state: State) -> None:
        """See `ProbeOnAxis.stand`."""
        super().stand(state)
        self.safety.spaces["course"]["begun"] = False

    def back_off(self, state: State, sample: SpatialSample, position: Vector, way: float) -> Vector:
        """See `ProbeOnAxis.back_off`; whatever is believed of the fixture."""
        force = rigid.subtract(sample.force, self.safety.spaces["beside"]["bias"][0].tolist())
        size = rigid.norm(force)
        if 0.0 < size < math.inf:
            state.feel_plainly(size)
            position = rigid.add(position, rigid.scaled(force, way / size))
            self.safety.begin(position)
        return position
