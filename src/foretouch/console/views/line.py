"""A session along a line in the console: probe, material, the delayed robot, and the handle that a mouse drags.

Heights in the scene are z = (surface - position) * `UNITS`: the undeformed surface is at 0.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.console.history import Array
from foretouch.console.plots import put
from foretouch.console.views import shapes
from foretouch.console.views.hold import Hold
from foretouch.console.views.probes import UNITS, Measures, Probes
from foretouch.console.views.shapes import HANDLE_HEIGHT, TIP_RADIUS, add_body, grid, sinking, triangles_of
from foretouch.console.watched import Watched
from foretouch.quantities.colours import BLUE, CUT, DENT, GREY
from foretouch.quantities.pose import Vector

INSTRUCTION = "Drag the blue handle down to press."
DRAG, LET_GO = "Drag me down to press", "Let go and the script goes on"
CAMERA = ((2.6, -20.5, 8.4), (0.0, 0.0, 2.6))
"""First position of the camera and the point at which it looks [scene units]."""
FIELD_OF_VIEW = math.radians(34.0)  # Vertical
MEASURES = Measures(per_newton=0.4, longest=6.0, least=0.025, beside=(1.15, -0.3), label=(1.6, 0.5))
"""Style of the forces."""
BOB = 0.25  # Amplitude of the hint, which goes up and down once a second [scene units]
SMALLEST_APART, LARGEST_APART = 0.1, 5.0
"""Hand and probe are shown apart between these distances [scene units], 0.5 and 25 mm."""
LOWEST_RAIL = 1.35  # The rail ends above the material, though a hand may want to go on [scene units]
RULER_X = -4.4
EDGE = 3.9  # Distance from the axis at which the material does not sink any more [scene units]
SHALLOW = math.sqrt(0.5)  # Width of a shallow dent [scene units]
SMALLEST_CHANGE = 0.002  # Changes below this [scene units], 0.01 mm, are not drawn
LARGEST_DEPTH = 2.9  # The picture of the block goes no deeper [scene units]
STEPS = (0.1, 0.4, 0.9, 1.5)  # Depths at which the dent's colour changes [scene units]: 0.5, 2, 4.5 and 7.5 mm


def look(server: Any, camera: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
    """Put the camera of every browser, and of those that come, where a picture is seen as a whole [scene units]."""
    for each in (server.initial_camera, *(client.camera for client in server.get_clients().values())):
        each.position, each.look_at = camera


class LineView:
    """Picture of a session along a line.

    The handle is drawn in the probe's frame, from 0 to 1.2 times the press depth below the surface. A drag of it, which
    comes from the viewer's thread, takes it from where it is then; a browser that is gone lets go.
    """

    camera, instruction, problem = CAMERA, INSTRUCTION, ""
    ahead = None  # a line has one place

    def __init__(self, server: Any, watched: Watched, hold: Hold) -> None:
        self._watched, self.hold = watched, hold
        self._grab_offset = self._handle_z = 0.0
        self._travel = (0.0, 0.0)
        self._dragging = False
        scene = server.scene
        scene.set_up_direction("+z")
        # Toon shading under two plain lights: a third of the time that a software renderer takes for viser's defaults.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/lights/ambient", intensity=1.5)
        scene.add_light_directional("/lights/sun", intensity=2.0, position=(3.0, -6.0, 8.0))
        scene.world_axes.visible = False
        server.initial_camera.fov = FIELD_OF_VIEW
        look(server, CAMERA)
        self._root = scene.add_frame("/line", show_axes=False)
        self._material = Material(scene)
        _add_ruler(scene)
        self._probes = Probes(scene, "/line", (92, 106, 120), MEASURES)
        self._hand = add_body(scene, "/line/hand", shapes.RING, BLUE, opacity=0.6)
        self._hand.visible = False
        self._handle = add_body(scene, "/line/handle", shapes.handle(), BLUE)
        self._hint = add_body(scene, "/line/hint", shapes.DOWNWARDS, GREY)  # blue arrows are forces
        self._rail = add_body(scene, "/line/rail", shapes.rail(0.0, 1.0), BLUE, opacity=0.1)
        # A handle that moves is hard to catch; its rail does not move.
        for node in (self._handle, self._rail, self._probes.probe):
            node.on_drag("left")(self._dragged)
        label = "/line/labels/handle"
        self._handle_label = scene.add_label(label, DRAG, anchor="bottom-center", font_screen_scale=1.4)

    def show(self, shown: bool) -> None:
        """Show the picture, or hide it."""
        self._root.visible = shown

    def draw(self, shown: Watched, *, live: bool, useful: bool) -> None:
        """Draw a session or recording; whether a person can move its hand, and the robot goes along then."""
        self.hold.follow()
        leader, surface = shown.leader, shown.surface
        z, robot_z = ((surface - position) * UNITS for position in (shown.probe_position, shown.robot_position))
        rendered, delayed, deviation = 0.0, 0.0, math.nan
        if leader is not None:
            rendered, delayed, deviation = leader.rendered_force, leader.delayed_force, leader.standard_deviation
        self._material.draw(-z)
        self._probes.draw_probe((0.0, 0.0, z), _upwards(rendered), deviation)
        self._probes.draw_robot((0.0, 0.0, robot_z) if math.isfinite(robot_z) else None, _upwards(delayed))
        bottom, top = travel = round((surface - shown.deepest) * UNITS, 1), round(surface * UNITS, 1)
        if self._travel != travel:  # between which heights of the operator's tip the handle can be dragged
            self._travel = travel
            self._rail.vertices = shapes.rail(max(bottom + HANDLE_HEIGHT, LOWEST_RAIL), top + HANDLE_HEIGHT)[0]
        self._draw_handle(live and self._watched.operator == "browser", useful)
        ahead = shown.hand_ahead * UNITS
        self._hand.visible = SMALLEST_APART < abs(ahead) < LARGEST_APART
        if self._hand.visible:
            self._hand.position = (0.0, 0.0, z - ahead)

    def depth(self, shown: Watched) -> float:
        """Depth of the operator's probe in the surface [m], negative outside."""
        return 0.0 if shown.leader is None else shown.leader.position - shown.surface

    def plot(self, shown: Watched) -> None:
        """Draw the image of the camera beside it: along a line there is none."""

    def write(self, shown: Watched, now: float) -> None:
        """Write beside handle, force and robot what they are.

        The size of a force is in the panel alone: the viewer draws labels some pictures later than numbers.
        """
        heard, held_back = shown.leader is not None, shown.telemetry is not None and shown.telemetry.guarded
        put(self._handle_label, text=LET_GO if heard and self.hold.held else DRAG)
        robot = "delayed robot, holds back" if held_back else "delayed robot"
        self._probes.write("rendered force" if heard else "", robot if heard else "")

    def drag_to(self, z: float, held: bool) -> None:
        """The handle was moved to a height [scene units], and is still held or let go there."""
        self.hold.move_to(self._watched.surface - (z - HANDLE_HEIGHT) / UNITS, held)
        self._handle_z = self._handle_height()  # after limits

    def _draw_handle(self, offered: bool, useful: bool) -> None:
        """The handle, which stays where it is held, its rail, what to do, and an arrow until it was used."""
        for node, shown in ((self._handle, offered), (self._rail, offered), (self._handle_label, offered and useful)):
            node.visible = shown
        self._hint.visible = offered and useful and not self.hold.used
        if not self._dragging:
            self._handle_z = self._handle_height()
        self._handle.position = (0.0, 0.0, self._handle_z)
        self._handle_label.position = (0.0, 0.0, self._handle_z + 1.4)
        if self._hint.visible:
            bob = BOB * math.sin(2.0 * math.pi * time.monotonic())
            self._hint.position = (1.75, -0.3, self._handle_z - 1.6 + bob)

    def _handle_height(self) -> float:
        return (self._watched.surface - self.hold.position) * UNITS + HANDLE_HEIGHT

    async def _dragged(self, event: Any) -> None:
        height = height_on_axis(np.asarray(event.client.camera.position), np.asarray(event.end_position))
        if event.phase == "start":  # from where the handle is now, wherever on it or on its rail the mouse is
            self.hold.follow()
            self._handle_z = self._handle_height()
            self._grab_offset = 0.0 if math.isnan(height) else height - self._handle_z
        self._dragging = event.phase != "end"
        self.drag_to(self._handle_z if math.isnan(height) else height - self._grab_offset, self._dragging)


def _add_ruler(scene: Any) -> None:
    depths, y = (0, 5, 10), -0.05
    heights = [-depth_mm * 1e-3 * UNITS for depth_mm in depths]
    ticks = [[(RULER_X - 0.15, y, z), (RULER_X + 0.15, y, z)] for z in heights]
    points = np.array([*ticks, [(RULER_X, y, heights[0]), (RULER_X, y, heights[-1])]], np.float32)
    scene.add_line_segments("/line/ruler", points, (60, 60, 60))
    for depth_mm, z in zip(depths, heights, strict=True):
        position = (RULER_X - 0.25, y, z)
        scene.add_label(f"/line/ruler/{depth_mm}", f"{depth_mm} mm", position=position, anchor="center-right")


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


WIDTH, BEHIND, HEIGHT, LAYERS = 4.0, 4.0, 3.0, 6
"""Of the block: half its width, its depth and its height [scene units], and layers of its cut."""


class Material:
    """A block that is cut through the middle, so that the dent shows in the cut as well as on top.

    The surface sinks as of `sinking`, to the block's nearest edge, and has the colour of how far it has sunk; below,
    that fades linearly to none at the bottom.
    """

    def __init__(self, scene: Any) -> None:
        radii = WIDTH * np.sinh(np.linspace(0.0, 2.2, 25)) / math.sinh(2.2)
        angles = np.linspace(0.0, math.pi, 33)
        self._x = np.concatenate([-radii[:0:-1], radii])
        # Points of a half ring about the axis sink alike; the outermost is the edge.
        x, y = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
        along, across = np.maximum(np.abs(np.cos(angles)), 1e-9), np.maximum(np.sin(angles), 1e-9)
        reach = np.minimum(WIDTH / along, BEHIND / across)
        x[-1], y[-1] = reach * np.cos(angles), reach * np.sin(angles)
        self._top = np.stack([x.ravel(), y.ravel()], axis=1)  # shape (radii * angles, 2)
        self._levels = np.linspace(0.0, -HEIGHT, LAYERS + 1)
        self.top_faces = grid(len(radii), len(angles))
        self._drawn_depth = 0.0
        self._tops = [
            add_body(scene, f"/line/material/top_{i}", (self.top(0.0), self.top_faces), colour)
            for i, colour in enumerate(DENT)
        ]
        for node in self._tops[1:]:
            node.visible = False
        layers = grid(len(self._x), LAYERS + 1).reshape(len(self._x) - 1, LAYERS, 2, 3)
        self._cut = [
            add_body(scene, f"/line/material/cut_{i}", (self.cut(0.0), layers[:, i::2].reshape(-1, 3)), colour)
            for i, colour in enumerate(CUT)
        ]
        corners = [(x, y, z) for x in (-WIDTH, WIDTH) for y in (0.0, BEHIND) for z in (0.0, -HEIGHT)]
        sides = triangles_of([(0, 1, 3, 2), (4, 6, 7, 5), (2, 3, 7, 6), (1, 5, 7, 3)])
        add_body(scene, "/line/material/sides", (np.array(corners, np.float32), sides), CUT[1])

    def draw(self, depth: float) -> None:
        """Sink under the tip at a depth [scene units]."""
        depth = min(max(depth, 0.0), LARGEST_DEPTH)
        if abs(depth - self._drawn_depth) < SMALLEST_CHANGE:
            return
        self._drawn_depth = depth
        top, cut = self.top(depth), self.cut(depth)
        for node, faces in zip(self._tops, self.levels(depth), strict=True):
            node.visible = len(faces) > 0
            if len(faces):
                node.vertices, node.faces = top, faces
        for node in self._cut:
            node.vertices = cut

    def top(self, depth: float) -> NDArray[np.float32]:
        """Vertices of the upper surface with the tip at a depth [scene units]."""
        x, y = self._top.T
        return np.stack([x, y, -_sunk(np.hypot(x, y), depth)], axis=1).astype(np.float32)

    def levels(self, depth: float) -> list[NDArray[np.uint32]]:
        """Triangles of the upper surface by how far they have sunk: less than the first of `STEPS`, and so on."""
        corners = -self.top(depth)[:, 2][self.top_faces].reshape(-1, 6)  # the two triangles of a quad have one colour
        level = np.repeat(np.searchsorted(np.array(STEPS), corners.mean(axis=1), side="right"), 2)
        return [self.top_faces[level == index] for index in range(len(STEPS) + 1)]

    def cut(self, depth: float) -> NDArray[np.float32]:
        """Vertices of the cut face with the tip at a depth [scene units]."""
        sunk = _sunk(self._x, depth)[:, None] * (1.0 + self._levels / HEIGHT)
        z = np.maximum(self._levels - sunk, -HEIGHT)
        x = np.broadcast_to(self._x[:, None], z.shape)
        return np.stack([x, np.zeros_like(z), z], axis=-1).reshape(-1, 3).astype(np.float32)


def _sunk(radius: Array, depth: float) -> Array:
    return sinking(radius**2, max(depth, 0.0), SHALLOW, EDGE, TIP_RADIUS)
