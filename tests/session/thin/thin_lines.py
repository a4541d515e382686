"""A sender and a receiver of lines with a network between them, and motions to say."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from foretouch.session.thin.lines import stream
from foretouch.session.thin.lines.stream import MOST, NOTHING, POSITION, Number

Packet = tuple[int, int, tuple[int, ...]]  # tick, chosen numbers and words


@dataclass
class LinePair:
    """Both ends; `offered` sees each packet that is said and returns when it comes, once or often or never."""

    numbers: tuple[Number, ...] = (POSITION,)
    positions: int = 1
    offered: Callable[[int], Iterable[int]] = lambda tick: (tick,)
    most: int = MOST
    packets: list[Packet] = field(default_factory=list)
    coming: list[tuple[int, Packet]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.said = stream.said(self.numbers, self.positions)
        self.heard = stream.heard(self.numbers, self.positions)

    def say(self, tick: int, numbers: tuple[float, ...]) -> int:
        """A tick of the sender; how urgent it was."""
        words = np.zeros(2 * MOST, np.int64)
        urgency = stream.note(self.said, tick, numbers + (0.0,) * (MOST - len(numbers)))
        if urgency != NOTHING:
            chosen = stream.say(self.said, words, self.most)
            packet = tick, chosen, tuple(words[: 2 * chosen.bit_count()].tolist())
            self.packets.append(packet)
            self.coming += [(due, packet) for due in self.offered(tick)]
        return urgency

    def hear(self, now: int) -> int:
        """A tick of the receiver; which of the sender's it gives, 0 for none."""
        for due, packet in [one for one in self.coming if one[0] <= now]:
            self.coming.remove((due, packet))
            self.take(packet)
        return stream.go_on(self.heard)

    def take(self, packet: Packet) -> bool:
        words = np.zeros(2 * MOST, np.int64)
        words[: len(packet[2])] = packet[2]
        return stream.take(self.heard, packet[0], packet[1], words)

    @property
    def given(self) -> Any:
        return self.heard["given"][0, : len(self.numbers)]

    @property
    def smoothing(self) -> Any:
        return self.heard["apart"][0, : len(self.numbers)]


def motion(kind: str, seed: int, ticks: int) -> list[float]:
    """A position in each tick [m]."""
    draw = random.Random(seed)
    at, speed, path = 0.0, 0.0, []
    frequency, height, count = draw.uniform(0.2, 8.0), draw.uniform(1e-3, 3e-2), draw.choice((1e-5, 2e-5, 5e-5))
    for tick in range(ticks):
        match kind:
            case "walk":
                speed = 0.99 * speed + draw.gauss(0.0, 2e-6)
                at += speed
            case "sinusoid":
                at = height * math.sin(2.0 * math.pi * frequency * tick * 1e-3)
            case "steps":
                at = draw.uniform(-0.05, 0.05) if draw.random() < 0.005 else at
            case "counts":
                at = count * round(height * math.sin(2.0 * math.pi * frequency * tick * 1e-3) / count)
            case "noise":
                at = draw.gauss(0.0, 2e-4)
            case "still":
                at = 0.01
        path.append(at)
    return path


MOTIONS = ("walk", "sinusoid", "steps", "counts", "noise", "still")
