"""The virtual probe and the delayed robot in a picture, along a line or in space: each with its force and a label."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from foretouch.console.plots import put
from foretouch.console.views import shapes
from foretouch.console.views.shapes import add_body, along
from foretouch.quantities.colours import BLUE, VERMILLION
from foretouch.quantities.pose import Vector

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

    def __init__(self, scene: Any, root: str, colour: tuple[int, int, int], measures: Measures) -> None:
        self._measures = measures
        self.probe = add_body(scene, f"{root}/probe", shapes.probe(), colour)
        self.robot = add_body(scene, f"{root}/robot", shapes.probe(growth=0.12), VERMILLION, opacity=0.38)
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
        """Draw the virtual probe's tip [scene units], None to hide it, with rendered force and deviation [N]."""
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
        """Draw the delayed robot's tip [scene units], None to hide it, with the force that it felt [N]."""
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
        """Draw an arrow beside a tip; whether there is one."""
        size = math.hypot(*force)
        node.visible = shown = here is not None and self._measures.least < size < math.inf
        if here is not None and shown:
            across, behind = self._measures.beside
            node.vertices = shapes.arrow(self._length(size))[0]
            node.position, node.wxyz = (here[0] + side * across, here[1] + behind, here[2]), along(force)
        return shown
