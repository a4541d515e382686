"""A session along a line in the console: probe, material, the delayed robot, and the handle that a mouse drags."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.console.plots import put
from foretouch.console.views import shapes
from foretouch.console.views.hold import Hold
from foretouch.console.views.probes import UNITS, Measures, Probes
from foretouch.console.views.shapes import HANDLE_HEIGHT, MaterialView, add_body
from foretouch.console.watched import Watched
from foretouch.quantities.colours import BLUE, GREY
from foretouch.quantities.pose import Vector

DRAG, LET_GO = "Drag me down to press", "Let go and the script goes on"
CAMERA = ((2.6, -20.5, 8.4), (0.0, 0.0, 2.6))
"""Where the camera is at first and what it looks at [scene units]."""
FIELD_OF_VIEW = math.radians(34.0)
"""Vertical."""
MEASURES = Measures(per_newton=0.4, longest=6.0, least=0.025, beside=(1.15, -0.3), label=(1.6, 0.5))
"""How forces are shown."""
BOB = 0.25
"""How far the hint goes up and down [scene units], once a second."""
SMALLEST_APART, LARGEST_APART = 0.1, 5.0
"""Hand and probe are shown apart between these distances [scene units], 0.5 and 25 mm."""
LOWEST_RAIL = 1.35
"""The rail ends above the material, though a hand may want to go on [scene units]."""
RULER_X = -4.4


def look(server: Any, camera: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
    """Put the camera of every browser, and of those that come, where a picture is seen as a whole [scene units]."""
    position, target = camera
    server.initial_camera.position, server.initial_camera.look_at = position, target
    for client in server.get_clients().values():
        client.camera.position, client.camera.look_at = position, target


class Scene:
    """The viewer's scene. Heights are z = (surface - position) * `UNITS`: the undeformed surface is at 0.

    Args:
        server: The viewer's server.
        on_take: Called when a drag begins; returns the height of the handle then [scene units].
        on_drag: Called with the handle's height [scene units] and whether it is held, at every move of a drag; both
            from the viewer's thread. A browser that is gone lets go.
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
        self._probes = Probes(scene, "/line", (92, 106, 120), MEASURES)
        self._hand = add_body(scene, "/line/hand", shapes.ring(), BLUE, opacity=0.6)
        self._hand.visible = False
        self._handle = add_body(scene, "/line/handle", shapes.handle(), BLUE)
        self._hint = add_body(scene, "/line/hint", shapes.hint(), GREY)  # blue arrows are forces
        self._rail = add_body(scene, "/line/rail", shapes.rail(0.0, 1.0), BLUE, opacity=0.1)
        # A handle that moves is hard to catch; its rail stands.
        for node in (self._handle, self._rail, self._probes.probe):
            node.on_drag("left")(self._dragged)
        label = "/line/labels/handle"
        self._handle_label = scene.add_label(label, DRAG, anchor="bottom-center", font_screen_scale=1.4)

    def show(self, shown: bool) -> None:
        """Show it all, or hide it: a session in three dimensions has a separate picture."""
        put(self._root, visible=shown)

    def draw(self, z: float, ghost_z: float, force: float, ghost_force: float, deviation: float = math.nan) -> None:
        """Move tips to heights [scene units] and show forces [N] and their deviation; NaN hides one."""
        self._material.draw(-z)
        self._probes.draw_probe((0.0, 0.0, z), _upwards(force), deviation)
        seen = math.isfinite(ghost_z)
        self._probes.draw_robot((0.0, 0.0, ghost_z) if seen else None, _upwards(ghost_force))

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
        """Show the hand below the probe's tip [scene units], unless that is NaN, or too little or too far to see."""
        self._hand.visible = SMALLEST_APART < abs(ahead) < LARGEST_APART
        if self._hand.visible:
            self._hand.position = (0.0, 0.0, z - ahead)

    def label(self, handle: str, force: str, ghost: str) -> None:
        """Write beside the handle, the probe and the ghost."""
        put(self._handle_label, text=handle)
        self._probes.write(force, ghost)

    def set_travel(self, bottom: float, top: float) -> None:
        """Between which heights of the operator's tip [scene units] the handle can be dragged."""
        if self._travel != (bottom, top):
            self._travel = (bottom, top)
            ends = (max(bottom + shapes.HANDLE_HEIGHT, LOWEST_RAIL), top + shapes.HANDLE_HEIGHT)
            self._rail.vertices = shapes.rail(*ends)[0]

    def offer_handle(self, offered: bool, *, useful: bool, hinted: bool) -> None:
        """Show the handle and its rail, what to do where a drag moves the robot, and an arrow until it was used."""
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
        depths = (0, 5, 10)
        heights = [-depth_mm * 1e-3 * UNITS for depth_mm in depths]
        y = -0.05
        ticks = [[(RULER_X - 0.15, y, z), (RULER_X + 0.15, y, z)] for z in heights]
        points = np.array([*ticks, [(RULER_X, y, heights[0]), (RULER_X, y, heights[-1])]], np.float32)
        scene.add_line_segments("/line/ruler", points, (60, 60, 60))
        for depth_mm, z in zip(depths, heights, strict=True):
            scene.add_label(
                f"/line/ruler/{depth_mm}", f"{depth_mm} mm", position=(RULER_X - 0.25, y, z), anchor="center-right"
            )


def _upwards(force: float) -> Vector:
    """Out of the surface; one that pulls, or is no finite number, is not shown."""
    return 0.0, 0.0, max(force, 0.0) if math.isfinite(force) else 0.0


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


class LineView:
    """What a console shows of a session along a line.

    The handle is drawn in the probe's frame, from 0 to 1.2 times the press depth below the surface.
    """

    def __init__(self, server: Any, watched: Watched, hold: Hold) -> None:
        self._watched, self.hold = watched, hold
        self._scene = Scene(server, self._take_handle, self._dragged)
        self.show = self._scene.show

    def draw(self, shown: Watched, *, live: bool, useful: bool) -> None:
        """Draw a session or recording; whether a person can move its hand, and the robot goes along then."""
        self.hold.follow()
        leader, surface, position = shown.leader, shown.surface, shown.probe_position
        z = (surface - position) * UNITS
        rendered, delayed, deviation = 0.0, 0.0, math.nan
        if leader is not None:
            rendered, delayed, deviation = leader.rendered_force, leader.delayed_force, leader.standard_deviation
        self._scene.set_travel(round((surface - shown.deepest) * UNITS, 1), round(surface * UNITS, 1))
        self._scene.draw(z, (surface - shown.robot_position) * UNITS, rendered, delayed, deviation)
        offered = live and self._watched.operator == "browser"
        self._scene.offer_handle(offered, useful=useful, hinted=not self.hold.used)
        self._scene.draw_handle(self._handle_height())
        self._scene.draw_hand(z, shown.hand_ahead * UNITS)

    def write(self, shown: Watched) -> None:
        """Write beside handle, force and robot what they are.

        How large a force is stands in the panel alone: the viewer draws labels some pictures later than numbers.
        """
        leader = shown.leader
        if leader is None:
            self._scene.label(DRAG, "", "")
            return
        held_back = ", holds back" if shown.telemetry is not None and shown.telemetry.guarded else ""
        self._scene.label(LET_GO if self.hold.held else DRAG, "rendered force", f"delayed robot{held_back}")

    def _handle_height(self) -> float:
        """Height of the handle as drawn [scene units]."""
        return (self._watched.surface - self.hold.position) * UNITS + HANDLE_HEIGHT

    def _take_handle(self) -> float:
        """A drag begins: the handle, which may be a picture old, is where it is now [scene units]."""
        self.hold.follow()
        return self._handle_height()

    def _dragged(self, z: float, held: bool) -> None:
        """The handle was moved to a height [scene units]."""
        self.hold.move_to(self._watched.surface - (z - HANDLE_HEIGHT) / UNITS, held)
        self._scene.hold_at(self._handle_height())
