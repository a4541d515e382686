"""A session in three dimensions in the console: fixture, virtual probe, delayed robot, forces, handle and panels."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from foretouch.console.panels.space import ImagePanel, SpacePanel
from foretouch.console.panels.stop import add_space_keys
from foretouch.console.plots import SECONDS, put
from foretouch.console.space_heard import fixture_of
from foretouch.console.views import shapes
from foretouch.console.views.fixture import FixtureView, legend_html
from foretouch.console.views.hold import SpaceHold
from foretouch.console.views.line import CAMERA, look
from foretouch.console.views.probes import UNITS, Measures, Probes
from foretouch.console.views.shapes import add_body, along
from foretouch.console.watched import Watched
from foretouch.errors import ForetouchError
from foretouch.messages import FieldUpdate, FollowerSpace, LeaderSpace
from foretouch.models import MaterialField
from foretouch.quantities.colours import BLUE, GREEN, GREY, VERMILLION, css
from foretouch.quantities.pose import Vector
from foretouch.rendering import Surface

SPACE_CAMERA = ((-4.0, -50.0, 31.0), (-4.0, 0.0, 0.0))
"""Where the camera is at first and what it looks at [scene units]."""
NORMAL_LENGTH = 2.6
"""[scene units]."""
MEASURES = Measures(per_newton=1.0, longest=8.0, least=0.02, beside=(1.2, 0.0), label=(1.8, 1.2))
"""How forces are shown."""
HANDLE_SIZE = 4.0
"""Length of its arrows [scene units]."""
APART = 0.002
"""Distance of one probe past the other at which arrows and labels change sides [m]."""
HINT = "Drag the arrows: the hand goes along"
SPACE_INSTRUCTION = "Drag the arrows of the handle: down to press, along to slide."
NEAR = 0.006
"""The normal is shown from here on [m]."""
BOARD_ALONE = np.zeros((1, 3))
"""What is drawn over an image where the shape of the specimen is not known here."""


class SpaceScene:
    """The viewer's scene in space: the world's frame, `UNITS` to the metre.

    Args:
        server: The viewer's server.
        surface: What is touched, in the fixture's frame.
        on_drag: Called with the handle's position in the world [m] and ``"start"``, ``"update"`` or ``"end"``, from the
            viewer's thread. A browser that is gone lets go.

    Attributes:
        fixture: Its rendered and its estimated pose, and the learnt materials.
    """

    def __init__(self, server: Any, surface: Surface, on_drag: Callable[[Vector, str], None]) -> None:
        self._on_drag = on_drag
        scene = server.scene
        self._root = scene.add_frame("/space", show_axes=False)
        self.fixture = FixtureView(scene, surface, UNITS)
        self.probes = Probes(scene, "/space", GREY, MEASURES)
        self._normal = add_body(scene, "/space/normal", shapes.arrow(NORMAL_LENGTH), GREEN)
        up = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], np.float32)
        self._tether = scene.add_line_segments("/space/tether", up, BLUE, thickness=1.5, thickness_units="screen")
        self._handle = scene.add_transform_controls(
            "/space/handle", scale=HANDLE_SIZE, line_width=5.0, disable_rotations=True, depth_test=False
        )
        self._handle.on_update(self._dragged)
        self._hint = scene.add_label("/space/labels/handle", HINT, anchor="bottom-center", font_screen_scale=1.3)

    def show(self, shown: bool) -> None:
        """Show it all, or hide it."""
        put(self._root, visible=shown)

    def draw_probes(self, place: Vector, force: Vector, deviation: float, robot: FollowerSpace | None) -> None:
        """Draw the probe [m] with the rendered force and its deviation [N], and the delayed robot; None hides it."""
        if robot is not None and abs(place[0] - robot.place_x) >= APART:
            self.probes.keep_apart(place[0] - robot.place_x)
        self.probes.draw_probe(_scene(place), force, deviation)
        if robot is None:
            self.probes.draw_robot(None, (0.0, 0.0, 0.0))
        else:
            self.probes.draw_robot(_scene((robot.place_x, robot.place_y, robot.place_z)), _force(robot))

    def draw_normal(self, point: Vector, normal: Vector, shown: bool) -> None:
        """Draw the surface's outward normal at the proxy [m], where the probe is near enough for it to matter."""
        here = _scene(point)
        self._normal.visible = shown and here is not None
        if here is not None and shown:
            self._normal.position = (here[0], here[1] - MEASURES.beside[0], here[2])
            self._normal.wxyz = along(normal)

    def draw_handle(self, place: Vector, probe: Vector, *, offered: bool, held: bool, hinted: bool) -> None:
        """Draw the handle [m], which stays where a browser holds it, a line to the probe [m], and what to do."""
        end = _scene(probe)
        for node, shown in ((self._handle, offered), (self._tether, offered and end is not None)):
            put(node, visible=shown)
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

    async def _dragged(self, event: Any) -> None:
        """A drag of the handle: async, so that the viewer keeps the order of start, moves and end."""
        x, y, z = (float(value) / UNITS for value in event.target.position)
        self._on_drag((x, y, z), str(event.phase))


def _scene(place: Sequence[float]) -> Vector | None:
    """A position in the world [m] in scene units; None where it is not finite."""
    x, y, z = place
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return None
    return UNITS * x, UNITS * y, UNITS * z


class SpaceView:
    """Display of a session in three dimensions; made when the first such session is looked at.

    Attributes:
        problem: Why the picture of the scene is not drawn, in a sentence; "" where it is.
    """

    def __init__(self, server: Any, image: ImagePanel, tabs: Any, hold: SpaceHold) -> None:
        self._server, self._image, self._tabs = server, image, tabs
        self.hold, self.problem = hold, ""
        self._scene: SpaceScene | None = None
        self._panel: SpacePanel | None = None
        self._name = ""
        self._surface: Surface | None = None
        self._offered = False  # whether anybody listens to the handle
        self._looked_at = False  # whether the cameras are where this picture is seen
        self._field: tuple[FieldUpdate | None, MaterialField | None] = (None, None)
        self._legend = server.gui.add_html("")

    def draw(self, watched: Watched, *, live: bool, useful: bool) -> bool:
        """Draw the scene; False, and nothing is shown, where the session is one along a line."""
        leader = watched.space.leader
        self._offered = leader is not None and live and watched.operator == "browser"
        self._image.show(leader is not None)
        self._look(leader is not None)
        if leader is None:
            if self._scene is not None:
                self._scene.show(False)
            self._write_legend("")
            return False
        scene = self._scene_of(watched)
        self.hold.follow()
        if scene is None:
            self._write_legend("")
            return True
        scene.show(True)
        self._draw_fixture(scene, watched, leader)
        self._draw_probes(scene, watched, leader)
        probe = leader.place_x, leader.place_y, leader.place_z
        held, hinted = self.hold.dragged, useful and not self.hold.used
        scene.draw_handle(self.hold.place, probe, offered=self._offered, held=held, hinted=hinted)
        return True

    def draw_image(self, watched: Watched) -> None:
        """Draw the camera's image."""
        if watched.in_space:
            self._image.draw(watched, BOARD_ALONE if self._surface is None else self._surface.outline()[0])

    def write(self, watched: Watched, now: float, *, live: bool) -> None:
        """Numbers, labels, plots and legend."""
        leader, scene = watched.space.leader, self._scene
        if leader is None or self._panel is None:
            return
        self._panel.draw(watched, SECONDS, now, self.hold.hand if live and watched.operator == "browser" else None)
        if scene is None:
            return
        self._write_legend(legend_html(scene.fixture.scale.edges) + _KEY)
        robot = watched.space.heard(watched.heard_sequence)
        scene.probes.write("rendered force", "" if robot is None else "delayed robot")

    def _look(self, in_space: bool) -> None:
        """Move the cameras where sessions along a line and in space, live or recorded, take turns."""
        if in_space != self._looked_at:
            self._looked_at = in_space
            look(self._server, SPACE_CAMERA if in_space else CAMERA)

    def _scene_of(self, watched: Watched) -> SpaceScene | None:
        """The picture of this scene; another scene has another. None where its shape is not known here."""
        name = watched.settings.get("scene", "")
        if not name or name == self._name:
            return self._scene
        from foretouch.session.spatial import make_scene

        if self._scene is not None:
            self._server.scene.remove_by_name("/space")
        self._name, self._scene, self._surface, self.problem = name, None, None, ""
        try:
            self._surface = make_scene(name).surface
        except (ForetouchError, OSError) as error:  # a mesh that only the other machine has, or nothing to read it with
            self.problem = f"The scene cannot be drawn here: {error}"
        else:
            self._scene = SpaceScene(self._server, self._surface, self.hold.drag_to)
        if self._panel is None:
            with self._tabs.add_tab("Fixture"):
                self._panel = SpacePanel(self._server.gui, self._slide)
            add_space_keys(self._server.gui, self._key_stroke, self._image.toggle_overlay)
        return self._scene

    def _draw_fixture(self, scene: SpaceScene, watched: Watched, leader: LeaderSpace) -> None:
        fixture, pose = scene.fixture, fixture_of(leader)
        fixture.place(pose)
        fixture.learn(self._learnt(watched))
        point, normal = _point(leader), (leader.normal_x, leader.normal_y, leader.normal_z)
        fixture.sink(pose, point, normal, leader.depth)
        follower, belief = watched.space.follower, watched.space.belief
        deviation = math.nan if belief is None else math.sqrt(sum(value**2 for value in belief.deviation[:3]))
        fixture.believe(None if follower is None else fixture_of(follower), deviation)
        scene.draw_normal(point, normal, leader.depth > -NEAR)

    def _draw_probes(self, scene: SpaceScene, watched: Watched, leader: LeaderSpace) -> None:
        deviation = math.nan if watched.leader is None else watched.leader.standard_deviation
        place = leader.place_x, leader.place_y, leader.place_z
        scene.draw_probes(place, _force(leader), deviation, watched.space.heard(watched.heard_sequence))

    def _learnt(self, watched: Watched) -> MaterialField | None:
        """The field as the operator's side has it; each is read once."""
        update = watched.space.field(watched.heard_sequence)
        if update is not self._field[0]:
            field = None
            if update is not None:
                try:
                    field = MaterialField.from_bytes(update.content)
                except ForetouchError:  # of another version
                    field = None
            self._field = (update, field)
        return self._field[1]

    def _write_legend(self, content: str) -> None:
        put(self._legend, content=_LEGEND.format(content) if content else "")

    def _slide(self, axis: int, value: float) -> None:
        way = [0.0, 0.0, 0.0]
        way[axis] = value - self.hold.hand[axis]
        self.hold.stroke((way[0], way[1], way[2]))

    def _key_stroke(self, way: Vector) -> None:
        if self._offered:
            self.hold.stroke(way)


def _force(space: LeaderSpace | FollowerSpace) -> Vector:
    """In all directions, friction's too [N]."""
    return space.force_x, space.force_y, space.force_z


def _point(leader: LeaderSpace) -> Vector:
    return leader.point_x, leader.point_y, leader.point_z


def _key() -> str:
    """What the lines and arrows of the picture are."""
    rows = (
        (GREY, "Probe, now: where your hand is"),
        (VERMILLION, "Robot, delayed; outline: the fixture as the robot knows it"),
        (BLUE, "Force on the hand, and its uncertainty"),
        (GREEN, "Normal of the surface"),
    )
    lines = (
        f'<div><span style="color:{css(colour)}">&#9632;</span> {html.escape(text)}</div>' for colour, text in rows
    )
    return f'<div style="padding-top:5px;line-height:1.3">{"".join(lines)}</div>'


_KEY = _key()
_LEGEND = (
    "<div><style>@media (max-width:36em){{.foretouch-legend{{display:none}}}}</style></div>"  # it would hide the scene
    '<div class="foretouch-legend" style="position:fixed;left:12px;top:84px;z-index:50;pointer-events:none;'
    "background:rgba(255,255,255,0.9);"
    'color:#000;border:1px solid #999;border-radius:6px;padding:6px 10px;font-size:13px">{}</div>'
)
