"""The operator's hand over a surface, with three degrees of freedom.

It is projected onto the normal of the believed surface, which moves with the fixture, and the law is that at the hand's
place, from the newest field of materials.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from foretouch.errors import DecodeError, InputError
from foretouch.messages import FieldUpdate, LeaderSpace, Message, ModelUpdate, Telemetry
from foretouch.models import FIELD_DEPTH, NO_STATE, ContactModel, MaterialField
from foretouch.quantities.pose import Vector, norm, subtract
from foretouch.rendering import Renderer
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.whole import NEAR, Now, whole_over_surface
from foretouch.session.spatial.course import SurfaceLine
from foretouch.session.steps.axis import Arrived, HandOnAxis, Told
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.session.steps.leader import Inputs

NOWHERE = (math.nan, math.nan, math.nan)

MOST_FRICTION, MOST_VISCOUS = 2.0, 20.0
"""Largest coefficients of friction that are rendered, whatever a follower sends [-, N s/m]."""


class TouchedMaterial:
    r"""The surface's material as a field over the surface, as the leader knows it.

    A field gives the standard deviation of the local stiffness K at 2 mm. The force there has the same relative
    standard deviation,

    .. math:: \sigma_F = F\, \sigma_K / K

    Attributes:
        field: The newest, None before the first.
        at: Where it was looked up last, in the fixture's frame [m]; NaN where there may be news.
        uncertainty: sigma_K / K as it was looked up last; NaN before the first.
        refused: Number of fields that could not be used.
    """

    __slots__ = ("_is_known_here", "_run", "_sequence", "at", "field", "refused", "uncertainty")

    def __init__(self) -> None:
        self.field: MaterialField | None = None
        self._sequence = self._run = 0
        self._is_known_here = False
        self.at: Vector = NOWHERE
        self.uncertainty = math.nan
        self.refused = 0

    def take(self, update: FieldUpdate) -> None:
        """Take a field, unless a newer one of the same follower process is already there."""
        if update.run == self._run and update.sequence <= self._sequence:
            return
        self._sequence, self._run = update.sequence, update.run
        try:
            self.field = MaterialField.from_bytes(update.content)
        except (InputError, DecodeError):
            self.refused += 1
        else:
            if not self._is_known_here:
                self.at = NOWHERE

    def law(self, point: Vector, depth: float) -> ContactModel | None:
        """The law at a point, in the fixture's frame, for a hand at this depth [m]; None where unknown."""
        if self.field is None or depth < -NEAR:
            return None
        law, deviation, self._is_known_here = self.field.law_at(point)
        stiffness = law.stiffness + 2.0 * FIELD_DEPTH * law.stiffening
        self.uncertainty = deviation / stiffness if stiffness > 0.0 else math.nan
        self.at = point
        return law if self._is_known_here else None


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
        place: Position of the hand in the world [m].
        left: Commanded position of the follower [m].
        material: The field of materials.
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
        self._looks_up = True  # whether the material is to be looked up
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
            self.material.take(message)
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
        if len(model.friction) >= 2 and all(0.0 <= value < math.inf for value in model.friction[:2]):
            renderer.rub(min(model.friction[0], MOST_FRICTION), min(model.friction[1], MOST_VISCOUS))
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
        places, position = (self.place, exact, intended, self.apart, self.material.at), (x, y, z)
        field = self.material.field is not None, self._offset
        over = line.records, line.shape, position, places, scale, (seen, somewhere), field
        coordinates, self._looks_up, rendered = renderer.go_over(over, now)
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

    def law(self) -> ContactModel | None:
        """See `HandOnAxis.law`; from the field."""
        self._offset = self.line.offset
        closest = self.line.newest
        return self.material.law(closest.inner_point, closest.depth)

    def go_on(self, renderer: Renderer) -> None:
        """See `HandOnAxis.go_on`; the hand may have moved over the surface, or come to another side of it."""
        predictor, before, offset = renderer.predictor, self._offset, self.line.offset
        self._offset = offset
        turned = before != offset
        if predictor.model is None or not (turned or self._looks_up):
            return
        law = self.law() or predictor.model
        if turned or law is not predictor.model:
            memory = predictor.state if law is predictor.model else NO_STATE
            renderer.adopt(law, offset + self.felt_deeper, memory, message=predictor.message)

    def finish(self, renderer: Renderer) -> Told:
        """See `HandOnAxis.finish`; the deviation is the field's, where there is one."""
        (_, force, _, deviation), place = renderer.predicted, renderer.touched[0]
        known = math.isfinite(renderer.shown[0])
        if known:
            self.left = place
        uncertainty = self.material.uncertainty
        deviation = deviation if math.isnan(uncertainty) else uncertainty * force
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
        )
