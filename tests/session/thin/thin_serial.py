"""Both ends of a thin link with all that they may have to say, and a serial link between them, in simulated time."""

from __future__ import annotations

import random
from collections import deque
from typing import Any

import numpy as np
from thin_ticks import EPOCH, MS, RUN, command_at, telemetry_at

from foretouch.messages import VERSION, CameraImage, FieldUpdate, Hello, Message, ModelUpdate, encode
from foretouch.session.thin import FollowerEnd, LeaderEnd
from foretouch.session.thin.ends import USUAL


class SerialLink:
    """Packets one behind the other: each takes its bytes over the rate [bytes/s], and the link's own delay [ns]."""

    def __init__(self, rate: float, delay_ns: int = 0) -> None:
        self.rate, self.delay_ns = rate, delay_ns
        self.waiting: deque[tuple[int, Any]] = deque()
        self.free_ns = 0
        self.longest_queue = 0.0  # [s]

    def push(self, now_ns: int, packet: Message) -> None:
        self.free_ns = max(self.free_ns, now_ns) + round(len(encode(packet)) / self.rate * 1e9)
        self.longest_queue = max(self.longest_queue, (self.free_ns - now_ns) * 1e-9)
        self.waiting.append((self.free_ns + self.delay_ns, packet))

    def pop_due(self, now_ns: int) -> list[Any]:
        due = []
        while self.waiting and self.waiting[0][0] <= now_ns:
            due.append(self.waiting.popleft()[1])
        return due


def hello_at(role: str, tick: int, *, size: int = 20, longest: int = 60) -> Hello:
    """One whose texts are others each time."""
    draw = random.Random(f"{role}{tick}")
    texts = {f"name_{index}": "".join(draw.choices("abcdef ", k=longest)) for index in range(size)}
    return Hello.of(role, tick + 1, tick * MS, texts)


def model_at(tick: int) -> ModelUpdate:
    """A model that has no short form, so that it crosses as it is."""
    draw = random.Random(tick)
    numbers = tuple(draw.uniform(1.0, 1e6) for _ in range(40))
    return ModelUpdate(
        VERSION, tick // 20 + 1, tick * MS, tick, "a-law", numbers, (), draw.random(), True, "", "some", b"", EPOCH, RUN
    )


def image_at(tick: int, size: int = 900) -> CameraImage:
    """An image with the size of a small one."""
    jpeg = random.Random(tick).randbytes(size)
    return CameraImage(VERSION, tick, tick * MS, tick, jpeg, (), (), 4, "", (0.5,) * 15, RUN)


class BothEnds:
    """Two ends that say all there may be: noise in each number, hellos, fields and models at all times.

    Args:
        budget: Of each end [bytes/s].
        links: Of both directions: from the leader, and from the follower.
        space: Whether it is a session in space.
        noise: Standard deviation of positions [m]; forces have a thousand times as much [N].
        heavy: Whether there are hellos, fields and models.
        images: Whether there is a camera.
        protection: Of both ends.
    """

    def __init__(
        self, budget: float, links: tuple[Any, Any], *, space: bool = False, noise: float = 0.0, heavy: bool = False,
        seed: int = 0, holder: str = "somebody@here", images: bool = False, protection: str = USUAL,
    ) -> None:  # fmt: skip
        self.leader, self.follower = LeaderEnd(budget, 0.0, protection), FollowerEnd(budget, 0.0, protection)
        self.links, self.space, self.heavy, self.holder = links, space, heavy, holder
        self._random, self._noise, self._images = np.random.default_rng(seed), noise, images
        self.sent: tuple[list[tuple[int, int]], list[tuple[int, int]]] = [], []  # time [ns] and bytes
        self.tick = 0
        self.heard: list[tuple[int, Message]] = []  # beside the ticks, at the follower
        self.shown: list[tuple[int, Message]] = []  # and at the leader
        self.follower.deliver = lambda message: self.heard.append((self.tick, message))
        self.leader.deliver = lambda message: self.shown.append((self.tick, message))

    def run(self, ticks: int) -> tuple[list[Message], list[Message]]:
        """Let some ticks pass; what came at the follower in the last, and at the leader."""
        commands: list[Message] = []
        said: list[Message] = []
        for _ in range(ticks):
            self.tick += 1
            now_ns = self.tick * MS
            commands = self.follower.heard(self.links[0].pop_due(now_ns), now_ns)
            self._send(1, self.follower.said(self._of_follower(), now_ns), now_ns)
            said = self.leader.heard(self.links[1].pop_due(now_ns), now_ns)
            self._send(0, self.leader.said(self._of_leader(), now_ns), now_ns)
        return commands, said

    def _send(self, side: int, messages: list[Message], now_ns: int) -> None:
        end = (self.leader, self.follower)[side]
        for message in messages:
            if type(message) is end.packet:
                self.sent[side].append((now_ns, len(encode(message))))
                self.links[side].push(now_ns, message)

    def _of_leader(self) -> list[Message]:
        message = command_at(self.tick, space=self.space, holder=self.holder)
        if self._noise:
            place = tuple(self._noise * self._random.standard_normal(3)) if self.space else ()
            position = self._noise * self._random.standard_normal()
            message = command_at(self.tick, position=position, place=place, holder=self.holder)
        if self.heavy and self.tick % 300 == 7:
            self.leader.offer(hello_at("leader", self.tick))
        return [message]

    def _of_follower(self) -> list[Message]:
        message = telemetry_at(self.tick, space=self.space)
        if self._noise:
            noisy = self._noise * self._random.standard_normal(4)
            changes = {"position": noisy[0], "desired_position": noisy[1], "force": 1e3 * noisy[2]}
            message = telemetry_at(self.tick, space=self.space, status=int(self._random.integers(0, 3)), **changes)
        others: list[Message] = []
        if self._images and self.tick % 1000 == 500:
            self.follower.show(encode(image_at(self.tick)))
        if self.heavy:
            if self.tick % 250 == 5:
                self.follower.offer(hello_at("follower", self.tick))
            if self.tick % 100 == 3:
                others.append(FieldUpdate(VERSION, self.tick, self.tick * MS, bytes(400), RUN))
            if self.tick % 20 == 1:
                others.append(model_at(self.tick))
        return [message, *others]


def most_in_a_second(sent: list[tuple[int, int]]) -> int:
    """The largest number of bytes in a window of one second."""
    most = total = first = 0
    for time, size in sent:
        total += size
        while sent[first][0] <= time - 1000 * MS:
            total -= sent[first][1]
            first += 1
        most = max(most, total)
    return most
