"""The bound on an impact that nobody expected: against exact integration, and against the simulated arm."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.models import KelvinVoigt
from foretouch.robot import RcmArm, make_robot
from foretouch.robot.materials.catalogue import Material
from foretouch.session.safety.kernel import REACTION, impact_impedance
from foretouch.session.safety.safety import SafetyLimits

SURFACE, TICK = 0.01, 1e-3
STIFFEST, MOST_DAMPED = SafetyLimits().stiffest, SafetyLimits().most_damped
FELT = 0.15
"""Force at which a contact is noticed here [N]."""


def worst_drive(stiffness: float, damping: float, mass: float, reaction: float) -> float:
    """Largest force for each m/s: the probe keeps its speed for the reaction time, and is then left alone."""
    depth, speed, step = 0.0, 1.0, 1e-6
    largest = damping
    for tick in range(round((reaction + 4.0 * math.sqrt(mass / stiffness)) / step)):
        if tick * step >= reaction:
            speed -= step * (stiffness * depth + damping * max(speed, 0.0)) / mass
        depth += step * speed
        largest = max(largest, stiffness * depth + damping * max(speed, 0.0))
        if speed <= 0.0:
            break
    return largest


@pytest.mark.parametrize(("stiffness", "damping"), [(1e5, 500.0), (1e5, 0.0), (1e4, 50.0), (3e3, 500.0), (1e5, 100.0)])
def test_no_drive_that_keeps_to_the_assumptions_presses_harder(stiffness: float, damping: float) -> None:
    reached, bound = worst_drive(stiffness, damping, 0.4, 3e-3), impact_impedance(stiffness, damping, 0.4, 3e-3)
    assert reached <= bound * (1.0 + 1e-3)
    if damping in (0.0, 500.0):  # where the bound is met: nothing damps, or the damping comes with the first speed
        assert reached == pytest.approx(bound, rel=2e-3)


def test_it_is_the_energy_of_a_mass_on_a_spring_where_nothing_is_late_or_damped() -> None:
    assert impact_impedance(1e5, 0.0, 0.4, 0.0) == pytest.approx(math.sqrt(0.4 * 1e5))


@settings(max_examples=50)
@given(st.floats(1e2, 1e6), st.floats(0.0, 1e3), st.floats(0.05, 50.0), st.floats(0.0, 0.05), st.floats(0.0, 1.0))
def test_it_bounds_every_speed_that_is_left(k: float, b: float, mass: float, reaction: float, left: float) -> None:
    """The largest of what may happen after the reaction is the closed form, wherever it lies."""
    bound = impact_impedance(k, b, mass, reaction)
    assert b * left + math.sqrt((k * reaction) ** 2 + mass * k * (1.0 - left**2)) <= bound * (1.0 + 1e-9)
    speeds = np.linspace(0.0, 1.0, 2001)
    reached = float(np.max(b * speeds + np.sqrt((k * reaction) ** 2 + mass * k * (1.0 - speeds**2))))
    assert reached >= bound * (1.0 - 1e-2)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=12),
    st.floats(0.0, 500.0),
    st.floats(0.0, 3e-3),
    st.floats(1e-4, 2e-3),
)
def test_nor_does_any_spring_whose_slope_stays_below(
    slopes: list[float], damping: float, reaction: float, length: float
) -> None:
    """Soft, level or weaker at first and stiff behind: what counts is the slope, and not the force over the depth."""
    stiffness, mass, speed, step = 1e5, 0.4, 0.02, 2e-6
    bound = impact_impedance(stiffness, damping, mass, reaction) * speed
    depth, elastic, largest = 0.0, 0.0, damping * speed
    for tick in range(50_000):
        depth += speed * step
        slope = slopes[int(depth / length)] if depth < length * len(slopes) else 1.0
        elastic = max(elastic + slope * stiffness * speed * step, 0.0)
        largest = max(largest, elastic + damping * speed)
        if tick * step >= reaction:
            speed -= step * (elastic + damping * speed) / mass
        if speed <= 0.0:
            break
    assert largest <= bound * 1.01


def struck(stiffness: float, damping: float, speed: float) -> float:
    """Largest force where the simulated arm is told to go on evenly, and to stop once it feels something [N]."""
    law = KelvinVoigt(stiffness=stiffness, damping=damping)
    arm: RcmArm = make_robot(Material("m", "m", "this test", law, press_depth=1e-3, surface=SURFACE), seed=1,
                             force_limit=1000.0)  # fmt: skip
    told, sample, largest, felt = SURFACE - 2e-3, arm.read(), 0.0, False
    for _ in range(100):
        sample = arm.exchange(told)
    for _ in range(round(4e-3 / speed / TICK)):
        felt = felt or sample.sensor_force - arm.specification.tool_force(sample.acceleration) - 0.3 > FELT
        told += 0.0 if felt else speed * TICK
        sample = arm.exchange(told)
        largest = max(largest, sample.exact_force)
    assert felt
    return largest


def test_the_simulated_arm_keeps_it_with_all_that_is_assumed_of_it() -> None:
    """Its sensor and drive are late by less than what the safety reckons with; with less they would not be."""
    ratios = {}
    for stiffness, damping, speed in itertools.product((3e3, 3e4, STIFFEST), (1e-3, 50.0, MOST_DAMPED), (0.01, 0.02)):
        bound = impact_impedance(stiffness, damping, 0.4, REACTION) * speed
        # What is felt before it is noticed is no part of the reaction.
        ratios[stiffness, damping, speed] = struck(stiffness, damping, speed) / (bound + FELT)
    assert max(ratios.values()) <= 1.0
    assert max(ratios.values()) > 0.6, "nor is it far from what happens"
    sooner = impact_impedance(STIFFEST, 1e-3, 0.4, 0.5e-3) * 0.02
    assert struck(STIFFEST, 1e-3, 0.02) > sooner + FELT
