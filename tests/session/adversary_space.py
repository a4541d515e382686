"""The enemy of `adversary` in space: places, edges, circles, strikes and stops, with and without a camera."""

from __future__ import annotations

import math
import random

import numpy as np
from adversary import CEILING, GENES, HEADER, Programme, pick
from commanded import MS, CommandedInSpace

from foretouch.messages import VERSION, FixtureBelief, Telemetry
from foretouch.session import SessionSettings
from foretouch.session.spatial import make_scene, make_spatial_robot, tracker
from foretouch.session.spatial.scenes import KnownSurface

PARTS = 5
LENGTH = HEADER + GENES * PARTS
CAMERAS = ("none", "touch", "touch", "good", "poor")
DEVIATIONS = {"good": (3e-4, 3e-3), "poor": (2e-3, 2e-2)}
"""Of what a camera says of the fixture's place [m] and turn [rad]."""
CAMERA_TICKS, TRACKER_TICKS = 33, 5
HEIGHTS = (0.03, 0.005, 0.0, -0.001, -0.003, -0.01, -0.03, -0.05)
REACH = 0.06
"""Programmes stay so near to the middle of the scene [m]: over its edges, and beside it."""

TOUCH_WAY, TOUCH_TICKS, TOUCH_DEPTH = 0.1, 400, 2.5e-3
"""A touch goes down by so much at most [m], as slowly as it is let, and then for so many ticks to so deep [m]."""

DAMPED = 2000.0
"""Of the inclusion of `phantom` made of kelvin-voigt [N s/m], four times what is assumed where nothing is said."""

Place = tuple[float, float, float]


class SpaceAttack(CommandedInSpace):
    numbers_silence = False

    def __init__(self, scene: str, material: str, programme: Programme, bump: float = 0.0) -> None:
        first, drive, camera, seed, _ = programme[:HEADER]
        guarded = "guarded" if first > 0.5 else "follow"
        self.numbers = random.Random(int(seed * 1e6))
        settings = SessionSettings(
            scene=scene,
            material=material,
            model="kelvin-voigt",
            seed=int(seed * 1000),
            first_touch=guarded,
            bump=bump,
            most_damped=DAMPED if (scene, material) == ("phantom", "kelvin-voigt") else SessionSettings.most_damped,
        )
        made = make_scene(scene)
        robot = make_spatial_robot(settings, made, force_limit=pick(drive, (CEILING, 1000.0)))
        super().__init__(robot, settings, made.surface, made.nominal)
        self.camera = str(pick(camera, CAMERAS))
        self.longest_touch = round(TOUCH_WAY / self.state.safety.blind_speed * 1000)
        self.tracking = tracker.start(KnownSurface(made.surface), made.nominal, "contact")
        self.said: list[Telemetry] = []
        self.place: Place = self.sample.place
        self.felt_at: Place = (0.0, 0.0, 0.0)
        self.beliefs = self.touches = 0
        self.was_touching = False

    def tick(self, place: Place | None, **asked: object) -> None:
        here, self.place = self.sample, self.place if place is None else place
        said_back = super().tick(place, beliefs=self.believed(), **asked)
        touches = said_back.telemetry.in_contact
        if touches and not self.was_touching:
            self.touches += 1
            self.felt_at = here.place
        self.was_touching = touches
        self.said.append(said_back.telemetry)

    def believed(self) -> list[FixtureBelief]:
        """What a tracker says now: of touches, or from images the fixture's true pose, and its error."""
        if self.camera == "touch":
            return self.touched()
        if self.camera == "none" or (self.ticks + 1) % CAMERA_TICKS or len(self.sample.fixture) != 6:
            return []
        self.beliefs += 1
        deviation = [size for size in DEVIATIONS[self.camera] for _ in range(3)]
        pose = tuple(
            number + self.numbers.gauss(0.0, size) for number, size in zip(self.sample.fixture, deviation, strict=True)
        )
        counts = (0.0, self.beliefs, 0, 0)
        output = FixtureBelief(
            VERSION,
            self.beliefs,
            (self.ticks + 1) * MS,
            pose,
            tuple(np.diag(np.square(deviation)).ravel().tolist()),
            *counts,
            "seen",
            run=1,
        )
        return [output]

    def touched(self) -> list[FixtureBelief]:
        """What the tracker has made of the follower's ticks, every 5 of them."""
        if (self.ticks + 1) % TRACKER_TICKS:
            return []
        belief = tracker.step(self.tracking, self.said, [], self.ticks * MS)
        self.said = []
        return [] if belief is None else [belief]

    def act(self, genes: Programme) -> None:
        kind, x, y, height, how = genes
        target = (REACH * (2 * x - 1), REACH * (2 * y - 1), float(pick(height, HEIGHTS)))
        kinds = (
            self.step, self.glide, self.stop, self.circle, self.dither, self.strike, self.strike, self.silence,
            self.touch, self.touch,
        )  # fmt: skip
        pick(kind, kinds)(target, how)  # type: ignore[operator]

    def touch(self, target: Place, how: float) -> None:
        """Down from over where the surface was felt, until it is felt, a little in, and up: so the fixture is found."""
        x, y, _ = target
        high, before = self.felt_at[2] + 0.003 + 0.01 * how, self.touches
        if before:
            self.glide((x, y, high), 0.5)
        for _ in range(self.longest_touch):
            self.tick((x, y, high - TOUCH_WAY))
            if self.touches > before:
                break
        for _ in range(TOUCH_TICKS):
            self.tick((x, y, self.felt_at[2] - TOUCH_DEPTH))
        for _ in range(100):
            self.tick((x, y, high))

    def step(self, target: Place, how: float) -> None:
        for _ in range(100 + int(400 * how)):
            self.tick(target)

    def glide(self, target: Place, how: float) -> None:
        begin, ticks = self.place, 50 + int(800 * how)
        for tick in range(ticks):
            self.tick(_between(begin, target, (tick + 1) / ticks))

    def circle(self, target: Place, how: float) -> None:
        x, y, z = target
        for tick in range(500):
            turn = tick * (0.02 + 0.2 * how)
            self.tick((x + 0.02 * math.sin(turn), y + 0.02 * math.cos(turn), z))

    def dither(self, target: Place, how: float) -> None:
        x, y, z = self.place
        size, lowest = 1e-5 * 10.0 ** (2.0 * how), target[2]
        for tick in range(500):
            z = max(z - 3e-6, min(z, lowest))
            self.tick((x + size * (-1) ** tick, y, z + size * (-1) ** tick))

    def strike(self, target: Place, how: float) -> None:
        x, y, z = self.felt_at
        back = 1e-4 * 10.0 ** (2.0 * how)
        aside = (x + 0.1 * target[0] * (how > 0.7), y + 0.1 * target[1] * (how > 0.7), z + back)
        for tick in range(60):
            self.tick(_between(self.place, aside, min(1.0, tick / 30.0)))
        for _ in range(250):
            self.tick((aside[0], aside[1], min(target[2], z - 2e-3)))

    def silence(self, target: Place, how: float) -> None:
        for _ in range(100 + int(600 * how)):
            self.tick(None)

    def stop(self, target: Place, how: float) -> None:
        self.tick(target, stop="enemy")
        for tick in range(300 + int(500 * how)):
            self.tick(target, release=tick % 20 == 19)


def _between(begin: Place, end: Place, share: float) -> Place:
    x, y, z = (float(a + (b - a) * share) for a, b in zip(begin, end, strict=True))
    return x, y, z


def largest_force_in_space(scene: str, material: str, programme: Programme) -> float:
    attack = SpaceAttack(scene, material, np.asarray(programme))
    for part in range(PARTS):
        attack.act(programme[HEADER + GENES * part :][:GENES])
    return max(attack.forces)
