"""The operator's hand over a surface, with three degrees of freedom.

It is projected onto the normal of the believed surface, which moves with the fixture, and the law is as strong as at
the hand's place.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from foretouch.errors import DecodeError
from foretouch.messages import FRICTION_NUMBERS, FieldUpdate, LeaderSpace, Message, ModelUpdate, Telemetry
from foretouch.models import ScaleField
from foretouch.quantities.pose import Vector, norm, subtract
from foretouch.rendering import Renderer
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.whole import Now, whole_over_surface
from foretouch.session.spatial.course import SurfaceLine
from foretouch.session.steps.axis import Arrived, HandOnAxis, Told
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.session.steps.leader import Inputs

NOWHERE = (math.nan, math.nan, math.nan)

MOST_FRICTION, MOST_VISCOUS = 2.0, 20.0
"""Largest coefficients of friction that are rendered, whatever a follower sends [-, N s/m]."""


class TouchedMaterial:
    """How strong the material is over the surface, as the leader knows it.

    A field belongs to the models of the same follower process, which it is relative to.

    Attributes:
        field: That of the process whose models are rendered.
        refused: Number of messages that could not be used.
    """

    __slots__ = ("_newest", "_next", "_run", "field", "refused")

    def __init__(self) -> None:
        self.field, self._run = ScaleField(), 0
        self._next = ScaleField(), 0  # the field of a process whose models are not rendered yet, and its run
        self._newest = 0, 0  # run and number of the newest message
        self.refused = 0

    def take(self, update: FieldUpdate) -> bool:
        """Take nodes, unless newer ones have come from the same process; whether those that are rendered changed."""
        if update.run == self._newest[0] and update.sequence <= self._newest[1]:
            return False
        self._newest = update.run, update.sequence
        if update.run not in (self._run, self._next[1]):
            self._next = ScaleField(), update.run
        field = self.field if update.run == self._run else self._next[0]
        try:
            field.take(update.content)
        except DecodeError:
            self.refused += 1
            return False
        return field is self.field

    def belong_to(self, run: int) -> bool:
        """Render models of the follower process of this run from now on; whether their field is another one."""
        if run == self._run:
            return False
        self.field, self._run = self._next[0] if run == self._next[1] else ScaleField(), run
        return True


class HandInSpace(HandOnAxis):
    """A hand with three degrees of freedom over a surface on a fixture.

    Hand and follower meet at the follower's commanded position, and after a clutch at the hand's last one.

    Args:
        surface: In the fixture's frame.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].
        scale: Motion of the proxy over that of the hand.

    Attributes:
        line: Follows the hand over the surface.
        apart: Offset between the hand and its position in the world [m].
        place: Position of the hand in the world [m]; it holds a sphere by its centre.
        left: Commanded position of the follower [m].
        material: How strong the material is over the surface.
        felt_deeper: How much deeper than believed the surface was felt [m].
    """

    axes = 3

    def __init__(self, surface: Surface, pose: tuple[float, ...], scale: float) -> None:
        self.line, self.scale, self.material = SurfaceLine(surface, pose), scale, TouchedMaterial()
        self.apart: Vector = (0.0, 0.0, 0.0)
        self.place = self.left = NOWHERE
        self.felt_deeper = 0.0
        self._model: ModelUpdate | None = None  # the newest
        self._certainty = math.nan, math.nan, math.inf  # of its fixture: deviations [m, rad] and age [s]
        self._follower: tuple[Vector, int] = NOWHERE, 0  # its newest commanded position, and its run
        self._offset = 0.0  # of the line, in the tick before
        whole_over_surface.entry  # noqa: B018  # asked for, it is loaded

    @property
    def offset(self) -> float:  # type: ignore[override]  # it moves
        """See `HandOnAxis`."""
        return self.line.offset

    def take(self, message: Message, renderer: Renderer, view: FollowerView) -> None:
        """See `HandOnAxis.take`."""
        if type(message) is Telemetry:
            if (space := message.space) is not None:
                self._follower = (space.desired_x, space.desired_y, space.desired_z), message.run
        elif type(message) is FieldUpdate and view.run in (0, message.run):
            if self.material.take(message):
                renderer.predictor.change_place()
        elif type(message) is ModelUpdate and view.run in (0, message.run):
            self._take_model(message, renderer)

    def _take_model(self, model: ModelUpdate, renderer: Renderer) -> None:
        """Take fixture and friction from a model."""
        newest = self._model
        if newest is not None and model.run == newest.run and model.sequence <= newest.sequence:
            return
        self._model = model
        deviation = model.fixture_deviation if len(model.fixture_deviation) == 6 else (math.nan,) * 6
        self._certainty = norm(deviation[:3]), norm(deviation[3:]), model.fixture_age
        if model.fixture:
            self.line.believe(model.fixture)
        friction = model.friction
        if len(friction) == FRICTION_NUMBERS and all(0.0 <= value < math.inf for value in friction):
            mu, viscous, _, _, stiffness, _, excess, _ = friction
            mu, excess = min(mu, MOST_FRICTION), min(excess, MOST_FRICTION)
            renderer.rub(mu, min(viscous, MOST_VISCOUS), stiffness or math.inf, excess)
        if model.valid and math.isfinite(model.surface):
            self.felt_deeper = model.surface

    def come_to(self, inputs: Inputs, renderer: Renderer, view: FollowerView, now: Now) -> Arrived:
        """See `HandOnAxis.come_to`; the follower's position for `view` is that on the normal of the meeting place.

        The tick is done at once where nothing waits for it, nor a law has to be taken from the field. The device's own
        position counts in the frame, whatever it is coupled with.
        """
        x, y, z = inputs.position  # type: ignore[misc]  # a driver may give a list
        line, scale, somewhere = self.line, self.scale, True
        here, seen = (x * scale, y * scale, z * scale), math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
        if seen and not renderer.closed_loop:
            self.place = here
        elif seen and renderer.proxy.engaged:
            self.place = subtract(here, self.apart)
        elif seen:
            somewhere = self._meet(here, renderer, view)
        line.touch(self.place if somewhere else NOWHERE)
        exact: Any = tuple(inputs.exact_position)  # type: ignore[arg-type]
        intended: Any = tuple(inputs.intended_position)  # type: ignore[arg-type]
        places, position = (self.place, exact, intended, self.apart), (x, y, z)
        scales = self.material.field.records
        over = line.records, line.shape, position, places, scale, (seen, somewhere), scales, self._offset
        coordinates, rendered = renderer.go_over(over, now)
        return coordinates, (position, line.records), rendered

    def _meet(self, here: Vector, renderer: Renderer, view: FollowerView) -> bool:
        """Set where a hand that is not coupled meets the follower, its own position being here [m]; whether it does."""
        position, (at, run) = renderer.proxy.position, self._follower
        was_left = not math.isnan(position) and math.isfinite(self.place[0])
        meet = self.place if was_left else at
        view.position = math.nan
        if not (math.isfinite(meet[0]) and (was_left or run == view.run)):
            return False
        self.apart, self.place = subtract(here, meet), meet
        view.position = self.line.follow(meet).along
        return True

    def adopt(self, model: ModelUpdate, renderer: Renderer) -> None:
        """See `HandOnAxis.adopt`."""
        self._offset = self.line.offset
        if self.material.belong_to(model.run):
            renderer.predictor.change_place()

    def go_on(self, renderer: Renderer) -> None:
        """See `HandOnAxis.go_on`; the hand may have come to another side of the surface."""
        predictor, before, offset = renderer.predictor, self._offset, self.line.offset
        self._offset = offset
        if predictor.model is not None and before != offset:
            renderer.adopt(predictor.model, offset + self.felt_deeper, predictor.state, message=predictor.message)

    def finish(self, renderer: Renderer) -> Told:
        """See `HandOnAxis.finish`."""
        (_, _, _, deviation), place = renderer.predicted, renderer.touched[0]
        known = math.isfinite(renderer.shown[0])
        if known:
            self.left = place
        return self.left if known else (), deviation, self._report(renderer)

    def _report(self, renderer: Renderer) -> LeaderSpace:
        closest = self.line.newest
        return LeaderSpace(
            *self.place,
            *self.left,
            *closest.point,
            *closest.normal,
            *renderer.force,
            closest.depth - self.felt_deeper,
            renderer.touched[1],
            *self.line.pose,
            *self._certainty,
            renderer.coefficient,
            renderer.predictor.scale,
        )
