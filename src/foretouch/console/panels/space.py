"""What is known of the fixture: its pose and how surely, friction, local stiffness; and the handle's sliders."""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.console.plots import Curve, Row, TimePlot, number, put, table
from foretouch.console.space_heard import PoseTrace
from foretouch.console.watched import Watched
from foretouch.messages import FixtureBelief, LeaderSpace
from foretouch.quantities.colours import BLUE, INK, VERMILLION, css

PLACE = Curve("Deviation of its position", BLUE, 2.0)
TURN = Curve("Deviation of its rotation", VERMILLION, 2.0, "dashed")
AGE = Curve("Since an image showed it", INK, 2.0)
AGED = 0.5
"""An older pose is worth a sentence [s]."""
CAMERA_SILENT = 1.0
"""The tracker of the fixture speaks thirty times a second; it is gone when nothing has come for this time [s]."""
MOST_AGE = 60.0
SLIDERS = ("Hand to the right, x [mm]", "Hand away, y [mm]", "Hand up, z [mm]")
HALF_RANGE = 100.0
"""[mm]."""
SMALLEST_MOVE = 0.3
"""A slider follows the hand by steps of this [mm]."""


class SpacePanel:
    """Numbers and plots of the fixture.

    Args:
        gui: The viewer's user interface.
        on_move: Called with an axis, 0 to 2, and where along it the hand is to be [m].
    """

    def __init__(self, gui: Any, on_move: Callable[[int, float], None]) -> None:
        self._on_move = on_move
        self._text = gui.add_html("")
        self._pose = TimePlot(gui, "Deviation of the pose [mm] and [degrees]", (PLACE, TURN), height=120)
        self._age = TimePlot(gui, "Since an image showed the fixture [s]", (AGE,), height=100)
        self._sliders = [
            gui.add_slider(label, -HALF_RANGE, HALF_RANGE, 0.5, 0.0, hint="Moves the hand; let go after 1 s")
            for label in SLIDERS
        ]
        for axis, slider in enumerate(self._sliders):
            slider.on_update(self._mover(axis))

    def draw(self, watched: Watched, seconds: float, now: float, hand: tuple[float, float, float] | None) -> None:
        """Draw and write what is known.

        Args:
            watched: The session, or a recording.
            seconds: Time span of the plots [s].
            now: Time by the clock of reception [s].
            hand: Requested position of the hand [m]; None without a request.
        """
        trace = watched.space.pose_trace(seconds)
        self._plot(trace)
        self._follow(hand)
        leader = watched.space.leader
        if leader is None:
            return
        rows = _rows(leader, watched.space.belief)
        said = pose_sentence(watched, now)
        colour = css(VERMILLION) if leader.fixture_age > AGED else "#555"
        sentence = f'<div style="color:{colour};line-height:1.35;padding-bottom:2px"><b>{html.escape(said)}</b></div>'
        text = f'<div style="padding:0 12px">{sentence}{table(rows)}</div>'
        put(self._text, content=text)

    def _plot(self, trace: PoseTrace) -> None:
        self._pose.draw(trace.time, (trace.deviation * 1e3, trace.turn * (180.0 / math.pi)))
        age = np.where(np.isfinite(trace.age), trace.age, math.nan)  # never seen is no age
        self._age.draw(trace.time, (age,), most=MOST_AGE)

    def _follow(self, hand: tuple[float, float, float] | None) -> None:
        """Put the sliders where the hand is, without telling anybody."""
        for axis, slider in enumerate(self._sliders):
            put(slider, disabled=hand is None)
            if hand is None or not math.isfinite(hand[axis]):
                continue
            value = min(max(round(2e3 * hand[axis]) / 2.0, -HALF_RANGE), HALF_RANGE)
            if abs(slider.value - value) > SMALLEST_MOVE:
                slider.value = value

    def _mover(self, axis: int) -> Callable[[Any], Any]:
        async def moved(event: Any) -> None:
            if event.client is not None:  # None: the program set it
                self._on_move(axis, float(event.target.value) * 1e-3)

        return moved


def pose_sentence(watched: Watched, now: float) -> str:
    """Uncertainty of the fixture's pose, in a sentence.

    Args:
        watched: The session, or a recording.
        now: Time by the clock of reception [s].
    """
    leader, belief = watched.space.leader, watched.space.belief
    silence = watched.space.camera_silence(now)
    if leader is None:
        return ""
    if watched.settings.get("fusion") == "none":
        return "The fixture is believed where it was expected: nothing is tracked (--fusion none)."
    if belief is not None and silence > CAMERA_SILENT:
        return f"The camera's side has been silent for {silence:.1f} s: the pose stays as it was."
    if belief is None:
        return "Nobody tracks the fixture yet: it is believed where it was expected."
    if watched.settings.get("camera") == "there is none":
        return f"No camera: {belief.reason}."
    if leader.fixture_age > AGED and math.isfinite(leader.fixture_age):
        return f"The board was last seen {leader.fixture_age:.1f} s before that pose was sent: it gets less certain."
    return f"{belief.reason[:1].upper()}{belief.reason[1:].rstrip('.')}."


def _rows(leader: LeaderSpace, belief: FixtureBelief | None) -> list[Row]:
    turn = leader.fixture_turn * 180.0 / math.pi
    used = ("–", "–") if belief is None else (f"{belief.images} / {belief.contacts}", f"{belief.refused}")
    return [
        Row("Deviation of the fixture's position", number(leader.fixture_deviation * 1e3, "mm"), PLACE),
        Row("Deviation of its rotation", number(turn, "°"), TURN),
        Row(AGE.name, number(leader.fixture_age, "s", 1), AGE),
        Row("Images / touches used", used[0]),
        Row("Images and touches refused", used[1]),
        Row(
            "Force on the hand, with friction", number(math.hypot(leader.force_x, leader.force_y, leader.force_z), "N")
        ),
        Row("Friction, Coulomb", number(leader.friction, "")),
        Row("Local stiffness here, rendered", number(leader.stiffness, "N/m", 0)),
    ]
