"""A session in three dimensions in the console: fixture, virtual probe, delayed robot, forces, handle and panels.

The scene's frame is the world's, `UNITS` to the metre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from foretouch.console.history import Array
from foretouch.console.models_seen import figures_of
from foretouch.console.panels.panel import Panel
from foretouch.console.panels.space import BOARD, MARKER, TIP_RADIUS, SpacePanel, footprint
from foretouch.console.panels.stop import SPACE_HELP, SPACE_STROKES, add_keys
from foretouch.console.plots import SECONDS, Row, put
from foretouch.console.views import shapes
from foretouch.console.views.hold import SpaceHold
from foretouch.console.views.probes import AHEAD, SCREEN, UNITS, Ahead, Measures, Outlook, Probes, Ribbon
from foretouch.console.views.shapes import COLOURS, UNKNOWN, Faces, Mesh, add_body, along
from foretouch.console.watched import Watched
from foretouch.errors import ForetouchError
from foretouch.messages import FollowerSpace, LeaderSpace, fixture_of
from foretouch.models import FIELD_DEPTH, ScaleField, ShapeField
from foretouch.quantities.colours import BLUE, CUT, GREEN, GREY, INK, VERMILLION
from foretouch.quantities.pose import RigidMotion, Vector, add, subtract
from foretouch.rendering import Surface
from foretouch.robot import Tip

SPACE_CAMERA = ((-4.0, -50.0, 31.0), (-4.0, 0.0, 0.0))
"""First position of the camera and the point at which it looks [scene units]."""
NORMAL_LENGTH = 2.6  # [scene units]
MEASURES = Measures(per_newton=1.0, longest=8.0, least=0.02, beside=(1.2, 0.0), label=(1.8, 3.0))  # Style of the forces
HANDLE_SIZE = 4.0  # Length of its arrows [scene units]
APART = 0.002  # Distance of one probe past the other at which arrows and labels change sides [m]
HINT = "Drag the arrows: the hand goes along"
SPACE_INSTRUCTION = "Drag the arrows of the handle: down to press, along to slide."
CLEAR = 0.75  # Distance of the normal from the ball of a sphere [scene units]
NEAR = 0.006  # The normal is shown from here on [m]
BOARD_ALONE = np.zeros((1, 3))  # Text over an image where the shape of the specimen is not known here
LARGEST_DOUBT = 0.7  # Relative deviation of the stiffness up to which it is shown: up to 6 mm from a touch
NARROW, REACH = 2.5e-3, 16e-3
"""Width of a shallow dent, and where every dent ends [m]."""
THICKNESS = 0.012  # Thickness of specimen and board as they are drawn [m]
SMALLEST_CHANGE = 2e-5  # Smallest change of a dent that is drawn [m]
HALO, LARGEST_HALO = 2.0, 0.02
"""Number of standard deviations that the halo shows, and its largest size [m]."""


def sunk(
    vertices: Array, point: Sequence[float], normal: Sequence[float], depth: float, radius: float = 0.0
) -> tuple[Array, Array]:
    """Vertices [m] under a proxy [m] at a depth [m], and by how much each has sunk along the outward normal.

    A sphere of a radius [m], 0 for a point, sinks in as a whole, and the dent ends as far beyond it.
    """
    if not depth > 0.0:
        return vertices, np.zeros(len(vertices))
    square = ((vertices - np.asarray(point)) ** 2).sum(axis=1)
    sunken = shapes.sinking(square, depth, NARROW, REACH + radius, radius or TIP_RADIUS)
    return vertices - sunken[:, None] * np.asarray(normal), sunken


class FixtureView:
    """Board and specimen where the leader renders them, and an outline where the follower believes them.

    Attributes:
        edges: Those between the colours of what was learnt [N/m]; see `shapes.scale_edges`.
    """

    def __init__(self, scene: Any, surface: Surface) -> None:
        self._outline, faces = surface.outline()
        self._flat, self._faces = shapes.refined(self._outline, faces)
        self._vertices = self._flat  # as high as the surface is known to be
        self._shape: ShapeField | None = None  # of a surface whose shape is learnt
        self._heights: Array = np.zeros(0)  # numbers of that
        self._radius = surface.radius
        self._dent, self._normal = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        self._levels = np.zeros(len(self._faces), np.int64)
        self._touched = np.zeros(len(COLOURS) + 1, bool)
        self._parts: list[tuple[Any, Faces]] = []
        self._learnt: tuple[ScaleField | None, int, float] = None, 0, 0.0
        self.edges: Array = np.empty(0)
        self.root = scene.add_frame("/space/fixture", show_axes=False)
        self._believed = scene.add_frame("/space/believed", show_axes=False)
        nothing = (np.zeros((3, 3), np.float32), np.array([(0, 1, 2)], np.uint32))
        self._nodes = [
            scene.add_mesh_simple(f"/space/fixture/surface_{i}", *nothing, color=colour, side="double")
            for i, colour in enumerate((UNKNOWN, *COLOURS))
        ]
        self._walls: Any = None
        self._bottom = float(self._flat[:, 2].min()) - THICKNESS
        if len(shapes.boundary(faces)):
            self._walls = add_body(scene, "/space/fixture/walls", self._skirt(), CUT[0])
        self._rim = footprint(self._vertices) * UNITS
        _add_board(scene)
        ring = np.stack([self._rim, np.roll(self._rim, -1, axis=0)], axis=1).astype(np.float32)
        scene.add_line_segments("/space/fixture/rim", ring, GREY, thickness=1.5, **SCREEN)
        scene.add_line_segments("/space/believed/outline", ring, VERMILLION, thickness=2.0, **SCREEN)
        self._halo = add_body(scene, "/space/believed/halo", shapes.band(self._rim, 0.0), VERMILLION, opacity=0.18)
        self._halo_size = 0.0
        self._paint()

    def believe(self, pose: Sequence[float] | None, deviation: float) -> None:
        """Draw the follower's estimate of its pose [m, rad], None where unknown, with the position's deviation [m]."""
        self._believed.visible = pose is not None
        if pose is None:
            return
        _place(self._believed, pose)
        size = min(HALO * deviation, LARGEST_HALO) if math.isfinite(deviation) else 0.0
        if abs(size - self._halo_size) > 0.1 * max(self._halo_size, 5e-4):
            self._halo_size = size
            self._halo.vertices = shapes.band(self._rim, size * UNITS)[0]

    def rise(self, shape: ShapeField | None) -> None:
        """Draw the surface as high as its shape is known to be; None where that is given."""
        heights = np.zeros(0) if shape is None else shape.coefficients
        self._shape = shape
        if np.array_equal(heights, self._heights):
            return
        self._heights = heights.copy()
        self._vertices = self.raised(self._flat)
        if self._walls is not None:
            self._walls.vertices = self._skirt()[0]
        self._paint()

    def raised(self, points: Array) -> Array:
        """Points of the surface as it was given, shape (n, 3) [m], where they are known to be."""
        if self._shape is None:
            return points
        return points + np.outer(self._shape.heights_at(points)[0], (0.0, 0.0, 1.0))

    @property
    def corners(self) -> Array:
        """Those of the surface as it is known, shape (n, 3) [m]."""
        return self.raised(self._outline)

    def learn(self, field: ScaleField | None, stiffness: float) -> None:
        """Colour the surface by what was learnt, with the law's local stiffness [N/m]; None begins the scale anew."""
        learnt = field, 0 if field is None else field.messages, stiffness
        if learnt == self._learnt:
            return
        self._learnt = learnt
        levels = np.zeros(len(self._faces), np.int64)
        if field is None:
            self.edges = np.empty(0)
        else:
            scales, deviations = field.scales_at(self._vertices[self._faces].mean(axis=1))
            known = deviations <= LARGEST_DOUBT
            self.edges = shapes.scale_edges(self.edges, stiffness * scales[known])
            levels = shapes.levels_of(self.edges, stiffness * scales, known)
        if not np.array_equal(levels, self._levels):
            self._levels = levels
            self._paint()

    def sink(self, pose: Sequence[float], point: Vector, normal: Vector, depth: float) -> None:
        """Dent the rendered surface at the proxy [m], along the outward normal, both in the world, to a depth [m]."""
        motion = RigidMotion.from_numbers(pose)
        dent = (*motion.apply_back(point), depth) if 0.0 < depth < math.inf else (0.0, 0.0, 0.0, 0.0)
        if max(abs(a - b) for a, b in zip(dent, self._dent, strict=True)) < SMALLEST_CHANGE:
            return
        self._dent, self._normal = dent, motion.rotate_back(normal)
        vertices, sinking = self._bent(self._vertices)
        bent = sinking > SMALLEST_CHANGE
        for index, (node, used) in enumerate(self._parts):  # those are sent that are bent, or were
            touched = bool(bent[used].any())
            if touched or self._touched[index]:
                node.vertices = (vertices[used] * UNITS).astype(np.float32)
            self._touched[index] = touched

    def bend(self, vertices: Array) -> Array:
        """Vertices on the surface [m] where the dent takes them."""
        return self._bent(vertices)[0]

    def _bent(self, vertices: Array) -> tuple[Array, Array]:
        return sunk(vertices, self._dent[:3], self._normal, self._dent[3], self._radius)

    def _skirt(self) -> Mesh:
        walls, triangles = shapes.skirt(self._vertices, self._faces, self._bottom)
        return walls * UNITS, triangles

    def _paint(self) -> None:
        vertices = self.bend(self._vertices)
        self._parts = []
        for level, node in enumerate(self._nodes):
            used, triangles = shapes.compacted(self._faces[self._levels == level])
            node.visible = len(triangles) > 0
            if len(triangles):
                node.vertices, node.faces = (vertices[used] * UNITS).astype(np.float32), triangles
            self._parts.append((node, used))
        self._touched[:] = self._dent[3] > 0.0


def _add_board(scene: Any) -> None:
    half, offset, side = 0.5 * BOARD * UNITS, 0.002 * UNITS, MARKER * UNITS
    slab = shapes.box((-half, -half, -THICKNESS * UNITS), (half, half, 0.0))
    add_body(scene, "/space/fixture/board", slab, (250, 250, 250))
    corners = [(x, y) for x in (-offset - side, offset) for y in (-offset - side, offset)]
    squares = [shapes.box((x, y, 0.0), (x + side, y + side, 0.02)) for x, y in corners]
    vertices = np.concatenate([vertices for vertices, _ in squares])
    faces = np.concatenate([faces + 8 * number for number, (_, faces) in enumerate(squares)])
    add_body(scene, "/space/fixture/markers", (vertices, faces.astype(np.uint32)), INK)


def _place(node: Any, pose: Sequence[float]) -> None:
    x, y, z = (UNITS * value for value in pose[:3])
    for name, value in (("position", (x, y, z)), ("wxyz", shapes.wxyz_of(pose[3:]))):
        if tuple(getattr(node, name)) != value:
            setattr(node, name, value)


class SpaceScene:
    """The picture of one scene: what is touched, the probes, and the handle, whose drags move the hand.

    Attributes:
        ahead: Prediction ahead of the hand; None where it does not move over the surface, or nothing was learnt.
    """

    def __init__(self, server: Any, surface: Surface, hold: SpaceHold) -> None:
        self._hold, self._tip = hold, Tip.of(surface.radius * UNITS, shapes.TIP_RADIUS)
        self._lift = 0.0, 0.0, surface.radius  # of the handle, above where it is for a point
        scene = server.scene
        self.root = scene.add_frame("/space", show_axes=False)
        self.fixture = FixtureView(scene, surface)
        self.ahead: Ahead | None = None
        self._outlook, self._ribbon = Outlook(surface), Ribbon(scene, "/space/fixture")
        self.probes = Probes(scene, "/space", GREY, MEASURES, self._tip)
        self._normal = add_body(scene, "/space/normal", shapes.arrow(NORMAL_LENGTH), GREEN)
        up = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], np.float32)
        self._tether = scene.add_line_segments("/space/tether", up, BLUE, thickness=1.5, **SCREEN)
        self._handle = scene.add_transform_controls(
            "/space/handle", scale=HANDLE_SIZE, line_width=5.0, disable_rotations=True, depth_test=False
        )
        self._handle.on_update(self._dragged)
        self._hint = scene.add_label("/space/labels/handle", HINT, anchor="bottom-center", font_screen_scale=1.3)

    def draw(self, watched: Watched) -> None:
        """Draw the fixture, where both sides believe it, with what was learnt of it, and the probes."""
        leader, space, fixture = watched.leader_space, watched.space, self.fixture
        pose = fixture_of(leader)
        _place(fixture.root, pose)
        law = None if watched.model is None else figures_of(watched.model, FIELD_DEPTH)
        field = None if law is None else space.field(watched.telemetry_sequence)
        fixture.rise(space.shape(watched.telemetry_sequence))
        fixture.learn(field, law.stiffness if law else 0.0)
        point = leader.point_x, leader.point_y, leader.point_z
        normal = leader.normal_x, leader.normal_y, leader.normal_z
        fixture.sink(pose, point, normal, leader.depth)
        self._outlook.follow(RigidMotion.from_numbers(pose).apply_back(point))
        self.ahead = self._outlook.look(field, law, fixture.raised) if leader.depth > -NEAR else None
        self._ribbon.draw(self.ahead, fixture.edges, fixture.bend)
        deviation = math.nan if space.belief is None else math.hypot(*space.belief.deviation[:3])
        believed = None if watched.telemetry is None else watched.telemetry.space
        fixture.believe(None if believed is None else fixture_of(believed), deviation)
        here = _scene(point)
        self._normal.visible = leader.depth > -NEAR and here is not None
        if self._normal.visible and here is not None:
            before = max(MEASURES.beside[0], self._tip.radius + CLEAR)  # the probe, where it hides nothing
            self._normal.position = (here[0], here[1] - before, here[2])
            self._normal.wxyz = along(normal)
        deviation = math.nan if watched.leader is None else watched.leader.standard_deviation
        robot = space.follower_at(watched.telemetry_sequence)
        self.draw_probes((leader.place_x, leader.place_y, leader.place_z), _force(leader), deviation, robot)

    def draw_probes(self, position: Vector, force: Vector, deviation: float, robot: FollowerSpace | None) -> None:
        """Draw the probe [m] with the rendered force and its deviation [N], and the delayed robot; None hides it."""
        if robot is not None and abs(position[0] - robot.place_x) >= APART:
            self.probes.keep_apart(position[0] - robot.place_x)
        self.probes.draw_probe(_scene(position), force, deviation)
        if robot is None:
            self.probes.draw_robot(None, (0.0, 0.0, 0.0))
        else:
            self.probes.draw_robot(_scene((robot.place_x, robot.place_y, robot.place_z)), _force(robot))

    def draw_handle(self, leader: LeaderSpace, *, offered: bool, useful: bool) -> None:
        """Draw the handle, which stays where a browser holds it, a line to the probe, and what to do."""
        here, end = _scene(add(self._hold.handle, self._lift)), _scene((leader.place_x, leader.place_y, leader.place_z))
        for node, shown in ((self._handle, offered), (self._tether, offered and end is not None)):
            put(node, visible=shown)
        self._hint.visible = offered and useful and not self._hold.used
        if here is None or not offered:
            return
        if not self._hold.dragged and not np.allclose(self._handle.position, here, atol=1e-4):
            self._handle.position = here
        self._hint.position = (here[0], here[1], here[2] + 1.15 * HANDLE_SIZE)
        if end is not None:
            way = (end[0] - here[0], end[1] - here[1], end[2] + shapes.rod_end(self._tip) - here[2])
            self._tether.position, self._tether.wxyz = here, along(way)
            self._tether.scale = (1.0, 1.0, max(math.hypot(*way), 1e-3))

    async def _dragged(self, event: Any) -> None:
        x, y, z = (float(value) / UNITS for value in event.target.position)
        self._hold.drag_to(subtract((x, y, z), self._lift), str(event.phase))


def _scene(position: Vector) -> Vector | None:
    x, y, z = position
    return (UNITS * x, UNITS * y, UNITS * z) if math.isfinite(x + y + z) else None


def _force(space: LeaderSpace | FollowerSpace) -> Vector:
    """In all directions, friction's too [N]."""
    return space.force_x, space.force_y, space.force_z


class SpaceView:
    """Display of a session in three dimensions; made when the first such session is looked at.

    Attributes:
        problem: Reason that the picture of the scene is not drawn, in a sentence; "" where it is.
    """

    camera, instruction = SPACE_CAMERA, SPACE_INSTRUCTION

    def __init__(self, server: Any, panel: Panel, hold: SpaceHold) -> None:
        self._server, self._panel, self._image = server, panel, panel.image
        self.hold, self.problem = hold, ""
        self._scene: SpaceScene | None = None
        self._fixture: SpacePanel | None = None
        self._name: tuple[str, float] = "", 0.0
        self._offered = False  # whether anybody listens to the handle
        self._legend = server.gui.add_html("")

    def show(self, shown: bool) -> None:
        """Show the picture, or hide it: no key moves the hand then."""
        self._offered = False
        self._image.show(shown)
        put(self._legend, content="")
        if self._scene is not None:
            self._scene.root.visible = shown

    def draw(self, shown: Watched, *, live: bool, useful: bool) -> None:
        """Draw the scene; see `LineView.draw`."""
        self._offered = live and shown.operator == "browser"
        self._find_scene(shown)
        self.hold.follow()
        if self._scene is not None:
            self._scene.draw(shown)
            self._scene.draw_handle(shown.leader_space, offered=self._offered, useful=useful)

    def depth(self, shown: Watched) -> float:
        """See `LineView.depth`."""
        return shown.leader_space.depth

    @property
    def ahead(self) -> Row | None:
        """What is predicted ahead of the hand."""
        ahead = None if self._scene is None else self._scene.ahead
        return Row(AHEAD, "–") if ahead is None else ahead.row()

    def plot(self, shown: Watched) -> None:
        """Draw the image of the camera beside it."""
        self._image.draw(shown, BOARD_ALONE if self._scene is None else self._scene.fixture.corners)

    def write(self, shown: Watched, now: float) -> None:
        """Numbers, labels, plots and legend."""
        if self._fixture is not None:
            self._fixture.draw(shown, SECONDS, now, self.hold.hand if self._offered else None)
        if self._scene is not None:
            put(self._legend, content=shapes.legend_html(self._scene.fixture.edges, arm=bool(shown.joints)))
            robot = shown.space.follower_at(shown.telemetry_sequence)
            self._scene.probes.write("rendered force", "" if robot is None else "delayed robot")

    def _find_scene(self, shown: Watched) -> None:
        """Another scene has another picture; none where its shape is not known here."""
        name = shown.settings.get("scene", ""), shown.probe_radius
        if not name[0] or name == self._name:
            return
        from foretouch.session.spatial import make_scene

        if self._scene is not None:
            self._server.scene.remove_by_name("/space")
            put(self._legend, content="")
        self._name, self._scene, self.problem = name, None, ""
        try:
            surface = make_scene(*name).surface
        except (ForetouchError, OSError) as error:  # a mesh that only the other machine has, or nothing to read it with
            self.problem = f"The scene cannot be drawn here: {error}"
        else:
            self._scene = SpaceScene(self._server, surface, self.hold)
        if self._fixture is None:
            with self._panel.tabs.add_tab("Fixture"):
                self._fixture = SpacePanel(self._server.gui, self._slide)
            self._panel.name_keys(SPACE_HELP)
            strokes = [(*key, partial(self._key_stroke, way)) for key, way in SPACE_STROKES.items()]
            overlay = ("Probe over image", "O", lambda event: self._image.toggle_overlay())
            add_keys(self._server.gui, *strokes, overlay)

    def _slide(self, axis: int, value: float) -> None:
        x, y, z = (value - here if other == axis else 0.0 for other, here in enumerate(self.hold.hand))
        self.hold.stroke((x, y, z))

    def _key_stroke(self, way: Vector, event: Any = None) -> None:
        if self._offered:
            self.hold.stroke(way)
