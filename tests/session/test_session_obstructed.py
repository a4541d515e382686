"""A follower in a scene whose arm meets something with a link: it says so, stands, and goes on after a way back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from commanded import CommandedInSpace, Place

from foretouch.messages import Status
from foretouch.robot import ArticulatedArm, read_arm
from foretouch.robot.arms import Obstacle
from foretouch.session import SessionSettings
from foretouch.session.spatial import make_scene

pytest.importorskip("mink")

AWAY, SIDE = (0.0, 0.0, -9.0), np.array((0.0, 1.0, 0.0))
FAR, SPEED, GAP = 0.05, 1e-4, 0.01
"""Way aside [m], its steps [m a tick], and how far off the ball stands [m]."""


class Meeting(CommandedInSpace):
    """An arm over a plane, in free air, with a ball of 10 kN/m beside its last link: the way aside ends inside it."""

    def __init__(self, name: str) -> None:
        scene = make_scene("plane")
        self.ball = Obstacle(AWAY, 0.03, 1e4)
        arm = ArticulatedArm(read_arm(name), lambda *_: (0.0, 0.0, 0.0), seed=0, obstacle=self.ball)
        for link in reversed(range(self.ball.places().shape[0])):
            at = self.ball.places()[link] + (self.ball.distances()[link] + GAP) * SIDE
            self.ball.move(tuple(at.tolist()))
            if self.ball.clear:
                break
        settings = SessionSettings(robot=name, scene="plane", first_touch="follow")
        super().__init__(arm, settings, scene.surface, scene.nominal)
        self.home: Place = self.sample.place
        self.statuses: list[Status] = []
        self.pressed: list[float] = []

    def tick(self, place: Place | None, **asked: Any) -> Any:
        acted = super().tick(place, **asked)
        self.statuses.append(acted.telemetry.status)
        self.pressed.append(float(self.ball.force.max()))
        return acted

    def aside(self, way: float) -> Place:
        x, y, z = self.home
        return x, y + way, z


@pytest.mark.parametrize("name", ["fr3", "ur5e"])
@pytest.mark.long
def test_a_link_that_meets_something_in_a_scene_is_said_and_the_follower_stands_until_a_way_back(name: str) -> None:
    meeting = Meeting(name)
    for tick in range(2000):
        meeting.tick(meeting.aside(min(SPEED * tick, FAR)))
    met = meeting.statuses.index(Status.OBSTRUCTED)
    assert any(meeting.pressed[:met])
    assert set(meeting.statuses[met:]) == {Status.OBSTRUCTED}
    stood = np.array(meeting.path[-500:])
    assert np.ptp(stood, axis=0).max() == 0.0  # told to stand, and not to creep on
    assert math.dist(stood[-1], meeting.sample.place) < 5e-4  # where the robot is, and not where it was to go
    assert meeting.sample.place[1] < meeting.aside(FAR)[1] - 0.02
    assert max(meeting.pressed) < 30.0
    assert meeting.pressed[-1] < 15.0
    for tick in range(2000):  # the command comes back
        meeting.tick(meeting.aside(max(FAR - SPEED * tick, 0.0)))
    assert meeting.statuses[-1] is Status.FOLLOWING
    assert Status.OBSTRUCTED not in meeting.statuses[meeting.statuses.index(Status.FOLLOWING, met) :]
    assert max(meeting.pressed[2000:]) < 1.05 * meeting.pressed[1999]  # it goes back, and not in again
    assert not meeting.pressed[-1]
    assert math.dist(meeting.sample.place, meeting.home) < 3e-3
    steps = np.linalg.norm(np.diff(meeting.path, axis=0), axis=1)
    steps[met] = 0.0  # where it stands its path begins anew at the robot, which is behind it
    assert steps.max() < 2.6e-4  # 0.25 m/s, which a session allows: nothing jumps where it goes on
    for tick in range(800):  # and it goes on another way
        meeting.tick(meeting.aside(max(-SPEED * tick, -0.03)))
    assert meeting.statuses[-1] is Status.FOLLOWING
    assert math.dist(meeting.sample.place, meeting.aside(-0.03)) < 3e-3


@pytest.mark.parametrize("name", ["fr3"])
@pytest.mark.long
def test_a_way_around_in_another_direction_is_a_way_back_too(name: str) -> None:
    """Up and away from what it met, though never back to where it was."""
    meeting = Meeting(name)
    for tick in range(1500):
        meeting.tick(meeting.aside(min(SPEED * tick, FAR)))
    assert meeting.statuses[-1] is Status.OBSTRUCTED
    x, _, z = meeting.home
    y = meeting.sample.place[1] - 0.01
    for tick in range(1500):
        meeting.tick((x, y, z + min(SPEED * tick, 0.02)))
    assert meeting.statuses[-1] is Status.FOLLOWING
    assert math.dist(meeting.sample.place, (x, y, z + 0.02)) < 3e-3
