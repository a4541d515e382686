"""The handle in space in a person's hand: dragged, moved by keys and sliders, let go."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from foretouch.console.hold import STROKE, Hold
from foretouch.console.speech import Speech
from foretouch.console.watched import Watched
from foretouch.quantities.pose import Vector, add, scaled, subtract

__all__ = ["HOME", "REACH", "SpaceHold"]

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
