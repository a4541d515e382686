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
from foretouch.quantities.pose import Vector, dot, norm, scaled, subtract
from foretouch.rendering import Renderer
from foretouch.rendering.surfaces import Surface
from foretouch.session.spatial.course import ClosestPoint, SurfaceLine
from foretouch.session.steps.axis import Arrived, HandOnAxis, Told
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.session.steps.leader import Inputs

FAR_FROM_LAW = 1e-3  # Displacement of the hand after which the material is looked up again [m]
NEAR = 5e-3  # Distance from the surface within which materials are taken from the field [m]

NOWHERE = (math.nan, math.nan, math.nan)

MOST_FRICTION, MOST_VISCOUS = 2.0, 20.0
"""Largest coefficients of friction that are rendered, whatever a follower sends [-, N s/m]."""

REACH = 1e-4  # Interval over which the local stiffness is given [m]


NOT_YET = ClosestPoint(-math.inf, -math.inf, (0.0, 0.0, 1.0), NOWHERE, NOWHERE)
"""Closest point before the first position."""


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

    def law(self, point: Vector, depth: float) -> ContactModel | None:
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
        self._seen = False  # whether there is a position in this tick
        self._model: ModelUpdate | None = None  # the newest
        self._follower: tuple[Vector, int] = NOWHERE, 0  # its newest commanded position, and its run
        self._offset = 0.0  # of the line, where the law was taken
        self.closest = NOT_YET

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
        if model.fixture:
            self.line.believe(model.fixture)
        if len(model.friction) >= 2 and all(0.0 <= value < math.inf for value in model.friction[:2]):
            renderer.rub(min(model.friction[0], MOST_FRICTION), min(model.friction[1], MOST_VISCOUS))
        if model.valid and math.isfinite(model.surface):
            self.felt_deeper = model.surface

    def come_to(self, inputs: Inputs, renderer: Renderer, view: FollowerView) -> Arrived:
        """See `HandOnAxis.come_to`; the follower's position for `view` is that on the normal of the meeting place.

        The device's own position counts in the frame, whatever it is coupled with.
        """
        position: Any = inputs.position
        here, proxy, place = scaled(position, self.scale), renderer.proxy, self.place
        self._seen = all(map(math.isfinite, position))
        if self._seen and not renderer.closed_loop:
            place = self.place = here
        elif self._seen and proxy.engaged:
            place = self.place = subtract(here, self.apart)
        elif self._seen:
            was_left = not math.isnan(proxy.position) and math.isfinite(place[0])
            at, run = self._follower
            meet = place if was_left else at
            view.position = math.nan
            if math.isfinite(meet[0]) and (was_left or run == view.run):
                place, self.apart, self.place = meet, subtract(here, meet), meet
                view.position = self.line.follow(meet).along
            else:
                place = NOWHERE
        closest = self.closest = self.line.follow(place)
        along = closest.along / self.scale if self._seen and math.isfinite(place[0]) else math.nan
        recorded = self._coordinate(inputs.exact_position), self._coordinate(inputs.intended_position)
        return along, *recorded, (position, closest.normal, closest.point)

    def _coordinate(self, position: Any) -> float:
        """Coordinate of a recorded position along the normal of the hand's closest point [m]."""
        if not math.isfinite(position[0]):
            return math.nan
        here = subtract(scaled(position, self.scale), self.apart)
        return (self.closest.along - dot(subtract(here, self.place), self.closest.normal)) / self.scale

    def law(self) -> ContactModel | None:
        """See `HandOnAxis.law`; from the field."""
        self._offset = self.line.offset
        return self.material.law(self.closest.inner_point, self.closest.depth)

    def go_on(self, renderer: Renderer) -> None:
        """See `HandOnAxis.go_on`; the hand may have moved over the surface, or come to another side of it."""
        predictor, turned = renderer.predictor, self._offset != self.line.offset
        self._offset = self.line.offset
        if predictor.model is None or not (turned or self.material.is_elsewhere(self.closest.inner_point)):
            return
        law = self.material.law(self.closest.inner_point, self.closest.depth) or predictor.model
        if turned or law is not predictor.model:
            memory = predictor.state if law is predictor.model else NO_STATE
            renderer.adopt(law, self.line.offset + self.felt_deeper, memory, message=predictor.message)

    def finish(self, renderer: Renderer) -> Told:
        """See `HandOnAxis.finish`; the deviation is the field's, where there is one."""
        (position, *_), (_, force, _, deviation) = renderer.shown, renderer.predicted
        known = math.isfinite(position)
        if known:
            self.left = self.closest.place_at(position)
        uncertainty = self.material.uncertainty
        deviation = deviation if math.isnan(uncertainty) else uncertainty * force
        return self.left if known else (), deviation, self._report(renderer)

    def _report(self, renderer: Renderer) -> LeaderSpace:
        model, predictor = self._model, renderer.predictor
        deviation = (
            model.fixture_deviation if model is not None and len(model.fixture_deviation) == 6 else (math.nan,) * 6
        )
        return LeaderSpace(
            *self.place,
            *self.left,
            *self.closest.point,
            *self.closest.normal,
            *renderer.force,
            self.closest.depth - self.felt_deeper,
            math.nan if predictor.model is None else predictor.local_slopes(REACH)[0],
            *self.line.pose,
            norm((deviation[0], deviation[1], deviation[2])),
            norm((deviation[3], deviation[4], deviation[5])),
            math.inf if model is None else model.fixture_age,
            renderer.coefficient,
        )
