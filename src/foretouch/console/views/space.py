"""A session in three dimensions in the console: its picture, its panels and its handle.

The handle is dragged, moved by keys and sliders, and let go.
"""

from __future__ import annotations

import html
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from foretouch.console.panels.image import ImagePanel
from foretouch.console.panels.keys import add_space_keys
from foretouch.console.panels.network import Speech
from foretouch.console.panels.space import SpacePanel
from foretouch.console.plots import SECONDS
from foretouch.console.space_heard import fixture_of
from foretouch.console.views.line import STROKE, Hold
from foretouch.console.views.scene import CAMERA, look
from foretouch.console.views.space_scene import SPACE_CAMERA, SpaceScene
from foretouch.console.views.stiffness_colours import legend_html
from foretouch.console.watched import Watched
from foretouch.errors import ForetouchError
from foretouch.messages import FieldUpdate, FollowerSpace, LeaderSpace
from foretouch.models import MaterialField
from foretouch.quantities.colours import BLUE, GREEN, GREY, VERMILLION, css
from foretouch.quantities.pose import Vector, add, scaled, subtract
from foretouch.rendering import Surface

HOME: Vector = (0.0, 0.0, 0.042)
"""Where the handle stands while a script moves the hand [m]: one that moves along is hard to catch."""
REACH = 0.1
"""The hand goes no further from the world's origin, along any axis [m]."""
RESTS = 3.0
"""A handle that was let go stays where it is for so long [s], as the hand does."""


class SpaceHold(Hold):
    """Where the handle is in space, who holds it, and where it asks the hand to be.

    A drag moves the hand by as much as the handle is moved, from where the hand was when the handle was taken; so the
    handle need not be at the hand.

    Args:
        watched: What is heard of the session.
        speech: Says where the handle is.

    Attributes:
        place: Of the handle as drawn, in the world [m].
        hand: Where it asks the hand to be, in the world [m].
    """

    def __init__(self, watched: Watched, speech: Speech) -> None:
        super().__init__(watched, speech)
        self.place: Vector = HOME
        self.hand: Vector = HOME
        self._released = -math.inf

    @property
    def dragged(self) -> bool:
        """Whether it is held by a mouse, and not moved by keys or sliders."""
        return self.held and self._let_go == math.inf

    def drag_to(self, place: Sequence[float], phase: str) -> None:
        """The handle was taken, dragged to a place [m], or let go there.

        Args:
            place: Of the handle in the world [m].
            phase: ``"start"``, ``"update"`` or ``"end"``.
        """
        x, y, z = (float(value) for value in place)
        with self._lock:
            if phase == "start":
                self.follow()
            self.held, self.used = phase != "end", True
            self._released = time.monotonic()
            self._let_go = math.inf
            self._move(subtract((x, y, z), self.place))

    def stroke(self, way: Vector) -> None:
        """A key or a slider moves the hand by a way [m]; it is let go a second after the last one."""
        with self._lock:
            self.follow()
            self.held, self.used = True, True
            self._let_go = time.monotonic() + STROKE
            self._move(way)

    def follow(self) -> None:
        """While nobody holds it: the handle stands at home, and the hand is where it wants to be."""
        with self._lock:
            now = time.monotonic()
            if self.held:
                self._released = now
                return
            if now - self._released > RESTS:
                self.place = HOME
            space, leader = self._watched.space.leader, self._watched.leader
            if space is None or not math.isfinite(space.hand_x):
                return
            self.hand = space.hand_x, space.hand_y, space.hand_z
            if leader is None or not math.isfinite(leader.intended_position - leader.hand_position):
                return
            ahead = self._watched.scale * (leader.intended_position - leader.hand_position)
            self.hand = add(self.hand, scaled((space.normal_x, space.normal_y, space.normal_z), -ahead))

    def _move(self, way: Vector) -> None:
        self.place = add(self.place, way)
        x, y, z = add(self.hand, way)
        self.hand = _within(x, -REACH), _within(y, -REACH), _within(z, self._lowest())
        self._say()

    def _lowest(self) -> float:
        """The hand goes no lower [m]: below what it touches by as much as along a line."""
        space, watched = self._watched.space.leader, self._watched
        touched = 0.0 if space is None or not math.isfinite(space.point_z) else space.point_z
        return max(touched - (watched.deepest - watched.surface), -REACH)

    def _say(self) -> None:
        self._sent = time.monotonic()
        self._speech.handle(0.0, held=self.held, clutched=self.clutched, place=self.hand)


def _within(value: float, least: float) -> float:
    return min(max(value, least), REACH)


SPACE_INSTRUCTION = "Drag the arrows of the handle: down to press, along to slide."
NEAR = 0.006
"""The normal is shown from here on [m]."""
BOARD_ALONE = np.zeros((1, 3))
"""What is drawn over an image where the shape of the specimen is not known here."""


class SpaceView:
    """What a console shows of a session in three dimensions; made when the first such session is looked at.

    Args:
        server: The viewer's server.
        image: The camera's panel.
        tabs: Of the panel; one more is added.
        hold: The handle in space.

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
        """Draw the scene; False, and nothing is shown, where the session is one along a line.

        Args:
            watched: The session, or a recording.
            live: Whether a person can move the hand in it.
            useful: Whether the robot goes along then.
        """
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
        """Numbers, labels, plots and legend.

        Args:
            watched: The session, or a recording.
            now: By the clock that it was heard by [s].
            live: Whether a person can move the hand in it.
        """
        leader, scene = watched.space.leader, self._scene
        if leader is None or self._panel is None:
            return
        self._panel.draw(watched, SECONDS, now, self.hold.hand if live and watched.operator == "browser" else None)
        if scene is None:
            return
        self._write_legend(legend_html(scene.fixture.scale.edges) + _KEY)
        robot = watched.space.heard(watched.heard_sequence)
        scene.label("rendered force", "" if robot is None else "delayed robot")

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
            self._scene = SpaceScene(self._server, self._surface, self._dragged)
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
        state, robot = watched.leader, watched.space.heard(watched.heard_sequence)
        if robot is not None:
            scene.keep_apart(leader.place_x, robot.place_x)
        deviation = math.nan if state is None else state.standard_deviation
        scene.draw_probe((leader.place_x, leader.place_y, leader.place_z), _force(leader), deviation)
        if robot is None:
            scene.draw_robot(None, (0.0, 0.0, 0.0))
        else:
            scene.draw_robot((robot.place_x, robot.place_y, robot.place_z), _force(robot))

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
        html_text = _LEGEND.format(content) if content else ""
        if self._legend.content != html_text:
            self._legend.content = html_text

    def _dragged(self, place: Vector, phase: str) -> None:
        self.hold.drag_to(place, phase)

    def _slide(self, axis: int, value: float) -> None:
        way = [0.0, 0.0, 0.0]
        way[axis] = value - self.hold.hand[axis]
        self._stroke((way[0], way[1], way[2]))

    def _key_stroke(self, way: Vector) -> None:
        if self._offered:
            self._stroke(way)

    def _stroke(self, way: Vector) -> None:
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
        (BLUE, "Force on the hand, and its doubt"),
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
