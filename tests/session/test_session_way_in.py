"""What touches at some places say of the air over others."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import numpy as np
import pytest

from foretouch.messages import VERSION, Command, FixtureBelief, Telemetry
from foretouch.rendering.surfaces import Plane, Surface
from foretouch.robot import SpatialSample
from foretouch.session import SessionSettings
from foretouch.session.runners.warm_up import SPECIFICATION
from foretouch.session.spatial import make_scene, tracker
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.spatial.scenes import NOMINAL, KnownSurface
from foretouch.session.spatial.way_in import (
    LARGEST_TURN,
    LARGEST_UNCERTAINTY,
    LEAST_TURN,
    believe_covariance,
    uncertainty_at,
    uncertainty_of,
)
from foretouch.session.steps import follower

MS = 1_000_000
UP = (0.0, 0.0, 1.0)
CORNERS = ((-0.02, -0.02), (0.02, -0.02), (0.0, 0.02))


class Feeler:
    """The tracker and the follower's steps, fed with places and forces; the probe is where it is put."""

    def __init__(self, scene: str = "plane") -> None:
        surface = make_scene(scene).surface
        self.state = follower.start(SPECIFICATION, SessionSettings(scene=scene), probe=ProbeInSpace(surface, NOMINAL))
        self.tracking = tracker.start(KnownSurface(surface), NOMINAL, "contact")
        self.said: list[Telemetry] = []
        self.beliefs: list[FixtureBelief] = []
        self.tick = 0
        self.place = (0.0, 0.0, 0.02)
        self.random = random.Random(1)

    def noise(self) -> float:
        """Of the force sensor [N]: one without any seems to be stuck."""
        return self.random.gauss(0.0, 0.01)

    def go(self, x: float, y: float, z: float, pressed: float = 0.0, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.tick += 1
            self.place = x, y, z
            place = x, y, z
            force = (self.noise(), self.noise(), self.noise() + pressed)
            command = Command(VERSION, self.tick, self.tick * MS, 0.0, 0, holder="test", epoch=1, place=place)
            sample = SpatialSample(place, force, force, place, (), False)
            inputs = follower.Inputs([command], sample, MS, 0, beliefs=self.beliefs)
            _, acted = follower.step(self.state, inputs, self.tick * MS)
            self.said.append(acted.telemetry)
            self.beliefs = []
            if self.tick % 5 == 0:
                belief = tracker.step(self.tracking, self.said, [], self.tick * MS)
                self.said, self.beliefs = [], [] if belief is None else [belief]

    def glide(self, x: float, y: float, z: float) -> None:
        for place in np.linspace(self.place, (x, y, z), 200).tolist():
            self.go(*place)

    def press(self, x: float, y: float, surface: float, stiffness: float = 500.0) -> None:
        """Come over and down on a surface at this height [m], 3 mm in, and go up to 20 mm over it."""
        self.glide(x, y, surface + 0.02)
        heights = np.concatenate((np.linspace(0.02, -0.003, 150), np.linspace(-0.003, 0.02, 100)))
        for height in heights.tolist():
            self.go(x, y, surface + height, stiffness * max(-height, 0.0))
        self.glide(x, y, surface + 0.02)

    def over(self, x: float, y: float) -> float:
        """How much of the air over a place does not count as free [m]."""
        self.glide(x, y, 0.02)
        return self.state.probe.line.offset - self.state.memory["free"].item()


def test_three_touches_free_the_air_over_a_plane_and_one_near_it_until_a_surface_is_missed_and_felt_again() -> None:
    feeler = Feeler()
    feeler.go(0.0, 0.0, 0.02, ticks=300)
    for number, (x, y) in enumerate(CORNERS, 1):
        feeler.press(x, y, 0.0)
        assert feeler.tracking.contacts == number
        if number == 1:
            assert feeler.over(x + 0.001, y) < 2e-3
            assert feeler.over(0.02, 0.02) > 0.02
    assert feeler.over(0.005, -0.005) < 4e-3, "a tenth of the way from the newest, and a millimetre"
    assert feeler.state.probe.safety.spaces[0].way_in.turn == LEAST_TURN
    # It is missed: nothing is free until it is felt again, and then what is near to that is.
    feeler.glide(0.005, 0.0, 0.01)
    for height in np.linspace(0.01, -0.005, 100).tolist():
        feeler.go(0.005, 0.0, height)
    feeler.go(0.005, 0.0, -0.005, ticks=100)
    assert feeler.over(-0.015, 0.015) > 0.9 * LARGEST_UNCERTAINTY
    feeler.press(0.005, 0.0, -0.008)
    assert feeler.over(0.005, 0.001) < 2e-3
    assert feeler.over(-0.015, 0.015) > 0.005


@pytest.mark.long
def test_a_touch_in_free_air_speaks_against_all_that_was_felt() -> None:
    """The fixture was bumped by 6 mm, and nobody sees it: from the first tick of the contact on nothing is free."""
    feeler = Feeler()
    feeler.go(0.0, 0.0, 0.02, ticks=300)
    for x, y in CORNERS:
        feeler.press(x, y, 0.0)
    assert feeler.over(0.005, 0.0) < 4e-3
    feeler.glide(0.005, 0.0, 0.016)
    for height in np.linspace(0.01, -0.0005, 100).tolist():
        feeler.go(0.005, 0.0, 0.006 + height, 500.0 * max(-height, 0.0))
    assert feeler.tracking.contacts == len(CORNERS), "that is not yet a touch"
    assert feeler.over(-0.015, 0.015) > 0.9 * LARGEST_UNCERTAINTY
    feeler.press(0.005, 0.0, 0.006)
    assert feeler.over(0.005, 0.001) < 2e-3, "there it was felt now"
    assert feeler.over(-0.015, 0.015) > 0.01


def covariance(place: Sequence[float], turn: Sequence[float]) -> tuple[float, ...]:
    return tuple(np.diag(np.square((*place, *turn))).ravel().tolist())


def test_the_uncertainty_is_of_the_height_alone_and_a_turn_about_the_normal_inclines_nothing() -> None:
    uncertainty = uncertainty_of(Plane())
    believe_covariance(uncertainty, covariance((0.02, 0.02, 1e-4), (1e-3, 1e-3, 0.3)))
    nearer, turn = uncertainty_at(uncertainty[0], (0.05, 0.0, 0.0), UP)
    assert nearer == pytest.approx(3.0 * math.hypot(1e-4, 5e-5) + 5e-4, rel=1e-9)
    assert turn == LEAST_TURN
    assert uncertainty_at(uncertainty[0], (0.05, 0.0, 0.0), (1.0, 0.0, 0.0))[0] == pytest.approx(
        3.0 * 0.02 + 5e-4, rel=1e-3
    )


@pytest.mark.parametrize("told", [(), (1.0,) * 6, (math.nan,) * 36, (-1.0,) * 36, (1e300,) * 36])
def test_what_is_no_covariance_says_nothing(told: tuple[float, ...]) -> None:
    uncertainty = uncertainty_of(Plane())
    believe_covariance(uncertainty, told)
    assert uncertainty_at(uncertainty[0], (0.01, 0.02, 0.0), UP) == (LARGEST_UNCERTAINTY, LARGEST_TURN)


def flat(surface: Surface) -> bool:
    return surface.relief() == (0.0, 0.0)


def test_a_hill_is_uncertain_where_it_may_stand_elsewhere_along_itself() -> None:
    plane, hill = make_scene("plane").surface, make_scene("hill").surface
    assert flat(plane)
    assert not flat(hill)
    sine, relief = hill.relief()
    assert 0.12 < sine < 0.15  # the steepest slope, 4 / 18 exp(-1 / 2), of which the grid sees the chords
    assert 3.9e-3 < relief <= 4e-3
    uncertainty = uncertainty_of(hill)
    for along, least, most in ((2e-4, 0.5e-3, 1e-3), (0.02, 4e-3, 6e-3)):
        believe_covariance(uncertainty, covariance((along, along, 1e-5), (1e-5, 1e-5, 1e-5)))
        assert least < uncertainty_at(uncertainty[0], (0.075, 0.0, 0.004), UP)[0] < most
