"""Position and holder of the handle, along a line and in space: it is dragged, moved by keys, and let go."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence

from foretouch.console.panels.session import Speech
from foretouch.console.watched import Watched
from foretouch.quantities.pose import Vector, add, scaled, subtract

KEEP_ALIVE = 0.1
"""Longest period at which a held handle sends its position [s], so that silence means a lost browser."""
STROKE = 1.0
"""A hand that keys move is let go this long after the last stroke [s]."""
HOME: Vector = (0.0, 0.0, 0.042)
"""Where the handle stands while a script moves the hand [m]: one that moves along is hard to catch."""
REACH = 0.1
"""The hand goes no further from the world's origin, along any axis [m]."""
RESTS = 3.0
"""A handle that was let go stays where it is for this time [s], as the hand does."""


class Hold:
    """Position of the handle along a line, and whether it is held.

    While it is not held it is at the operator's intended position, in the probe's frame. A drag moves the hand from
    its position when it was taken, by the drag over the position scale, so that index and clutch, which separate hand
    and probe, do not interfere.

    Attributes:
        position: Position of the handle as drawn, in the probe's frame [m].
        held: Whether a person holds it.
        clutched: Whether the clutch is pressed.
        used: Whether it has been held yet.
    """

    def __init__(self, watched: Watched, speech: Speech) -> None:
        self._watched, self._speech = watched, speech
        self._lock = threading.RLock()  # over what a person does, so that it goes out in order
        self.position = 0.0
        self.held = self.clutched = self.used = False
        self._hand = 0.0  # position requested of the hand, in its frame [m]
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
        """While the handle is not held, put it ahead of the probe by the distance that the hand intends to go."""
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


class SpaceHold(Hold):
    """Position of the handle in space, whether it is held, and the position that it requests of the hand.

    A drag moves the hand by the motion of the handle, from the hand's position when the handle was taken; so the
    handle need not be at the hand.

    Attributes:
        place: Position of the handle as drawn, in the world [m].
        hand: Position that it requests of the hand, in the world [m].
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
        """The handle was at a position [m] in the ``"start"``, an ``"update"`` or the ``"end"`` of a drag."""
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
        """While it is not held, put the handle at home, and the hand at its intended position."""
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
