"""The picture: probe, material, the delayed robot's ghost, force arrows, and the handle that a mouse drags."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.console.views import shapes
from foretouch.console.views.shapes import MaterialView, add_body
from foretouch.quantities.colours import BLUE, VERMILLION

UNITS = 200.0
"""Scene units per metre: one unit is 5 mm."""
UNITS_PER_NEWTON = 0.4
CAMERA = ((2.6, -20.5, 8.4), (0.0, 0.0, 2.6))
"""Where the camera is at first and what it looks at [scene units]."""
FIELD_OF_VIEW = math.radians(34.0)
"""Vertical."""
LONGEST_ARROW = 6.0
"""[scene units]."""
BOB = 0.25
"""How far the hint goes up and down [scene units], once a second."""
SMALLEST_APART, LARGEST_APART = 0.1, 5.0
"""Hand and probe are shown apart between these distances [scene units], 0.5 and 25 mm."""
LOWEST_RAIL = 1.35
"""The rail ends above the material, though a hand may want to go on [scene units]."""
RULER_X = -4.4


def look(server: Any, camera: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
    """Put the camera of every browser, and of those that come, where a picture can be seen as a whole.

    Args:
        server: The viewer's server.
        camera: Where it is and what it looks at [scene units].
    """
    position, target = camera
    server.initial_camera.position, server.initial_camera.look_at = position, target
    for client in server.get_clients().values():
        client.camera.position, client.camera.look_at = position, target


class Scene:
    """The viewer's scene. Heights are z = (surface - position) * `UNITS`: the undeformed surface is at 0.

    Args:
        server: The viewer's server.
        on_take: Called when a drag begins; says how high the handle is then [scene units].
        on_drag: Called with the handle's height [scene units] and whether it is held, at every move of a drag; both
            from the viewer's own thread. A browser that is gone lets go.
    """

    def __init__(self, server: Any, on_take: Callable[[], float], on_drag: Callable[[float, bool], None]) -> None:
        self._on_take = on_take
        self._on_drag = on_drag
        self._grab_offset = 0.0
        self._handle_z = 0.0
        self._travel = (0.0, 0.0)
        self.held = False
        scene = server.scene
        scene.set_up_direction("+z")
        # Toon shading under two plain lights: a third of the time that a software renderer takes for viser's defaults.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/lights/ambient", intensity=1.5)
        scene.add_light_directional("/lights/sun", intensity=2.0, position=(3.0, -6.0, 8.0))
        scene.world_axes.visible = False
        camera = server.initial_camera
        camera.fov = FIELD_OF_VIEW
        camera.position, camera.look_at = CAMERA
        self._root = scene.add_frame("/line", show_axes=False)
        self._material = MaterialView(scene)
        self._add_ruler(scene)
        self._probe = add_body(scene, "/line/probe", shapes.probe(), (92, 106, 120))
        self._ghost = add_body(scene, "/line/robot", shapes.probe(growth=0.12), VERMILLION, opacity=0.38)
        self._force = add_body(scene, "/line/probe_force", shapes.arrow(0.0), BLUE)
        self._doubt = add_body(scene, "/line/probe_force_doubt", shapes.doubt(0.0, 1.0), BLUE, opacity=0.35)
        self._doubt.visible = False
        self._ghost_force = add_body(scene, "/line/robot_force", shapes.arrow(0.0), VERMILLION)
        self._hand = add_body(scene, "/line/hand", shapes.ring(), BLUE, opacity=0.6)
        self._hand.visible = False
        self._handle = add_body(scene, "/line/handle", shapes.handle(), BLUE)
        self._hint = add_body(scene, "/line/hint", shapes.hint(), BLUE)
        self._rail = add_body(scene, "/line/rail", shapes.rail(0.0, 1.0), BLUE, opacity=0.1)
        for node in (self._handle, self._rail, self._probe):  # a handle that moves is hard to catch; its rail stands
            node.on_drag("left")(self._dragged)
        self._handle_label = scene.add_label(
            "/line/labels/handle", "Drag me down to press", anchor="bottom-center", font_screen_scale=1.4
        )
        self._force_label = scene.add_label("/line/labels/force", "", anchor="center-right", font_screen_scale=1.1)
        self._ghost_label = scene.add_label("/line/labels/robot", "", anchor="center-left", font_screen_scale=1.1)

    def show(self, shown: bool) -> None:
        """Show it all, or hide it: a session in three dimensions has a picture of its own."""
        if self._root.visible != shown:
            self._root.visible = shown

    def draw(self, z: float, ghost_z: float, force: float, ghost_force: float, deviation: float = math.nan) -> None:
        """Move everything.

        Args:
            z: Height of the operator's tip [scene units].
            ghost_z: Height of the robot's tip as last seen [scene units]; NaN hides it.
            force: What the operator feels [N].
            ghost_force: Delayed force [N].
            deviation: Standard deviation of the predicted force [N]; NaN where none is told.
        """
        self._probe.position = (0.0, 0.0, z)
        self._material.draw(-z)
        self._draw_force(self._force, -1.15, z, force)
        self._draw_doubt(z, force, deviation)
        self._force_label.visible = self._force.visible
        self._force_label.position = (-1.6, 0.0, z + 0.5)
        seen = math.isfinite(ghost_z)
        for node in (self._ghost, self._ghost_force, self._ghost_label):
            node.visible = seen
        if seen:
            self._ghost.position = (0.0, 0.0, ghost_z)
            self._draw_force(self._ghost_force, 1.15, ghost_z, ghost_force)
            self._ghost_label.position = (1.6, 0.0, ghost_z + 0.5)

    def draw_handle(self, z: float) -> None:
        """Move the handle to a height [scene units]; one that is held stays where it is held."""
        if not self.held:
            self._handle_z = z
        self._handle.position = (0.0, 0.0, self._handle_z)
        self._handle_label.position = (0.0, 0.0, self._handle_z + 1.4)
        if self._hint.visible:
            bob = BOB * math.sin(2.0 * math.pi * time.monotonic())
            self._hint.position = (1.75, -0.3, self._handle_z - 1.6 + bob)

    def draw_hand(self, z: float, ahead: float) -> None:
        """Show where the hand is while it and the probe are apart.

        Args:
            z: Height of the probe's tip [scene units].
            ahead: How much lower the hand is [scene units]; NaN hides it, and so does a distance too small to see or
                as large as the picture.
        """
        self._hand.visible = SMALLEST_APART < abs(ahead) < LARGEST_APART
        if self._hand.visible:
            self._hand.position = (0.0, 0.0, z - ahead)

    def label(self, handle: str, force: str, ghost: str) -> None:
        """Write beside the handle, the probe and the ghost."""
        for node, text in ((self._handle_label, handle), (self._force_label, force), (self._ghost_label, ghost)):
            if node.text != text:
                node.text = text

    def set_travel(self, bottom: float, top: float) -> None:
        """Between which heights of the operator's tip [scene units] the handle can be dragged."""
        if self._travel != (bottom, top):
            self._travel = (bottom, top)
            ends = (max(bottom + shapes.HANDLE_HEIGHT, LOWEST_RAIL), top + shapes.HANDLE_HEIGHT)
            self._rail.vertices = shapes.rail(*ends)[0]

    def offer_handle(self, offered: bool, *, useful: bool, hinted: bool) -> None:
        """Show the handle and its rail, or hide them where nobody listens to them.

        Args:
            offered: Whether somebody listens.
            useful: Whether a drag moves the robot: only then it is said what to do.
            hinted: Whether an arrow shows it, too: nobody has done it yet.
        """
        for node, shown in ((self._handle, offered), (self._rail, offered), (self._handle_label, offered and useful)):
            node.visible = shown
        self._hint.visible = offered and useful and hinted

    def hold_at(self, z: float) -> None:
        """Put the held handle at a height [scene units], after limits."""
        self._handle_z = z

    async def _dragged(self, event: Any) -> None:
        """A drag of the handle: async, so that the viewer keeps the order of start, moves and end."""
        height = height_on_axis(np.asarray(event.client.camera.position), np.asarray(event.end_position))
        if event.phase == "start":  # from where the handle is now, wherever on it or on its rail the mouse is
            self._handle_z = self._on_take()
            self._grab_offset = 0.0 if math.isnan(height) else height - self._handle_z
        self.held = event.phase != "end"
        self._on_drag(self._handle_z if math.isnan(height) else height - self._grab_offset, self.held)

    def _add_ruler(self, scene: Any) -> None:
        heights = [-depth_mm * 1e-3 * UNITS for depth_mm in (0, 5, 10)]
        y = -0.05
        ticks = [[(RULER_X - 0.15, y, z), (RULER_X + 0.15, y, z)] for z in heights]
        points = np.array([*ticks, [(RULER_X, y, heights[0]), (RULER_X, y, heights[-1])]], np.float32)
        scene.add_line_segments("/line/ruler", points, (60, 60, 60))
        for depth_mm, z in zip((0, 5, 10), heights, strict=True):
            scene.add_label(
                f"/line/ruler/{depth_mm}", f"{depth_mm} mm", position=(RULER_X - 0.25, y, z), anchor="center-right"
            )

    def _draw_doubt(self, z: float, force: float, deviation: float) -> None:
        """A sleeve around the arrow's end, from one deviation less to one more."""
        known = math.isfinite(force) and math.isfinite(deviation) and self._force.visible
        self._doubt.visible = known
        if known:
            ends = (force - deviation, force + deviation)
            low, high = (min(max(end * UNITS_PER_NEWTON, 0.0), LONGEST_ARROW) for end in ends)
            self._doubt.vertices = shapes.doubt(low, high)[0]
            self._doubt.position = (-1.15, -0.3, z)

    def _draw_force(self, node: Any, x: float, z: float, force: float) -> None:
        length = force * UNITS_PER_NEWTON if math.isfinite(force) else 0.0
        node.visible = length > 0.01
        if node.visible:
            node.vertices = shapes.arrow(min(length, LONGEST_ARROW))[0]
            node.position = (x, -0.3, z)


def height_on_axis(eye: Any, seen: Any) -> float:
    """Height z at which the z axis comes nearest to the line of sight from `eye` through `seen`.

    A mouse has two dimensions and the handle one: this is the handle's height under the mouse. NaN when the eye looks
    along the axis.
    """
    dx, dy, dz = seen - eye
    across = dx * dx + dy * dy
    if across < 1e-9 * (across + dz * dz) or not math.isfinite(across):
        return float("nan")
    return float(eye[2] - dz * (eye[0] * dx + eye[1] * dy) / across)
