"""A force sensor that lies while the robot presses, and honest ones, which are believed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from commanded import CEILING, Commanded

from foretouch.identification import SensorState
from foretouch.messages import Status
from foretouch.robot import MATERIALS, RobotSample

NOISE = np.random.default_rng(1).standard_normal(10_000).tolist()

Lie = Callable[[RobotSample], RobotSample]


class Pressing(Commanded):
    """A follower that is told places, with an arm whose drive is not clipped and a sensor that may lie."""

    def __init__(self, material: str, *, tells: bool = False) -> None:
        self.tells = tells
        self.lie: Lie = lambda sample: sample
        super().__init__(material, seed=3)

    def seen(self, sample: RobotSample) -> RobotSample:
        return self.lie(sample) if self.tells else self.lie(sample)._replace(effort=math.nan)


def dead(sample: RobotSample) -> RobotSample:
    return sample._replace(sensor_force=0.3 + 0.02 * NOISE[int(1e6 * abs(sample.sensor_force)) % 10_000])


LIES: dict[str, Lie] = {
    "dead": dead,
    "zero": lambda sample: sample._replace(sensor_force=0.0),
    "turned": lambda sample: sample._replace(sensor_force=-sample.sensor_force),
    "clipped": lambda sample: sample._replace(sensor_force=min(sample.sensor_force, 8.0)),
    "half": lambda sample: sample._replace(sensor_force=0.5 * sample.sensor_force),
}


@pytest.mark.parametrize(
    ("material", "kind"),
    [
        *(("bone", kind) for kind in LIES),
        *(("hand", kind) for kind in ("dead", "half")),
        *(pytest.param("hand", kind, marks=pytest.mark.long) for kind in ("zero", "turned", "clipped")),
        *(pytest.param("kelvin-voigt", kind, marks=pytest.mark.long) for kind in LIES),
    ],
)
@pytest.mark.first
def test_a_sensor_that_lies_about_a_press_is_found_and_the_robot_goes_out(material: str, kind: str) -> None:
    pressing = Pressing(material)
    inside = pressing.robot.surface + 0.03
    pressing.go(0.0, 300)
    pressing.go(inside, 2500)
    assert pressing.forces[-1] > 12.0
    pressing.lie = LIES[kind]
    pressing.go(inside, 200)
    assert pressing.statuses[-1] is Status.SENSOR_FAULT
    pressing.go(inside, 1000)
    assert max(pressing.forces) <= CEILING
    assert pressing.forces[-1] == 0.0, "it was taken out by the way that it came"


@pytest.mark.parametrize("kind", ["dead", "zero", "turned"])
@pytest.mark.parametrize(
    ("material", "felt"),
    [
        ("bone", 8.0),
        ("foam", 4.0),
        *(pytest.param("bone", felt, marks=pytest.mark.long) for felt in (2.0, 4.0)),
        *(pytest.param("foam", felt, marks=pytest.mark.long) for felt in (2.0, 8.0)),
        *(pytest.param("hunt-crossley", felt, marks=pytest.mark.long) for felt in (2.0, 4.0, 8.0)),
    ],
)
@pytest.mark.first
def test_nor_does_one_that_dies_on_the_way_in(material: str, felt: float, kind: str) -> None:
    pressing = Pressing(material, tells=True)
    inside = pressing.robot.surface + 0.03
    pressing.go(0.0, 300)
    while pressing.forces[-1] < felt and pressing.sequence < 6000:
        pressing.tick(inside)
    pressing.lie = LIES[kind]
    pressing.go(inside, 1500)
    assert max(pressing.forces) <= CEILING
    assert pressing.forces[-1] < 1.0


@pytest.mark.parametrize("kind", ["dead", "zero", "turned"])
@pytest.mark.parametrize("material", ["bone", "foam", pytest.param("kelvin-voigt", marks=pytest.mark.long)])
@pytest.mark.first
def test_the_drive_bears_witness_against_one_that_was_dead_before_it_touched(material: str, kind: str) -> None:
    pressing = Pressing(material, tells=True)
    pressing.lie = LIES[kind]
    pressing.go(0.0, 300)
    pressing.go(pressing.robot.surface + 0.03, 2500)
    assert pressing.statuses[-1] is Status.SENSOR_FAULT
    assert max(pressing.forces) <= CEILING
    assert pressing.forces[-1] == 0.0


def test_a_stop_unloads_a_robot_whose_sensor_shows_nothing() -> None:
    pressing = Pressing("bone")
    inside = pressing.robot.surface + 0.03
    pressing.go(0.0, 300)
    pressing.go(inside, 1000)
    pressing.lie = dead
    pressing.go(inside, 20)
    pressing.tick(inside, stop="a person shouted")
    pressing.go(inside, 200)
    assert pressing.forces[-1] == 0.0
    assert pressing.statuses[-1] is Status.STOPPED


@pytest.mark.parametrize("material", sorted(MATERIALS))
@pytest.mark.first
def test_honest_sensors_are_believed_however_quickly_it_is_let_go(material: str) -> None:
    """A force that falls to zero within milliseconds, for the probe goes out, slows down, or comes to rest."""
    pressing = Pressing(material, tells=True)
    surface = pressing.robot.surface
    numbers = np.random.default_rng(5)
    pressing.go(0.0, 300)
    for _ in range(8):
        depth, back = numbers.uniform(0.0005, 0.02), numbers.choice((1e-4, 1e-3, 2e-2))
        pressing.go(surface + depth, int(numbers.integers(50, 500)))
        here = float(pressing.sample.position)
        pressing.go(here - back, int(numbers.integers(20, 150)))
    assert pressing.following.watch.state is SensorState.GOOD
    assert Status.SENSOR_FAULT not in pressing.statuses
    assert max(pressing.forces) > 0.3
