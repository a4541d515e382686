"""The handle in a person's hand: dragged by a mouse, moved by strokes of keys, let go by whoever is gone."""

from __future__ import annotations

import math
import threading
import time

from foretouch.console.speech import Speech
from foretouch.console.watched import Watched

__all__ = ["Hold"]

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
