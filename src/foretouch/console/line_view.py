"""A session along a line in the console: its picture and its handle."""

from __future__ import annotations

import math
from typing import Any

from foretouch.console.hold import Hold
from foretouch.console.scene import UNITS, Scene
from foretouch.console.shapes import HANDLE_HEIGHT
from foretouch.console.watched import Watched

__all__ = ["LineView"]

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

    def draw(self, shown: Watched, *, live: bool) -> None:
        """Draw the picture.

        Args:
            shown: The session, or a recording.
            live: Whether a person can move the hand in it.
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
        self._scene.offer_handle(live and self._watched.operator == "browser", hinted=not self.hold.used)
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
