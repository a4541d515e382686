"""Position and holder of the handle, along a line and in space: it is dragged, moved by keys, and let go."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import Any

from foretouch.console.panels.session import Publisher
from foretouch.console.watched import Watched
from foretouch.messages import Handle
from foretouch.quantities.pose import Vector, add, scaled, subtract

KEEP_ALIVE = 0.1  # Longest period at which a held handle sends its position [s], so that silence means a lost browser
STROKE = 1.0  # A hand that keys move is let go this long after the last stroke [s]
HOME: Vector = (0.0, 0.0, 0.042)
"""Position of the handle while a script moves the hand [m]: one that moves along is hard to catch."""
REACH = 0.1  # The hand goes no further from the world's origin, along any axis [m]
RESTS = 3.0  # A handle that was let go stays where it is for this time [s], as the hand does


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

    def __init__(self, watched: Watched, publisher: Publisher) -> None:
        self._watched, self._publisher = watched, publisher
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
            self._move((0.0, 0.0, self.position - position))

    def stroke(self, way: Vector) -> None:
        """A key or a slider moves the hand by a way in the world [m]; it is let go a second after the last one."""
        with self._lock:
            self.follow()
            self.held, self.used = True, True
            self._let_go = time.monotonic() + STROKE
            self._move(way)

    def toggle_clutch(self, browser: int | None = None) -> None:
        """The clutch was pressed, or let go, in this browser."""
        with self._lock:
            self.clutched = not self.clutched
            self._clutcher = browser
            self._publish()

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
                self._publish()
            elif (self.held or self.clutched) and now - self._sent > KEEP_ALIVE:
                self._publish()

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

    def _move(self, way: Vector) -> None:
        position = min(max(self.position - way[2], 0.0), self._watched.deepest)
        self._hand += (position - self.position) / self._watched.scale
        self.position = position
        self._publish()

    def _publish(self) -> None:
        self._sent = time.monotonic()
        self._publisher.send(Handle, held=self.held, clutched=self.clutched, **self._requested())

    def _requested(self) -> dict[str, Any]:
        return {"position": self._hand}


class SpaceHold(Hold):
    """Position of the handle in space, whether it is held, and the position that it requests of the hand.

    A drag moves the hand by the motion of the handle, from the hand's position when the handle was taken; so the
    handle need not be at the hand.

    Attributes:
        handle: Position of the handle as drawn, in the world [m].
        hand: Position that it requests of the hand, in the world [m].
    """

    def __init__(self, watched: Watched, publisher: Publisher) -> None:
        super().__init__(watched, publisher)
        self.handle: Vector = HOME
        self.hand: Vector = HOME
        self._released = -math.inf

    @property
    def dragged(self) -> bool:
        """Whether it is held by a mouse, and not moved by keys or sliders."""
        return self.held and self._let_go == math.inf

    def drag_to(self, position: Sequence[float], phase: str) -> None:
        """The handle was at a position [m] in the ``"start"``, an ``"update"`` or the ``"end"`` of a drag."""
        x, y, z = (float(value) for value in position)
        with self._lock:
            if phase == "start":
                self.follow()
            self.held, self.used = phase != "end", True
            self._released = time.monotonic()
            self._let_go = math.inf
            self._move(subtract((x, y, z), self.handle))

    def follow(self) -> None:
        """While it is not held, put the handle at home, and the hand at its intended position."""
        with self._lock:
            now = time.monotonic()
            if self.held:
                self._released = now
                return
            if now - self._released > RESTS:
                self.handle = HOME
            space, leader = self._watched.leader_space, self._watched.leader
            if not math.isfinite(space.hand_x):
                return
            self.hand = space.hand_x, space.hand_y, space.hand_z
            if leader is None or not math.isfinite(leader.intended_position - leader.hand_position):
                return
            ahead = self._watched.scale * (leader.intended_position - leader.hand_position)
            self.hand = add(self.hand, scaled((space.normal_x, space.normal_y, space.normal_z), -ahead))

    def _move(self, way: Vector) -> None:
        self.handle = add(self.handle, way)
        # Below what it touches the hand goes no further than along a line.
        space, watched = self._watched.leader_space, self._watched
        touched = space.point_z if math.isfinite(space.point_z) else 0.0
        lowest = (-REACH, -REACH, max(touched - (watched.deepest - watched.surface), -REACH))
        x, y, z = (min(max(value, least), REACH) for value, least in zip(add(self.hand, way), lowest, strict=True))
        self.hand = x, y, z
        self._publish()

    def _requested(self) -> dict[str, Any]:
        return {"position": 0.0, "place": self.hand}
