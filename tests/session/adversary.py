"""An enemy who searches: programmes of what a leader may do to a robot, with the telemetry in hand, bred for force.

A programme is a row of numbers from 0 to 1: the session (network, first touch, drive, encoder, seed), and then parts of
five numbers each: what is done, how deep, how large, how fast, how long. Random ones come first; the best are bred.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from commanded import CEILING, MS, NO_LIMIT, Commanded
from numpy.typing import NDArray

from foretouch.link import Faults
from foretouch.robot import RobotSample

Programme = NDArray[np.float64]

DRIVES = (CEILING, NO_LIMIT)
"""Force at which the arm's own drive is clipped [N]: as it is built, and not at all."""
NETWORKS = (
    Faults(0.0),
    Faults(0.0, jitter=0.2, loss=0.4, burst=20.0, seed=5),
    Faults(0.02, jitter=0.02, loss=0.2, burst=5.0, seed=1),
    Faults(0.05, reorder=0.2, duplicate=0.2, seed=2),
    Faults(0.0, outage=0.7, seed=3),
    Faults(0.1, stall=0.5, seed=4),
)
ENCODERS = ("good", "good", "flicker 10 um", "flicker 15 um", "white 5 um")
DEPTHS = (-8e-3, -3e-3, -1e-3, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 0.02, 0.03)
DITHERS = ((1.0, -1.0), (-1.0, 0.0, 1.0), (-1.0, -1 / 3, 1 / 3, 1.0), (0.0, 0.0, 1.0, 1.0, 0.0, 0.0))
HEADER, GENES, PARTS = 5, 5, 6
LENGTH = HEADER + GENES * PARTS


def pick(gene: float, choices: tuple[object, ...]) -> object:
    return choices[min(int(gene * len(choices)), len(choices) - 1)]


class Attack(Commanded):
    def __init__(self, material: str, programme: Programme) -> None:
        network, first, drive, encoder, seed = programme[:HEADER]
        self.encoder, self.numbers = pick(encoder, ENCODERS), random.Random(int(seed * 1e6))
        super().__init__(
            material,
            pick(network, NETWORKS),
            seed=int(seed * 1000),
            force_limit=pick(drive, DRIVES),
            first_touch="guarded" if first > 0.5 else "follow",
        )
        self.felt_at, self.was_touching = self.robot.surface, False

    def begin(self) -> None:
        super().begin()
        self.telemetry = None

    def tick(self, position: float | None, *, stop: str = "", release: bool = False) -> None:
        output = super().tick(position, stop=stop, release=release)
        self.telemetry = output.telemetry
        if output.model is not None:
            self.acknowledged = output.model.sequence
        if self.telemetry.in_contact and not self.was_touching:
            self.felt_at = self.telemetry.position
        self.was_touching = self.telemetry.in_contact

    def seen(self, sample: RobotSample) -> RobotSample:
        """The sample as the encoder of this programme shows it."""
        if self.encoder == "good":
            return sample
        kind, size, _ = self.encoder.split()
        error = self.numbers.gauss(0.0, 1.0) if kind == "white" else float(self.numbers.random() < 0.5)
        return sample._replace(position=sample.position + 1e-6 * float(size) * error)

    def act(self, genes: Programme) -> None:
        kind, depth, size, pace, length = genes
        kinds = (
            self.step, self.step, self.ramp, self.creep, self.creep, self.strike, self.strike, self.hammer, self.press,
            self.pump, self.sine, self.noise, self.silence, self.take_over, self.restart, self.stop,
        )  # fmt: skip
        target = self.robot.surface + float(pick(depth, DEPTHS))
        pick(kind, kinds)(target, size, pace, 30 + int(470 * length * length))  # type: ignore[operator]

    def step(self, target: float, size: float, pace: float, ticks: int) -> None:
        self.go(target, ticks)

    def ramp(self, target: float, size: float, pace: float, ticks: int) -> None:
        begin = self.place
        for tick in range(ticks):
            self.tick(begin + (target - begin) * (tick + 1) / ticks)

    def creep(self, target: float, size: float, pace: float, ticks: int) -> None:
        """Creeps in from just before the surface, with a dither, until a little is felt."""
        amplitude, speed = 3e-6 * 10.0 ** (1.2 * size), 1e-4 * 10.0 ** (2.0 * pace)
        dither = DITHERS[ticks % len(DITHERS)]
        place, enough = self.felt_at - 3e-4 * (1.0 + pace), 0.1 + 0.5 * (ticks % 7)
        self.go(place, 30)
        for tick in range(600):
            place += speed * 1e-3
            self.tick(place + amplitude * dither[tick % len(dither)])
            if self.telemetry.force > enough:
                break

    def strike(self, target: float, size: float, pace: float, ticks: int) -> None:
        """Goes back from where it felt something by up to 10 mm, and then in as fast as it is let."""
        back = 1e-4 * 10.0 ** (2.0 * size)
        for tick in range(20 + int(60 * pace)):
            self.tick(self.felt_at - back * min(1.0, tick / 20.0))
        self.go(max(target, self.felt_at + 2e-3), max(ticks, 150))

    def hammer(self, target: float, size: float, pace: float, ticks: int) -> None:
        amplitude, half = 3e-5 * 10.0 ** (2.3 * size), 2 + int(60 * pace)
        for tick in range(ticks):
            self.tick(target + (amplitude if (tick // half) % 2 else -amplitude))

    def press(self, target: float, size: float, pace: float, ticks: int) -> None:
        """Holds a force by what is felt, and then lets it jump."""
        wanted, gain = 15.0 * size, 1e-6 * 10.0 ** (2.0 * pace)
        place = self.telemetry.position if self.telemetry is not None else self.place
        for _ in range(ticks):
            place += gain * (wanted - self.telemetry.force) if self.telemetry is not None else 0.0
            self.tick(place)
        self.go(target, 60)

    def pump(self, target: float, size: float, pace: float, ticks: int) -> None:
        """In when the force falls, out when it rises: feeds what oscillates."""
        before, amplitude = 0.0, 5e-5 * 10.0 ** (2.0 * size)
        for _ in range(ticks):
            force = self.telemetry.force if self.telemetry is not None else 0.0
            here = self.telemetry.position if self.telemetry is not None else self.place
            self.tick(here + (amplitude if force < before - 0.02 * pace else -0.5 * amplitude))
            before = force
        self.go(target, 40)

    def sine(self, target: float, size: float, pace: float, ticks: int) -> None:
        for tick in range(ticks):
            self.tick(target + 1e-4 * 10.0 ** (1.7 * size) * math.sin(tick * 0.02 * 10.0 ** (1.5 * pace)))

    def noise(self, target: float, size: float, pace: float, ticks: int) -> None:
        for _ in range(ticks):
            self.tick(target + self.numbers.gauss(0.0, 1e-6 * 10.0 ** (4.0 * size)))

    def silence(self, target: float, size: float, pace: float, ticks: int) -> None:
        self.go(None, ticks + int(400 * size))

    def take_over(self, target: float, size: float, pace: float, ticks: int) -> None:
        """Another leader comes after a second of silence, with other numbers."""
        self.go(None, 1100 if size > 0.5 else 200)
        self.epoch += 1
        self.sequence = int(1e6 * pace)
        self.step(target, size, pace, ticks)

    def restart(self, target: float, size: float, pace: float, ticks: int) -> None:
        """The follower's process ends and comes again, which takes longer than the drive takes to come to rest."""
        held = self.path[-1] if self.path else self.sample.commanded_position
        for _ in range(200):
            self.now += MS
            self.sample = self.seen(self.robot.exchange(held))
        self.begin()
        self.step(target, size, pace, ticks)

    def stop(self, target: float, size: float, pace: float, ticks: int) -> None:
        self.tick(target, stop="enemy")
        for tick in range(ticks + 300):
            self.tick(target, release=tick % 20 == 19)


class Found(NamedTuple):
    force: float
    programme: Programme
    tried: int
    over: int


def largest_force(material: str, programme: Programme) -> float:
    attack = Attack(material, programme)
    for part in range(PARTS):
        attack.act(programme[HEADER + GENES * part :][:GENES])
    return max(attack.forces)


def search(force: Callable[[Programme], float], tries: int, length: int = LENGTH, seed: int = 1) -> Found:
    """The programme that presses hardest: a third at random, then the children of the twelve best."""
    numbers = np.random.default_rng(seed)
    best: list[tuple[float, Programme]] = []
    over = 0
    for tried in range(tries):
        if 3 * tried < tries:
            programme = numbers.random(length)
        else:
            one, other = (best[int(at)][1] for at in numbers.integers(0, len(best), 2))
            cut = HEADER + GENES * int(numbers.integers(0, (length - HEADER) // GENES + 1))
            programme = np.concatenate((one[:cut], other[cut:]))
            anew, moved = numbers.random(length) < 0.08, numbers.random(length) < 0.3
            programme[moved] = (programme[moved] + numbers.normal(0.0, 0.08, int(moved.sum()))) % 1.0
            programme[anew] = numbers.random(int(anew.sum()))
        pressed = force(programme)
        over += pressed > CEILING
        best = sorted([*best, (pressed, programme)], key=lambda one: -one[0])[:12]
    return Found(best[0][0], best[0][1], tries, over)
