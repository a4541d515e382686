"""Nothing that a leader says gets the force over its ceiling: an enemy searches for it, with the telemetry in hand.

`make test-long` tries 5,000 programmes on each material, with the arm's own drive clipped at 15 N and not at all.
"""

from __future__ import annotations

import numpy as np
import pytest
from adversary import CEILING, HEADER, LENGTH, Attack, largest_force, search

from foretouch.robot import MATERIALS

THOUSANDS = 5000


@pytest.mark.parametrize(("material", "tries"), [("bone", 25), ("kelvin-voigt", 35)])
def test_a_short_search_finds_nothing(material: str, tries: int) -> None:
    found = search(lambda programme: largest_force(material, programme), tries, seed=5)
    assert found.force <= CEILING, found
    assert found.force > 5.0, "it does press"


@pytest.mark.long
@pytest.mark.parametrize("material", sorted(MATERIALS))
def test_a_search_of_thousands_finds_nothing(material: str) -> None:
    """Seven to ten minutes for each material."""
    found = search(lambda programme: largest_force(material, programme), THOUSANDS)
    assert found.over == 0, found


@pytest.mark.parametrize("encoder", ["good", "flicker 10 um", "flicker 15 um", "white 5 um"])
@pytest.mark.parametrize(("material", "dither"), [("kelvin-voigt", 1.1e-5), ("bone", 6e-6)])
def test_a_creep_that_trembles_proves_nothing(material: str, dither: float, encoder: str) -> None:
    """What is told for a tick is fast, what the robot does is slow: and then it strikes."""
    programme = np.zeros(LENGTH)
    programme[2] = 0.99  # the drive is not clipped
    attack = Attack(material, programme)
    attack.encoder = encoder
    for pattern in ((1.0, -1.0), (-1.0, 0.0, 1.0)):
        attack.felt_at = attack.robot.surface
        for tick in range(400):
            attack.tick((attack.felt_at - 3e-4) * min(1.0, (tick + 1) / 300))
        place = attack.felt_at - 3e-4
        for tick in range(2500):
            place += 3e-7
            attack.tick(place + dither * pattern[tick % len(pattern)])
            if attack.telemetry.in_contact:
                break
        attack.strike(attack.robot.surface + 0.03, 0.75, 0.5, 400)
    assert max(attack.forces) > 4.0
    assert max(attack.forces) <= CEILING


def test_a_programme_is_the_same_each_time() -> None:
    """So that what is found can be looked at."""
    programme = np.random.default_rng(3).random(LENGTH)
    programme[HEADER] = 0.2
    assert largest_force("bone", programme) == largest_force("bone", programme)
