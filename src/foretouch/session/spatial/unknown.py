"""Probe and hand over a surface whose shape nobody knew: the follower learns it, and the leader hears of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec

from foretouch.errors import DecodeError
from foretouch.identification.shape_learner import AIR_DEVIATION, ShapeLearner
from foretouch.messages import FieldUpdate, Message, ModelUpdate
from foretouch.quantities.pose import Vector, scaled, subtract
from foretouch.rendering import Renderer
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.learnt import LearntSurface
from foretouch.session.spatial.hand import HandInSpace
from foretouch.session.spatial.probe import Learns, ProbeInSpace
from foretouch.session.spatial.sliding import LATE, Sliding
from foretouch.session.steps.axis import Arrived, Finished
from foretouch.session.steps.follower import GOOD, Inputs, State
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.messages import FixtureBelief
    from foretouch.rendering.whole import Now
    from foretouch.session.steps import leader

EVERY = 10  # Ticks between two measurements of a slope, or of free air

AIR_DEPTH, AIR_FORCE = 2e-3, 0.05
"""Depth in the believed surface [m] at which less than this force [N] means that nothing is there. That there is no
contact does not mean it: behind a stiff place contact is noticed late."""

HEIGHT = 2  # Index of the height in the covariance of a pose


def learnt_surface(surface: Surface) -> LearntSurface:
    """The surface that is learnt, as a point feels it."""
    bare = surface.bare
    assert isinstance(bare, LearntSurface)
    return bare


class ProbeOverUnknown(ProbeInSpace):
    """A probe over a surface that it learns: see `foretouch.identification.shape_learner.ShapeLearner`.

    What is not known of the height under the probe counts as uncertainty of the fixture's pose along its normal, so
    that first touches are as guarded as where the fixture is unknown.

    Args:
        surface: In the fixture's frame; its heights are moved.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].
    """

    def __init__(self, surface: Surface, pose: tuple[float, ...]) -> None:
        super().__init__(surface, pose)
        self._learnt, self.shape = learnt_surface(surface), ShapeLearner()
        self._touch_tick, self._height_variance = 0, 0.0  # of the pose alone [m^2]
        self._shown = 0  # number of the shape's updates that the surface has been aimed at
        self._sliding = Sliding()

    def _believe(self, state: State, belief: FixtureBelief, now_ns: int) -> None:
        super()._believe(state, belief, now_ns)
        if self.belief is belief:
            self._height_variance = float(self._covariance[HEIGHT, HEIGHT])

    @property
    def learners(self) -> tuple[Learns, ...]:
        """See `ProbeInSpace.learners`."""
        return self.places, self.shape

    @property
    def _covariance(self) -> Any:
        return self.safety.spaces["way_in"]["pose"]["covariance"][0]

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """See `ProbeOnAxis.finish`."""
        place, report, model, field = super().finish(state, inputs, coordinate, model, now_ns)
        if state.failures.learns:
            try:
                self._sliding.take(inputs.sample.place, self.told[1][3:6])
                self._learn(state)
                if field is not None:
                    field = msgspec.structs.replace(field, shape=self.shape.news())
            except Exception as error:
                state.failures.stop_learning("its learning of the shape", error)
        return place, report, model, field

    def _learn(self, state: State) -> None:
        """Learn from the newest tick, and let the surface come a step nearer to what is known of it."""
        line, shape = self.line, self.shape
        inner = line.newest.inner_point
        _, _, touch, tick = self.told
        if tick != self._touch_tick:
            self._touch_tick = tick
            normal = line.motion.rotate_back(line.newest.normal)
            shape.touch(subtract(line.motion.apply_back(touch), scaled(normal, line.surface.radius)))
        if state.tick % EVERY == 0 and state.watch.state is GOOD:
            self._feel(inner)
        if shape.updates != self._shown:
            self._shown = shape.updates
            self._learnt.field.coefficients[:] = shape.coefficients
            self._learnt.aim()
        if self._learnt.settle(inner[0], inner[1]):
            self.safety.reshape()
        if math.isfinite(inner[0] + inner[1]):
            self._covariance[HEIGHT, HEIGHT] = self._height_variance + shape.height_at(inner)[1]

    def _feel(self, inner: Vector) -> None:
        """Learn the slope where the probe slides, and in free air that the surface is no higher than the probe."""
        line, beside, sliding = self.line, self.safety.spaces["beside"][0], self._sliding
        if beside.touch.ticks > 0:
            velocity = line.motion.rotate_back(sliding.velocity)
            self.shape.slide(subtract(inner, scaled(velocity, LATE)), line.motion.rotate_back(sliding.force), velocity)
        elif line.newest.depth > AIR_DEPTH and abs(self.safety.spaces["felt"][0]) < AIR_FORCE:
            x, y, z = subtract(inner, scaled(line.motion.rotate_back(line.newest.normal), line.newest.depth))
            self.shape.touch((x, y, z), AIR_DEVIATION)


class HandOverUnknown(HandInSpace):
    """A hand over a surface whose shape comes from the follower.

    A vertex under the hand moves by `foretouch.rendering.surfaces.learnt.LARGEST_STEP` a tick at most. That changes the
    depth as a new pose of the fixture does, and the force no faster.

    Args:
        surface: In the fixture's frame; its heights are moved.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].
        scale: Motion of the proxy over that of the hand.
    """

    def __init__(self, surface: Surface, pose: tuple[float, ...], scale: float) -> None:
        super().__init__(surface, pose, scale)
        self._learnt, self._newest_shape = learnt_surface(surface), (0, 0)  # run and number of the newest news

    def take(self, message: Message, renderer: Renderer, view: FollowerView) -> None:
        """See `HandOnAxis.take`."""
        super().take(message, renderer, view)
        if type(message) is FieldUpdate and view.run in (0, message.run) and message.shape:
            run, newest = self._newest_shape
            if run == message.run and message.sequence <= newest:
                return
            try:
                self._learnt.field.take(message.shape)
            except DecodeError:
                self.material.refused += 1
                return
            self._newest_shape = message.run, message.sequence
            self._learnt.aim()

    def come_to(self, inputs: leader.Inputs, renderer: Renderer, view: FollowerView, now: Now) -> Arrived:
        """See `HandOnAxis.come_to`."""
        if self.line.closest is not None:
            x, y, _ = self.line.newest.inner_point
            if self._learnt.settle(x, y):
                self.line.follow_again()
        return super().come_to(inputs, renderer, view, now)
