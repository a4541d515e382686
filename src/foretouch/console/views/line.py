"""A session along a line in the console: its picture and its handle.

The handle is dragged by a mouse, moved by strokes of keys, and let go by whoever is gone.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any

from foretouch.console.panels.network import Speech
from foretouch.console.views.scene import UNITS, Scene
from foretouch.console.views.shapes import HANDLE_HEIGHT
from foretouch.console.watched import Watched

KEEP_ALIVE = 0.1
"""A held handle says where it is at least this often [s], so that silence means a lost browser."""
STROKE = 1.0
"""A hand that keys move is let go so long [s] after the last stroke."""


class Hold:
    """Where the handle is, and who holds it.

    While nobody does it is where the operator's hand wants to be, in the probe's frame. A drag moves the hand from
    where it was when it was taken, by the drag over the position scale, so that index and clutch, which part hand and
    probe, are no hindrance.

    Args:
        watched: What is heard of the session.
        speech: Says where the handle is.

    Attributes:
        position: Of the handle as drawn, in the probe's frame [m].
        held: Whether a person holds it.
        clutched: Whether the clutch is pressed.
        used: Whether anybody has held it yet.
    """

    def __init__(self, watched: Watched, speech: Speech) -> None:
        self._watched, self._speech = watched, speech
        self._lock = threading.RLock()  # over what a person does, so that it goes out in order
        self.position = 0.0
        self.held = self.clutched = self.used = False
        self._hand = 0.0  # where it asks the hand to be, in the hand's own [m]
        self._sent = 0.0
        self._let_go = math.inf  # when strokes have ended [s]
        self._clutcher: int | None = None  # the browser that pressed the clutch

    def move_to(self, position: float, held: bool) -> None:
        """The handle was dragged to a position [m], or let go there."""
        with self._lock:
            self.held, self.used = held, True
            self._let_go = math.inf
            self._go(position)

    def step(self, way: float) -> None:
        """A stroke of a key moves the handle in by a way [m]; it is let go a second after the last stroke."""
        with self._lock:
            self.follow()
            self.held, self.used = True, True
            self._let_go = time.monotonic() + STROKE
            self._go(self.position + way)

    def toggle_clutch(self, browser: int | None = None) -> None:
        """The clutch was pressed, or let go, in this browser."""
        with self._lock:
            self.clutched = not self.clutched
            self._clutcher = browser
            self._say()

    def browser_gone(self, browser: int) -> bool:
        """A browser that is gone holds no clutch; whether it held it. A drag of it the viewer ends."""
        if self.clutched and self._clutcher == browser:
            self.toggle_clutch()
            return True
        return False

    def keep_alive(self, now: float) -> None:
        """Go on saying that it is held; let go where the strokes of keys have ended."""
        with self._lock:
            if self.held and now > self._let_go:
                self.held, self._let_go = False, math.inf
                self._say()
            elif (self.held or self.clutched) and now - self._sent > KEEP_ALIVE:
                self._say()

    def follow(self) -> None:
        """While nobody holds the handle: it is as far ahead of the probe as the hand wants to go."""
        leader, position = self._watched.leader, self._watched.probe_position
        with self._lock:
            if self.held:
                return
            self.position = self._hand = position
            if leader is not None and math.isfinite(leader.hand_position):
                intended = leader.intended_position
                self._hand = intended if math.isfinite(intended) else leader.hand_position
                self.position += self._watched.scale * (self._hand - leader.hand_position)

    def _go(self, position: float) -> None:
        position = min(max(position, 0.0), self._watched.deepest)
        self._hand += (position - self.position) / self._watched.scale
        self.position = position
        self._say()

    def _say(self) -> None:
        self._sent = time.monotonic()
        self._speech.handle(self._hand, held=self.held, clutched=self.clutched)


DRAG, LET_GO = "Drag me down to press", "Let go and the script goes on"


class LineView:
    """What a console shows of a session along a line.

    The handle is drawn in the probe's frame, from 0 to 1.2 times the press depth below the surface.

    Args:
        server: The viewer's server.
        watched: The session, to which the handle belongs whatever is shown.
        hold: The handle along the line.
    """

    def __init__(self, server: Any, watched: Watched, hold: Hold) -> None:
        self._watched, self.hold = watched, hold
        self._scene = Scene(server, self._take_handle, self._dragged)

    def hide(self) -> None:
        """Show nothing."""
        self._scene.show(False)

    def draw(self, shown: Watched, *, live: bool, useful: bool) -> None:
        """Draw the picture.

        Args:
            shown: The session, or a recording.
            live: Whether a person can move the hand in it.
            useful: Whether the robot goes along then.
        """
        self._scene.show(True)
        self.hold.follow()
        leader, surface, position = shown.leader, shown.surface, shown.probe_position
        z = (surface - position) * UNITS
        rendered, delayed, deviation = (
            (0.0, 0.0, math.nan)
            if leader is None
            else (leader.rendered_force, leader.delayed_force, leader.standard_deviation)
        )
        self._scene.set_travel(round((surface - shown.deepest) * UNITS, 1), round(surface * UNITS, 1))
        self._scene.draw(z, (surface - shown.robot_position) * UNITS, rendered, delayed, deviation)
        offered = live and self._watched.operator == "browser"
        self._scene.offer_handle(offered, useful=useful, hinted=not self.hold.used)
        self._scene.draw_handle(self._handle_height())
        self._scene.draw_hand(z, shown.hand_ahead * UNITS)

    def write(self, shown: Watched) -> None:
        """Write beside handle, force and robot what they are.

        How large a force is stands in the panel alone: the viewer draws labels some pictures later than numbers.

        Args:
            shown: The session, or a recording.
        """
        leader = shown.leader
        if leader is None:
            self._scene.label(DRAG, "", "")
            return
        held_back = ", holds back" if shown.telemetry is not None and shown.telemetry.guarded else ""
        self._scene.label(
            LET_GO if self.hold.held else DRAG,
            "rendered force",
            f"delayed robot{held_back}",
        )

    def _handle_height(self) -> float:
        """Of the handle as drawn [scene units]."""
        return (self._watched.surface - self.hold.position) * UNITS + HANDLE_HEIGHT

    def _take_handle(self) -> float:
        """A drag begins: the handle, which may be a picture old, is where it is now [scene units]."""
        self.hold.follow()
        return self._handle_height()

    def _dragged(self, z: float, held: bool) -> None:
        """The handle was moved to a height [scene units]."""
        self.hold.move_to(self._watched.surface - (z - HANDLE_HEIGHT) / UNITS, held)
        self._scene.hold_at(self._handle_height())
