"""The virtual probe and the delayed robot in a picture, each with its force and a label; in space, what is ahead."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.console.history import Array
from foretouch.console.models_seen import ModelFigures
from foretouch.console.plots import Row, put
from foretouch.console.views import shapes
from foretouch.console.views.shapes import COLOURS, add_body, along
from foretouch.models import ScaleField
from foretouch.models.scale_field_kernel import SPREAD
from foretouch.quantities.colours import BLUE, INK, VERMILLION
from foretouch.quantities.pose import Vector, add, norm, scaled, subtract
from foretouch.rendering import Surface, SurfaceContact
from foretouch.robot import Tip

UNITS = 200.0  # Scene units per metre: one unit is 5 mm
ANCHORS = ("center-right", "center-left")  # Anchors of the left and of the right label


class Measures(NamedTuple):
    """Style of the forces in a picture."""

    per_newton: float  # Length of an arrow [scene units per newton]
    longest: float  # Of all arrows [scene units]
    least: float  # Smaller forces have no arrow [N]
    beside: tuple[float, float]  # Begin of an arrow, to the side of the probe and in depth [scene units]
    label: tuple[float, float]  # Position of a label, to the side and above [scene units]


class Probes:
    """Both probes; the arrow and the label of each are on its side, so that they belong to it."""

    def __init__(
        self, scene: Any, root: str, colour: tuple[int, int, int], measures: Measures, tip: Tip = shapes.POINT
    ) -> None:
        (across, behind), (right, above) = measures.beside, measures.label
        wider = max(tip.radius - shapes.TIP_RADIUS, 0.0)  # arrows and labels are beside a large ball
        self._measures = measures._replace(beside=(across + wider, behind), label=(right + wider, above))
        self.probe = add_body(scene, f"{root}/probe", shapes.probe(tip), colour)
        self.robot = add_body(scene, f"{root}/robot", shapes.probe(tip, growth=0.12), VERMILLION, opacity=0.38)
        self._force = add_body(scene, f"{root}/probe_force", shapes.arrow(0.0), BLUE)
        sleeve = shapes.uncertainty(0.0, 1.0)
        self._uncertainty = add_body(scene, f"{root}/probe_force_uncertainty", sleeve, BLUE, opacity=0.35)
        self._robot_force = add_body(scene, f"{root}/robot_force", shapes.arrow(0.0), VERMILLION)
        self._uncertainty.visible = False
        self.labels = tuple(
            scene.add_label(f"{root}/labels/{name}", "", anchor=anchor, font_screen_scale=1.1)
            for name, anchor in zip(("force", "robot"), ANCHORS, strict=True)
        )
        self._side = -1.0  # of the probe, on which its arrow and its label are; the robot's are on the other

    def keep_apart(self, ahead: float) -> None:
        """Put arrows and labels on the outer sides: to the right of the probe where it is ahead of the robot."""
        side = math.copysign(1.0, ahead)
        if side != self._side:
            self._side = side
            for label, anchor in zip(self.labels, ANCHORS if side < 0.0 else ANCHORS[::-1], strict=True):
                label.anchor = anchor

    def draw_probe(self, here: Vector | None, force: Vector, deviation: float) -> None:
        """Draw the virtual probe [scene units], None to hide it, with rendered force and deviation [N]."""
        label, size = self.labels[0], math.hypot(*force)
        self.probe.visible = here is not None
        arrow = self._draw_force(self._force, here, self._side, force)
        label.visible, self._uncertainty.visible = arrow, arrow and math.isfinite(deviation)
        if here is None:
            return
        self.probe.position, label.position = here, self._beside_label(here, self._side)
        if self._uncertainty.visible:  # a sleeve around the arrow's end, from one deviation less to one more
            low, high = (self._length(max(size + way * deviation, 0.0)) for way in (-1.0, 1.0))
            self._uncertainty.vertices = shapes.uncertainty(low, high)[0]
            self._uncertainty.position, self._uncertainty.wxyz = self._force.position, self._force.wxyz

    def draw_robot(self, here: Vector | None, force: Vector) -> None:
        """Draw the delayed robot [scene units], None to hide it, with the force that it felt [N]."""
        self.robot.visible = self.labels[1].visible = here is not None
        self._draw_force(self._robot_force, here, -self._side, force)
        if here is not None:
            self.robot.position, self.labels[1].position = here, self._beside_label(here, -self._side)

    def write(self, force: str, robot: str) -> None:
        """Write beside the probe and the robot."""
        for label, text in zip(self.labels, (force, robot), strict=True):
            put(label, text=text)

    def _length(self, force: float) -> float:
        return min(force * self._measures.per_newton, self._measures.longest)

    def _beside_label(self, here: Vector, side: float) -> Vector:
        across, above = self._measures.label
        return here[0] + side * across, here[1], here[2] + above

    def _draw_force(self, node: Any, here: Vector | None, side: float, force: Vector) -> bool:
        """Draw an arrow beside a probe; whether there is one."""
        size = math.hypot(*force)
        node.visible = shown = here is not None and self._measures.least < size < math.inf
        if here is not None and shown:
            across, behind = self._measures.beside
            node.vertices = shapes.arrow(self._length(size))[0]
            node.position, node.wxyz = (here[0] + side * across, here[1] + behind, here[2]), along(force)
        return shown


NOWHERE = (math.nan,) * 3
LEASH = 2e-3  # Length of the way that gives the hand's direction: less is noise [m]
JUMP = 20e-3  # A hand that is this far from where it was in the picture before has not slid there [m]
STRIDE, STRIDES = 2e-3, 15
"""Distance between two points ahead [m], and their number."""
STATED, AHEAD = 5, "Ahead 10 mm"
"""Number of strides to the point that is stated as a number, and how it is called."""
LEAST_WIDTH, WIDTH, LIFTED = 0.6e-3, 6e-3, 0.5e-3
"""Half the width of the ribbon where all is certain, its growth for a deviation of 100 %, and its height over the
surface [m]."""
RIMS = (4, (255, 255, 255), (0.0, 0.0, 0.0)), (2, INK, (0.0, 0.0, 0.05))
"""Lines that are seen on dark and on light colours: widths [pixel], and where they are, one above the other."""
SCREEN = {"thickness_units": "screen"}
SMALLEST_CHANGE = 0.02  # Changes of the ribbon below this are not drawn [scene units]


class Ahead(NamedTuple):
    """Prediction along the surface ahead of the hand, from the point that it touches on, `STRIDE` apart.

    Attributes:
        points: On the surface, in the fixture's frame, shape (n, 3) [m].
        normals: Outward, shape (n, 3).
        stiffness: Local stiffness, shape (n,) [N/m].
        deviation: Its standard deviation as a fraction of it, shape (n,).
        known: Whether anything is known of the place, shape (n,): 24 mm from all touches nothing is.
    """

    points: Array
    normals: Array
    stiffness: Array
    deviation: Array
    known: NDArray[np.bool_]

    def row(self) -> Row:
        """The stiffness that is predicted 10 mm ahead, and how sure it is."""
        if len(self.points) <= STATED:
            return Row(AHEAD, "surface ends")
        if not self.known[STATED]:
            return Row(AHEAD, "not known")
        return Row(AHEAD, f"{self.stiffness[STATED]:,.0f} N/m", more=f"± {100.0 * self.deviation[STATED]:.0f} %")


class Outlook:
    """What is ahead of a place that moves over a surface, in the fixture's frame.

    Attributes:
        way: Direction of its motion, of length 1: that of a short leash, which it drags; None until it has moved.
    """

    def __init__(self, surface: Surface) -> None:
        corners = surface.outline()[0]
        self._surface = surface.bare
        self._low, self._high = corners.min(axis=0) - STRIDE, corners.max(axis=0) + STRIDE
        self._here: Vector = NOWHERE
        self._end: Vector = NOWHERE  # of the leash
        self.way: Vector | None = None

    def follow(self, here: Vector) -> None:
        """Move to a place on the surface [m]; one that is not finite, or a leap, begins anew."""
        way = subtract(here, self._end)
        size, self._here = norm(way), here
        if not size < JUMP:
            self._end, self.way = here, None
        elif size > LEASH:
            self.way = scaled(way, 1.0 / size)
            self._end = subtract(here, scaled(self.way, LEASH))

    def look(
        self,
        field: ScaleField | None,
        law: ModelFigures | None,
        raised: Callable[[Array], Array] = lambda points: points,
    ) -> Ahead | None:
        r"""Prediction ahead; None without a way, or where nothing was learnt.

        .. math:: K(p) = s(p)\, K, \quad \sigma_K(p) = K(p) \sqrt{\sigma^2 / K^2 + \sigma_s^2(p)}

        with the law's local stiffness K and its deviation, and the scale s with its relative deviation, which grows
        with the distance from what was touched; see `foretouch.models.ScaleField`. The way goes straight on along the
        surface, and ends at its rim; one whose shape is learnt is flat on the way, and the points are raised to it.
        """
        if field is None or law is None or self.way is None or not law.stiffness > 0.0:
            return None
        contacts = self._contacts(self.way)
        points, normals = (np.array(each) for each in zip(*((one.point, one.normal) for one in contacts), strict=True))
        points = raised(points)
        scales, deviations = field.scales_at(points)
        own = law.deviation / law.stiffness if math.isfinite(law.deviation) else 0.0
        return Ahead(points, normals, law.stiffness * scales, np.hypot(own, deviations), deviations < SPREAD)

    def _contacts(self, way: Vector) -> list[SurfaceContact]:
        contacts = [self._surface.contact(self._here)]
        for _ in range(STRIDES):
            last = contacts[-1].point
            contact = self._surface.contact(add(last, scaled(way, STRIDE)))
            went, place = subtract(contact.point, last), np.array(contact.point)
            if norm(went) < 0.5 * STRIDE or (place < self._low).any() or (place > self._high).any():
                break  # at the rim; a plane, which has none, ends where it is drawn
            way = scaled(went, 1.0 / norm(went))
            contacts.append(contact)
        return contacts


class Ribbon:
    """A ribbon on the surface ahead of the hand, coloured as the surface is: the wider, the less sure.

    Lines across it are 10 mm apart. It ends where nothing is known.
    """

    def __init__(self, scene: Any, root: str) -> None:
        nothing = np.zeros((2 * STRIDES + 2, 3), np.float32), np.array([(0, 1, 2)], np.uint32)
        self._steps = [add_body(scene, f"{root}/ahead_{step}", nothing, colour) for step, colour in enumerate(COLOURS)]
        lines = np.zeros((1, 2, 3), np.float32)
        self._rims = [
            scene.add_line_segments(f"{root}/ahead_rim_{wide}", lines, colour, thickness=wide, position=above, **SCREEN)
            for wide, colour, above in RIMS
        ]
        self._drawn: Array = np.empty((0, 2, 3))
        self._levels: NDArray[np.int64] = np.empty(0, np.int64)

    def draw(self, ahead: Ahead | None, edges: Array, bend: Callable[[Array], Array]) -> None:
        """Draw what is ahead, in the colours between edges [N/m], on a surface that is bent; None hides it."""
        count = 0 if ahead is None or not len(edges) else int(np.argmin([*ahead.known, False]))
        if ahead is None or count < 2:
            for node in (*self._steps, *self._rims):
                put(node, visible=False)
            self._drawn = np.empty((0, 2, 3))
            return
        sides = UNITS * bend(_sides(ahead, count).reshape(-1, 3)).reshape(-1, 2, 3)
        middle = 0.5 * (ahead.stiffness[: count - 1] + ahead.stiffness[1:count])
        levels = shapes.levels_of(edges, middle, np.ones(count - 1, bool))
        same = sides.shape == self._drawn.shape and np.array_equal(levels, self._levels)
        if same and np.abs(sides - self._drawn).max() < SMALLEST_CHANGE:
            return
        self._drawn, self._levels = sides, levels
        quads = 2 * np.arange(count - 1)[:, None] + (0, 2, 3, 1)
        # All have as many vertices, always: a late page may get those of one picture with the faces of another.
        vertices = sides[np.minimum(np.arange(STRIDES + 1), count - 1)].reshape(-1, 3).astype(np.float32)
        for step, node in enumerate(self._steps, 1):
            here = levels == step
            put(node, visible=bool(here.any()))
            if here.any():
                node.vertices, node.faces = vertices, shapes.triangles_of(quads[here])
        rims = [np.stack([sides[:-1, side], sides[1:, side]], axis=1) for side in (0, 1)]
        lines = np.concatenate([*rims, sides[STATED::STATED], sides[-1:]]).astype(np.float32)
        for node in self._rims:
            node.points, node.visible = lines, True


def _sides(ahead: Ahead, count: int) -> Array:
    """Left and right side of the ribbon at the first points, shape (count, 2, 3) [m]."""
    points, normals = ahead.points[:count], ahead.normals[:count]
    across = np.cross(np.gradient(points, axis=0), normals)
    across /= np.linalg.norm(across, axis=1)[:, None]
    width = (LEAST_WIDTH + WIDTH * np.minimum(ahead.deviation[:count], 1.0))[:, None]
    middle = points + LIFTED * normals
    return np.stack([middle - width * across, middle + width * across], axis=1)
