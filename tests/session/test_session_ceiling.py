"""The ceiling holds by the safety layer alone: the drive has no limit, the force is the simulator's own."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from commanded import CEILING, MS, NO_LIMIT, Commanded
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from pressed import SPEED, TICK, Pressed, kept

from foretouch.link import Faults
from foretouch.messages import VERSION, Command, Status
from foretouch.robot import MATERIALS

ALL = sorted(MATERIALS)
QUICK = [
    material if material in ("bone", "foam") else pytest.param(material, marks=pytest.mark.long) for material in ALL
]
"""The stiffest and the one that stiffens most; the others are among the long tests."""

KINDS = ("step", "ramp", "sine", "noise", "hammer", "nan", "teleport", "replay", "silence", "clock")


class Hostile(Commanded):
    said: tuple[Command, ...] = ()

    def say(self, command: Command) -> None:
        self.said = (*self.said[-399:], command)
        super().say(command)

    def act(self, kind: str, depth: float, pace: float, ticks: int) -> None:
        """Part of a stream: towards or about a depth below the surface [m], at a pace from 0 to 1."""
        numbers, begin = random.Random(ticks), self.place
        target = self.robot.surface + depth
        for tick in range(ticks):
            share, sign = (tick + 1) / ticks, 1.0 if (tick // max(int(60 * pace), 2)) % 2 else -1.0
            match kind:
                case "step":
                    self.tick(target)
                case "ramp":
                    self.tick(begin + (target - begin) * share)
                case "sine":
                    self.tick(target + 2e-3 * math.sin(200.0 * pace * tick * TICK))
                case "noise":
                    self.tick(target + numbers.gauss(0.0, 10.0 ** (-2.0 - 2.0 * pace)))
                case "hammer":
                    self.tick(target + sign * 5e-3 * pace)
                case "nan":
                    self.tick((math.nan, math.inf, target)[tick % 3])
                case "teleport":
                    self.tick(numbers.choice((-0.9, 0.9, target, 1e9)))
                case "silence":
                    self.tick(None)
                case "clock":
                    self.tick(target, time_ns=max(self.now + numbers.randint(-(10**12), 10**12), 0))
                case "replay":
                    for old in self.said[:: numbers.randint(1, 50)]:
                        self.network.push(self.now, old)
                    self.tick(target if tick % 2 else None)


parts = st.tuples(
    st.sampled_from(KINDS), st.sampled_from((-8e-3, -1e-3, 3e-4, 2e-3, 0.03)), st.floats(0.0, 1.0), st.integers(20, 700)
)
networks = st.sampled_from(
    (
        Faults(0.0),
        Faults(0.02, jitter=0.02, loss=0.2, burst=5.0, seed=1),
        Faults(0.05, reorder=0.2, duplicate=0.2, seed=2),
        Faults(0.0, outage=0.7, seed=3),
        Faults(0.3, stall=0.8, seed=4),
    )
)


@pytest.mark.parametrize("material", QUICK)
@settings(max_examples=6, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate))
@given(stream=st.lists(parts, min_size=2, max_size=5), network=networks)
@pytest.mark.first
def test_no_leader_gets_the_force_over_the_ceiling(
    material: str, stream: list[tuple[str, float, float, int]], network: Faults
) -> None:
    hostile = Hostile(material, network)
    for kind, depth, pace, ticks in stream:
        hostile.act(kind, depth, pace, ticks)
    assert max(hostile.forces) <= CEILING
    kept(hostile.path)
    lowest, highest = hostile.robot.specification.workspace
    assert min(hostile.path) >= lowest - 1e-4  # a path that brakes outwards may pass its aim
    assert max(hostile.path) <= highest + 1e-12


@pytest.mark.parametrize("material", QUICK)
def test_who_is_told_to_be_three_centimetres_inside_presses_with_less_than_the_ceiling(material: str) -> None:
    """Twice: the first time nothing is known of the surface, the second time it is; then slowly, and then at once."""
    pressed = Pressed(material, force_limit=NO_LIMIT)
    surface = pressed.robot.surface
    for place, seconds in ((0.0, 0.4), (surface + 0.03, 3.5), (0.0, 0.5), (surface + 0.03, 2.5)):
        pressed.run(place, seconds)
    kept(pressed.path)
    assert max(pressed.forces) <= CEILING
    reached = pressed.forces[-1] > 0.5 * CEILING or pressed.path[-1] == pytest.approx(surface + 0.03, abs=1e-5)
    assert reached, "a press that is asked for is not held back for nothing"


@pytest.mark.parametrize("material", ["bone", "kelvin-voigt", "foam"])
def test_a_slow_touch_says_nothing_of_a_quick_one(material: str) -> None:
    """The damping of kelvin-voigt, 500 N s/m, is 0.5 N at 1 mm/s and would be 125 N at full speed."""
    pressed = Pressed(material, force_limit=NO_LIMIT)
    surface = pressed.robot.surface
    pressed.run(surface - 1e-3, 0.4)
    for tick in range(1400):
        pressed.run(surface - 1e-3 + 1e-6 * tick, TICK)
    for place in (surface - 0.005, surface + 0.03) * 2:
        pressed.run(place, 0.5)
    assert max(pressed.forces) <= CEILING


def test_what_was_not_reached_is_not_pressed_towards_in_the_silence() -> None:
    """Told to be 3 cm inside a bone, and then nothing: it holds where it is, not where it was told to be."""
    pressed = Pressed("bone", force_limit=NO_LIMIT)
    inside = pressed.robot.surface + 0.03
    pressed.run(inside, 1.5)
    place, force = pressed.path[-1], pressed.forces[-1]
    pressed.run(inside, 0.45, silent=True)
    assert pressed.safety.status is Status.HOLDING
    assert max(pressed.path[-400:]) <= place + 5e-6
    assert max(pressed.forces[-450:]) <= force + 0.2
    pressed.safety.stop("test")
    before = len(pressed.path)
    pressed.run(inside, 0.5)
    assert max(pressed.path[before:]) <= place + 5e-6
    assert pressed.forces[-1] < 1.0


def test_who_holds_goes_back_where_the_force_passes_the_ceiling() -> None:
    """A hand that moves towards a robot that holds: the surface comes nearer by 3 mm."""
    pressed = Pressed("hunt-crossley", force_limit=NO_LIMIT)
    pressed.run(pressed.robot.surface + 0.03, 4.0)
    pressed.run(pressed.path[-1], 0.1, silent=True)
    pressed.robot.surface -= 3e-3
    pressed.run(pressed.path[-1], 0.002, silent=True)
    assert pressed.forces[-1] > CEILING
    pressed.run(pressed.path[-1], 0.3, silent=True)
    assert pressed.safety.status is Status.HOLDING
    assert pressed.forces[-1] == pytest.approx(0.88 * CEILING, abs=0.1)


@pytest.mark.parametrize("material", ["bone", "hand", pytest.param("hunt-crossley", marks=pytest.mark.long)])
@pytest.mark.first
def test_a_follower_that_begins_in_contact_does_not_take_the_force_for_an_offset(material: str) -> None:
    hostile = Hostile(material, Faults(0.0))
    for tick in range(4000):
        hostile.tick(hostile.robot.surface - 2e-3 + min(2e-5 * tick, 0.03))
    assert hostile.forces[-1] > 0.83 * CEILING
    hostile.begin()
    hostile.go(hostile.robot.surface + 0.03, 700)
    assert max(hostile.forces) <= CEILING
    hostile.begin()
    held = hostile.forces[-1]
    hostile.go(None, 700)
    assert hostile.following.safety.status is Status.UNLOADING
    assert hostile.forces[-1] < held - 0.3, "nobody speaks to it: it goes back"


@pytest.mark.parametrize("material", ["bone", "foam", "sponge"])
def test_a_retreat_goes_out_the_way_in_until_it_is_free_and_no_further(material: str) -> None:
    pressed = Pressed(material, force_limit=NO_LIMIT, retreats=True)
    surface = pressed.robot.surface
    pressed.run(surface + 0.03, 4.5)
    before = len(pressed.path)
    pressed.run(surface + 0.03, 1.8, silent=True)
    assert pressed.safety.status is Status.RETREATING
    way = pressed.path[before:]
    assert np.diff(way).max() <= 1e-5, "never deeper on the way out"
    assert surface - 0.008 < way[-1] < surface - 0.004
    assert np.ptp(way[-100:]) < 1e-5


def test_after_an_outage_nothing_that_waited_is_followed_and_the_way_back_is_slow() -> None:
    """A stall hands over a second of commands at once; the follower goes to the newest, at the return speed."""
    hostile = Hostile("hunt-crossley", Faults(0.0))
    surface = hostile.robot.surface
    for tick in range(800):
        hostile.tick(surface + min(1e-5 * tick, 5e-3))
    waiting = []
    for tick in range(1000):
        hostile.sequence += 1
        place = surface + 0.02 * math.sin(0.01 * tick)
        waiting.append(Command(VERSION, hostile.sequence, hostile.now + MS, place, 0, False, "enemy", 1))
        hostile.tick(None)
    assert hostile.following.safety.status is Status.UNLOADING
    before = len(hostile.path)
    for command in waiting:
        hostile.network.push(hostile.now, command)
    hostile.go(surface + 4e-3, 600)
    way = np.array(hostile.path[before:])
    assert np.diff(way).max() <= 0.05 * TICK * 1.01
    assert way.max() <= surface + 5e-3, "those that waited asked for 2 cm"
    assert way[-1] == pytest.approx(surface + 4e-3, abs=1e-5)


@pytest.mark.parametrize("material", QUICK)
def test_silence_holds_at_50_ms_and_unloads_within_two_seconds(material: str) -> None:
    pressed = Pressed(material, force_limit=NO_LIMIT)
    inside = pressed.robot.surface + 0.03
    pressed.run(inside, 1.5)
    pressed.run(inside, 0.049, silent=True)
    assert pressed.safety.status < Status.HOLDING
    pressed.run(inside, 0.002, silent=True)
    before = len(pressed.path)
    assert pressed.safety.status is Status.HOLDING
    pressed.run(inside, 0.445, silent=True)
    assert pressed.safety.status is Status.HOLDING
    assert np.ptp(pressed.path[before:]) < 5e-5
    pressed.run(inside, 2.2, silent=True)
    assert pressed.safety.status is Status.UNLOADING
    assert max(pressed.forces[-200:]) < 1.0
    assert np.diff(pressed.path).min() >= -SPEED * TICK * (1 + 1e-9)
