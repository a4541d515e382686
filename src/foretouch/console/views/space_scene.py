"""The picture of a session in three dimensions: fixture, virtual probe, delayed robot, forces, and the handle."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from foretouch.console.views import shapes
from foretouch.console.views.fixture import FixtureView, along
from foretouch.console.views.shapes import add_body
from foretouch.quantities.colours import BLUE, GREEN, GREY, VERMILLION
from foretouch.quantities.pose import Vector
from foretouch.rendering import Surface

SPACE_UNITS = 200.0
"""Scene units per metre: one unit is 5 mm."""
SPACE_CAMERA = ((-4.0, -50.0, 31.0), (-4.0, 0.0, 0.0))
"""Where the camera is at first and what it looks at [scene units]."""
UNITS_PER_NEWTON = 1.0
LONGEST_ARROW = 8.0
NORMAL_LENGTH = 2.6
"""[scene units]."""
BESIDE, LABELLED = 1.2, 1.8
"""Arrows and labels stand so far beside the probe that they belong to [scene units]."""
HANDLE_SIZE = 4.0
"""Length of its arrows [scene units]."""
APART = 0.002
"""Arrows and labels change sides when one probe is so far past the other [m]."""
FORCE_SHOWN = 0.02
"""Smaller forces have no arrow [N]."""
ANCHORS = ("center-right", "center-left")
"""Of the left and of the right label."""
HINT = "Drag the arrows: the hand goes along"


class SpaceScene:
    """The viewer's scene in space: the world's frame, `SPACE_UNITS` to the metre.

    Args:
        server: The viewer's server.
        surface: What is touched, in the fixture's frame.
        on_drag: Called with the handle's place in the world [m] and ``"start"``, ``"update"`` or ``"end"``, from the
            viewer's own thread. A browser that is gone lets go.

    Attributes:
        fixture: Where it is rendered and believed, and what was learnt of it.
    """

    def __init__(self, server: Any, surface: Surface, on_drag: Callable[[Vector, str], None]) -> None:
        self._on_drag = on_drag
        scene = server.scene
        self._root = scene.add_frame("/space", show_axes=False)
        self.fixture = FixtureView(scene, surface, SPACE_UNITS)
        self._probe = add_body(scene, "/space/probe", shapes.probe(), GREY)
        self._ghost = add_body(scene, "/space/robot", shapes.probe(growth=0.12), VERMILLION, opacity=0.38)
        self._force = add_body(scene, "/space/force", shapes.arrow(0.0), BLUE)
        self._doubt = add_body(scene, "/space/doubt", shapes.doubt(0.0, 1.0), BLUE, opacity=0.35)
        self._ghost_force = add_body(scene, "/space/robot_force", shapes.arrow(0.0), VERMILLION)
        self._normal = add_body(scene, "/space/normal", shapes.arrow(NORMAL_LENGTH), GREEN)
        up = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], np.float32)
        self._tether = scene.add_line_segments("/space/tether", up, BLUE, thickness=1.5, thickness_units="screen")
        self._handle = scene.add_transform_controls(
            "/space/handle", scale=HANDLE_SIZE, line_width=5.0, disable_rotations=True, depth_test=False
        )
        self._handle.on_update(self._dragged)
        self._hint = scene.add_label("/space/labels/handle", HINT, anchor="bottom-center", font_screen_scale=1.3)
        self._label = scene.add_label("/space/labels/force", "", anchor=ANCHORS[0], font_screen_scale=1.1)
        self._ghost_label = scene.add_label("/space/labels/robot", "", anchor=ANCHORS[1], font_screen_scale=1.1)

        self._side = -1.0  # of the probe, on which its arrow and its label stand; the robot's stand on the other

    def show(self, shown: bool) -> None:
        """Show it all, or hide it."""
        if self._root.visible != shown:
            self._root.visible = shown

    def keep_apart(self, probe: float, robot: float) -> None:
        """Let arrows and labels of probe and robot stand on their outer sides.

        Args:
            probe: Where it is along x, to the right [m].
            robot: [m].
        """
        side = math.copysign(1.0, probe - robot)
        if side == self._side or not abs(probe - robot) >= APART:
            return
        self._side = side
        self._label.anchor, self._ghost_label.anchor = ANCHORS if side < 0.0 else ANCHORS[::-1]

    def draw_probe(self, place: Vector, force: Vector, deviation: float) -> None:
        """Draw the virtual probe, at once where the hand is.

        Args:
            place: [m]; one that is not finite hides it.
            force: That the hand is given [N].
            deviation: Standard deviation of its size [N]; NaN where none is told.
        """
        here = _scene(place)
        known = here is not None
        self._probe.visible = known
        size = math.sqrt(sum(value * value for value in force))
        self._force.visible = self._label.visible = arrow = known and FORCE_SHOWN < size < math.inf
        self._doubt.visible = doubted = arrow and math.isfinite(deviation)
        if here is None:
            return
        beside = (here[0] + self._side * BESIDE, here[1], here[2])
        self._probe.position = here
        self._label.position = (here[0] + self._side * LABELLED, here[1], here[2] + 1.2)
        if arrow:
            _draw_arrow(self._force, beside, force, size)
        if doubted:
            low, high = (_length(max(size + way * deviation, 0.0)) for way in (-1.0, 1.0))
            self._doubt.vertices = shapes.doubt(low, high)[0]
            self._doubt.position, self._doubt.wxyz = beside, along(force)

    def draw_robot(self, place: Vector | None, force: Vector) -> None:
        """Draw the robot as the network shows it; None hides it.

        Args:
            place: [m].
            force: That its sensor felt [N].
        """
        here = None if place is None else _scene(place)
        for node in (self._ghost, self._ghost_label):
            node.visible = here is not None
        size = math.sqrt(sum(value * value for value in force))
        self._ghost_force.visible = arrow = here is not None and FORCE_SHOWN < size < math.inf
        if here is None:
            return
        self._ghost.position = here
        self._ghost_label.position = (here[0] - self._side * LABELLED, here[1], here[2] + 1.2)
        if arrow:
            _draw_arrow(self._ghost_force, (here[0] - self._side * BESIDE, here[1], here[2]), force, size)

    def draw_normal(self, point: Vector, normal: Vector, shown: bool) -> None:
        """Draw the surface's normal under the probe.

        Args:
            point: The proxy [m].
            normal: Outward.
            shown: Whether the probe is near enough for it to matter.
        """
        here = _scene(point)
        self._normal.visible = shown and here is not None
        if here is not None and shown:
            self._normal.position = (here[0], here[1] - BESIDE, here[2])
            self._normal.wxyz = along(normal)

    def draw_handle(self, place: Vector, probe: Vector, *, offered: bool, held: bool, hinted: bool) -> None:
        """Draw the handle, and a line from it to the probe.

        Args:
            place: Of the handle [m]; while it is held it stays where the browser has it.
            probe: [m].
            offered: Whether anybody listens to it.
            held: Whether a person holds it.
            hinted: Whether a sentence says what to do.
        """
        end = _scene(probe)
        for node, shown in ((self._handle, offered), (self._tether, offered and end is not None)):
            if node.visible != shown:
                node.visible = shown
        self._hint.visible = offered and hinted
        here = _scene(place)
        if here is None or not offered:
            return
        if not held and not np.allclose(self._handle.position, here, atol=1e-4):
            self._handle.position = here
        self._hint.position = (here[0], here[1], here[2] + 1.15 * HANDLE_SIZE)
        if end is not None:
            way = (end[0] - here[0], end[1] - here[1], end[2] + shapes.HANDLE_HEIGHT - here[2])
            self._tether.position, self._tether.wxyz = here, along(way)
            self._tether.scale = (1.0, 1.0, max(math.hypot(*way), 1e-3))

    def label(self, force: str, ghost: str) -> None:
        """Write beside the probe and the robot."""
        for node, text in ((self._label, force), (self._ghost_label, ghost)):
            if node.text != text:
                node.text = text

    async def _dragged(self, event: Any) -> None:
        """A drag of the handle: async, so that the viewer keeps the order of start, moves and end."""
        x, y, z = (float(value) / SPACE_UNITS for value in event.target.position)
        self._on_drag((x, y, z), str(event.phase))


def _scene(place: Sequence[float]) -> Vector | None:
    """A place of the world [m] in the scene; None where it is nowhere."""
    x, y, z = place
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return None
    return SPACE_UNITS * x, SPACE_UNITS * y, SPACE_UNITS * z


def _length(force: float) -> float:
    return min(force * UNITS_PER_NEWTON, LONGEST_ARROW)


def _draw_arrow(node: Any, position: Vector, force: Vector, size: float) -> None:
    node.vertices = shapes.arrow(_length(size))[0]
    node.position, node.wxyz = position, along(force)
