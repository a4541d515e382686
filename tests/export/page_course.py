"""A course of the browser page in Python: the same session with the steps, hand and messages that Python runs.

As a program it writes the rows of `COURSES` to a file, so that it can run with another mathematics of the C library.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Hand, RestingOperator
from foretouch.export.beginnings import GRIP, PRESSED
from foretouch.identification import SensorState
from foretouch.messages import decode, encode
from foretouch.robot import RobotSample
from foretouch.robot.slide import exchange, make_slide
from foretouch.session import SessionSettings, make_session_robot
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.steps import baseline, follower, leader

MS = 1_000_000
COURSES: dict[str, dict[str, Any]] = {
    "foam": {"material": 0, "delay": 150, "loss": 0.02, "delayed": False, "seed": 1},
    "hand, far away": {"material": 1, "delay": 400, "loss": 0.2, "delayed": False, "seed": 5},
    "bone": {"material": 5, "delay": 50, "loss": 0.0, "delayed": False, "seed": 2},
    "delayed force": {"material": 0, "delay": 150, "loss": 0.02, "delayed": True, "seed": 1},
}
TICKS = 6000


def aims() -> list[float]:
    """Where the hand wants to be in each tick [m]: two presses of unlike depth, and one that is held."""
    result = []
    for tick in range(TICKS):
        time = 1e-3 * tick
        pressing = 0.5 * (1.0 - math.cos(math.pi * time)) if time < 4.0 else min(time - 4.0, 1.0)
        result.append(0.022 * pressing * (1.0 if time < 2.0 else 1.1))
    return result


def generator(seed: int) -> Iterator[float]:
    """The page's generator: mulberry32."""
    state, mask = seed, 0xFFFFFFFF
    while True:
        state = (state + 0x6D2B79F5) & mask
        mixed = ((state ^ (state >> 15)) * (state | 1)) & mask
        mixed = ((mixed + (((mixed ^ (mixed >> 7)) * (mixed | 61)) & mask)) & mask) ^ mixed
        yield ((mixed ^ (mixed >> 14)) & mask) / 4294967296.0


def normal(draws: Iterator[float]) -> float:
    total = -6.0
    for _ in range(12):
        total += next(draws)
    return total


class Aims(RestingOperator):
    """Gives one aim after the other."""

    def __init__(self, given: list[float]) -> None:
        self._given = iter(given)

    def read(self, now_ns: int) -> float:
        return next(self._given)


class Way:
    """One direction of the network."""

    def __init__(self, seed: int, delay: int, loss: float) -> None:
        self._draws, self._delay_ns, self._loss = generator(seed), delay * MS, loss
        self._waiting: deque[tuple[int, Any]] = deque()
        self.bytes = 0

    def push(self, now_ns: int, message: Any) -> None:
        content = encode(message)
        self.bytes += len(content)
        if next(self._draws) >= self._loss:
            self._waiting.append((now_ns + self._delay_ns, decode(content, type(message))))

    def pop(self, now_ns: int) -> list[Any]:
        result = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            result.append(self._waiting.popleft()[1])
        return result


def say_as_in_c() -> None:
    """Models are sent without their standard errors and reasons, which a message of C does not have.

    The follower sends as many bytes a second as it may: it would send them at other times.
    """
    vars_of: Any = ModelSender
    vars_of._errors_of = lambda *_: ()
    vars_of._reason = lambda _, __, sensors, ___: "" if sensors is SensorState.GOOD else "nothing is learnt"


def course(
    given: list[float], material: int, delay: int, loss: float, delayed: bool, seed: int
) -> tuple[Any, int, int]:
    """Rows as the page shows them, and the bytes of the commands and of what came back."""
    settings = SessionSettings(grip=GRIP, baseline="delayed" if delayed else "none")
    follows = follower.start(make_session_robot(settings)[0].specification, settings, run=1)
    leads = (baseline if delayed else leader).start(settings, holder="page", epoch=1)
    hand, slides, move = Hand(Aims(given), GRIPS[GRIP], settings.device), make_slide(PRESSED[material]), exchange.entry
    up, down, draws = Way(seed, delay, loss), Way(seed + 1, delay, loss), generator(seed + 2)
    sample, rows = RobotSample(*move(slides, 0.0, 0.0, 0.0, 0.0)), np.empty((len(given), 10))
    for tick, aim in enumerate(given):
        now = (tick + 1) * MS
        follows, done = follower.step(follows, follower.Inputs(up.pop(now), sample, MS, 0), now)
        for message in (done.model, done.telemetry):
            if message is not None:
                down.push(now, message)
        sample = RobotSample(*move(slides, done.desired_position, normal(draws), normal(draws), normal(draws)))
        leads, led = leader.step(leads, leader.Inputs(hand.read(now), down.pop(now), MS, 0), now)
        hand.render(led.record.rendered_force)
        up.push(now, led.command)
        record, view = led.record, leads.follower_view
        arrived = view.force if view.touching else 0.0
        rows[tick] = (
            *(now / MS, aim, hand.exact_position, record.position, record.rendered_force, record.predicted_force),
            *(arrived, view.position, sample.exact_position, sample.exact_force),
        )
    return rows, up.bytes, down.bytes


def every() -> dict[str, NDArray[np.float64]]:
    """Rows of each course; and, by the same names with "bytes ", the bytes of the commands and of what came back."""
    result = {}
    for name, given in COURSES.items():
        result[name], *sizes = course(aims(), **given)
        result[f"bytes {name}"] = np.array(sizes, dtype=np.float64)
    return result


if __name__ == "__main__":
    say_as_in_c()
    np.savez(sys.argv[1], **every())
