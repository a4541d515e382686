"""What a leader and a follower hold before their first tick, as Python starts them: settings are fixed with it."""

from __future__ import annotations

import pickle
import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.session.safety.safety import Safety
from foretouch.session.settings import SessionSettings
from foretouch.session.setup import make_session_robot
from foretouch.session.steps import follower, leader
from foretouch.session.steps.following import Following
from foretouch.session.steps.sensing import safety_limits

OWN = 1  # Number of a process that has not been given one


def following_of(state: follower.State) -> NDArray[np.void]:
    """The record of a follower along a line that was started in Python, in which a contact map learns."""
    conditioning, rings = state.learner.conditioner.memory
    parts: dict[str, Any] = {
        "followers": state.memory,
        "conditionings": conditioning,
        "learnings": state.learner.learning,
        "banks": state.learner.estimator.states,  # type: ignore[attr-defined]
        "hearings": state.records,
        "watches": state.watch._first,
    }
    made = Following.new(**parts)
    made["rings"][0, :, : rings.shape[1]] = rings
    return made


class Beginning(NamedTuple):
    """A function of C that writes what a new struct holds.

    Attributes:
        name: In C, without the prefix.
        struct: What the struct is called.
        record: What it writes, an array of one record.
        text: What is said of it.
    """

    name: str
    struct: str
    record: NDArray[np.void]
    text: str


def beginnings(settings: SessionSettings) -> list[Beginning]:
    """All that begin a struct of C."""
    robot, _ = make_session_robot(settings)
    felt = leader.start(settings, epoch=OWN, device=settings.device).records
    unfelt = leader.start(settings, epoch=OWN).records
    followed = following_of(follower.start(robot.specification, settings, run=OWN))
    limits = safety_limits(settings, robot.specification)
    memory = Safety(limits, robot.specification.sample_period).memories
    return [
        Beginning("leader_init", "leader", felt, "A leader whose hand holds the device of the settings and feels it."),
        Beginning("leader_unfelt_init", "leader", unfelt, "A leader whose device moves only, such as a mouse."),
        Beginning("follower_init", "follower", followed, "A follower that has heard nothing and learnt nothing yet."),
        Beginning("safety_init", "safety", memory, "Safety alone, with the limits of the settings."),
        Beginning("safety_limits_init", "safety_limits", memory["limits"], "The limits of the settings."),
    ]


def main() -> None:
    """Write the beginnings for the settings that the input holds to the output."""
    sys.stdout.buffer.write(pickle.dumps(beginnings(pickle.loads(sys.stdin.buffer.read()))))
