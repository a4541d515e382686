"""A hand that holds a device: its equation, its friction, its energy, and what the device can render."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from foretouch.devices import GRIPS, BrowserOperator, Device, DeviceSpecification, Grip, Hand, ScriptedOperator
from foretouch.devices.hand_kernel import Held, move
from foretouch.errors import SettingError

TICK = 1_000_000
quick = settings(derandomize=True, deadline=None, max_examples=40)
NOBODY = Grip(0.0, 0.0, 0.0)
SMOOTH = DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0, delay=0.0)


class At(Device):
    """Wants to be where it is told to."""

    name = "at"
    closed_loop = False

    def __init__(self, position: float = 0.0) -> None:
        self.position = position
        self.holds_clutch = False

    def read(self, now_ns: int) -> float:
        return self.position

    def render(self, force: float) -> float:
        raise AssertionError("the intention feels nothing")

    @property
    def clutched(self) -> bool:
        return self.holds_clutch


def held(mass=0.25, damping=6.0, device_damping=2.0, stiffness=400.0, friction=0.0, **motion):
    both = damping + device_damping
    return Held.new(mass=mass, damping=both, hand_damping=damping, stiffness=stiffness, friction=friction, **motion)


def run(hand: Hand, seconds: float, start_ns: int = 0) -> np.ndarray:
    return np.array([hand.read(start_ns + i * TICK) for i in range(round(seconds * 1000))])


# --- the equation -----------------------------------------------------------------------------------------------------

parameters = st.tuples(
    st.floats(0.01, 2.0), st.floats(0.0, 100.0), st.floats(0.0, 50.0), st.just(0.0) | st.floats(1e-6, 1e4)
)


@quick
@given(parameters, st.floats(-0.01, 0.01), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(0.0, 10.0))
@example((0.001, 1000.0, 1000.0, 1e5), 0.01, 0.5, 0.3, 10.0)
def test_motion_is_that_of_the_linear_equation(numbers, position, velocity, aim_speed, force):
    mass, damping, device_damping, stiffness = numbers
    hand = held(mass, damping, device_damping, stiffness, position=position, velocity=velocity)
    move(hand, 0.002, aim_speed, force, 0.02)
    # Position, velocity, the intention, and one: dx/dt = A x with constant A.
    both = damping + device_damping
    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0
    matrix[1] = -stiffness / mass, -both / mass, stiffness / mass, (damping * aim_speed - force) / mass
    matrix[2, 3] = aim_speed
    exact = expm(matrix * 0.02) @ [position, velocity, 0.002, 1.0]
    scale = abs(position) + abs(velocity) + 0.01 + 0.02 * force / mass
    state = hand[0].position, hand[0].velocity
    assert state == pytest.approx(tuple(exact[:2]), rel=1e-9, abs=1e-11 * scale * max(both / mass, 1.0))


@pytest.mark.parametrize("grip", GRIPS)
def test_a_step_of_the_force_settles_at_force_over_stiffness(grip):
    hand = Hand(At(0.01), GRIPS[grip], SMOOTH)
    run(hand, 0.1)
    assert hand.render(1.5) == 1.5
    moved = run(hand, 4.0, 100 * TICK)
    assert moved[0] == pytest.approx(0.01, abs=1e-4)
    assert moved[-1] == pytest.approx(0.01 - 1.5 / GRIPS[grip].stiffness, abs=1e-9)
    # Underdamped: on its way it swings through by exp(-pi zeta / sqrt(1 - zeta^2)).
    mass, both = GRIPS[grip].mass + SMOOTH.mass, GRIPS[grip].damping + SMOOTH.damping
    zeta = both / (2.0 * math.sqrt(GRIPS[grip].stiffness * mass))
    swing = (moved[-1] - moved.min()) / (0.01 - moved[-1])
    assert swing == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)), rel=1e-3)


def test_the_force_is_held_and_pushes_out():
    hand = Hand(At(), NOBODY, DeviceSpecification(mass=0.5, damping=0.0, friction=0.0, resolution=0.0, delay=0.0))
    hand.read(0)
    hand.render(2.0)
    assert hand.read(10 * TICK) == pytest.approx(-0.5 * 4.0 * 0.01**2, rel=1e-12)
    assert hand.read(20 * TICK) == pytest.approx(-0.5 * 4.0 * 0.02**2, rel=1e-12)
    hand.render(0.0)
    assert hand.exact_velocity == pytest.approx(-0.08)
    assert hand.read(30 * TICK) == pytest.approx(-0.5 * 4.0 * 0.02**2 - 0.0008, rel=1e-12)


@quick
@given(st.integers(0, 10**6), st.sampled_from(sorted(GRIPS)), st.floats(0.0, 0.5))
def test_it_does_not_matter_where_the_motion_is_cut(seed, grip, friction):
    random = np.random.default_rng(seed)
    whole = held(GRIPS[grip].mass + 0.1, GRIPS[grip].damping, 2.0, GRIPS[grip].stiffness, friction)
    cut = whole.copy()
    aim = 0.0
    for _ in range(40):
        speed, force = random.uniform(-0.2, 0.2), random.uniform(0.0, 2.0)
        move(whole, aim, speed, force, 5e-3)
        for part in range(9):
            move(cut, aim + speed * part * 5e-3 / 9, speed, force, 5e-3 / 9)
        aim += speed * 5e-3
    for motion in ("position", "velocity"):
        assert whole[motion] == pytest.approx(cut[motion], rel=1e-7, abs=1e-9)


# --- friction ---------------------------------------------------------------------------------------------------------


def test_friction_alone_stops_the_hand_where_and_when_it_must():
    speed, friction, mass = 0.1, 0.4, 0.2
    hand = held(mass, 0.0, 0.0, 0.0, friction, velocity=speed)
    stop = speed * mass / friction
    move(hand, 0.0, 0.0, 0.0, 0.5 * stop)
    assert hand[0].velocity == pytest.approx(0.5 * speed, rel=1e-12)
    move(hand, 0.0, 0.0, 0.0, stop)
    assert hand[0].position == pytest.approx(0.5 * speed * stop, rel=1e-12)
    assert hand[0].velocity == 0.0


@pytest.mark.parametrize("force", [0.0, 0.1, 0.299])
def test_below_the_friction_nothing_moves_at_all(force):
    hand = Hand(At(0.01), GRIPS["normal"], DeviceSpecification(damping=2.0, friction=0.3, resolution=0.0))
    hand.read(0)
    hand.render(force)
    assert (run(hand, 10.0) == 0.01).all()
    assert hand.exact_velocity == 0.0


@pytest.mark.parametrize("grip", GRIPS)
def test_what_has_moved_comes_to_rest_within_the_cone_and_stays(grip):
    friction = 0.2
    hand = Hand(At(0.01), GRIPS[grip], DeviceSpecification(damping=2.0, friction=friction, resolution=0.0))
    hand.read(0)
    hand.render(3.0)
    rest = run(hand, 3.0)[-1]
    assert hand.exact_velocity == 0.0
    assert rest < 0.01 - 1e-3
    assert abs(GRIPS[grip].stiffness * (0.01 - rest) - 3.0) <= friction
    assert (run(hand, 5.0, 3000 * TICK) == rest).all()


def test_a_slow_intention_drags_the_device_as_soon_as_it_pulls_enough():
    hand = held(0.2, 5.0, 2.0, 200.0, 0.3)
    # k w t + b w = F at the start: nothing before, motion after.
    begin = (0.3 - 5.0 * 0.01) / (200.0 * 0.01)
    move(hand, 0.0, 0.01, 0.0, begin - 1e-6)
    assert hand[0].position == hand[0].velocity == 0.0
    move(hand, 0.01 * (begin - 1e-6), 0.01, 0.0, 2e-3)
    assert hand[0].position > 0.0
    move(hand, 0.01 * (begin + 2e-3 - 1e-6), 0.01, 0.0, 5.0)
    # Then it follows at that speed, behind by what friction and the device's damping take.
    assert hand[0].velocity == pytest.approx(0.01, rel=1e-6)
    assert 0.01 * (begin + 5.002 - 1e-6) - hand[0].position == pytest.approx((0.3 + 2.0 * 0.01) / 200.0, rel=1e-5)


# --- energy -----------------------------------------------------------------------------------------------------------


def energy(hand, aim):
    return 0.5 * hand[0].mass * hand[0].velocity ** 2 + 0.5 * hand[0].stiffness * (aim - hand[0].position) ** 2


@pytest.mark.parametrize("grip", GRIPS)
def test_energy_is_work_of_the_force_less_what_the_dampers_take(grip):
    random = np.random.default_rng(7)
    hand = held(GRIPS[grip].mass + 0.1, GRIPS[grip].damping, 2.0, GRIPS[grip].stiffness, position=0.012)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    aim, work, lost = 0.01, 0.0, 0.0
    begin = energy(hand, aim)
    for _ in range(500):
        force, before = random.uniform(0.0, 5.0), hand.copy()
        for node, weight in zip(nodes, weights, strict=True):
            inside = before.copy()
            move(inside, aim, 0.0, force, 0.5e-3 * (1.0 + node))
            lost += 0.5e-3 * weight * inside[0].damping * inside[0].velocity ** 2
        move(hand, aim, 0.0, force, 1e-3)
        work -= force * (hand[0].position - before[0].position)
    assert lost > 1e-3
    assert energy(hand, aim) - begin == pytest.approx(work - lost, rel=1e-9, abs=1e-9 * lost)


@quick
@given(st.integers(0, 10**6), st.floats(0.0, 1.0))
def test_friction_makes_no_energy(seed, friction):
    random = np.random.default_rng(seed)
    hand = held(friction=friction, velocity=random.uniform(-0.3, 0.3))
    for _ in range(300):
        force, before, begin = random.uniform(0.0, 2.0), energy(hand, 0.0), hand[0].position
        move(hand, 0.0, 0.0, force, 1e-3)
        moved = hand[0].position - begin
        assert energy(hand, 0.0) <= before - force * moved - friction * abs(moved) + 1e-14


# --- what the device can render ---------------------------------------------------------------------------------------


def wall_ripple(grip: Grip, specification: DeviceSpecification, stiffness: float, wall: float = 1e-3) -> float:
    """How much the device still swings [m] 8 s after it was pushed against a sampled spring with about 1 N."""
    intention = At(0.0)
    hand = Hand(intention, grip, specification)
    hand.read(0)
    intention.position = wall + 1.0 / grip.stiffness
    end = []
    for i in range(1, 8500):
        position = hand.read(i * TICK)
        hand.render(stiffness * max(position - wall, 0.0))
        if i > 8000:
            end.append(hand.exact_position)
    assert np.max(end) > wall
    return float(np.ptp(end))


@pytest.mark.parametrize("damping", [2.0, 5.0])
@pytest.mark.parametrize("delay", [0.0, 2e-4, 5e-4, 1e-3])
def test_a_sampled_spring_is_stable_up_to_the_bound_and_not_beyond(damping, delay):
    """The hand really is so late: the bound of Diolaiti et al. is where it begins to swing."""
    device = DeviceSpecification(damping=damping, friction=0.0, resolution=0.0, delay=delay)
    bound = device.largest_stiffness(1e-3)
    assert bound == pytest.approx(damping / (0.5e-3 + delay))
    loosely = Grip(0.0, 0.0, 2.0)
    assert wall_ripple(loosely, device, 0.9 * bound) < 1e-6
    assert wall_ripple(loosely, device, 1.1 * bound) > 1e-4


@pytest.mark.parametrize("grip", GRIPS)
def test_within_the_bound_every_grip_is_stable(grip):
    device = DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0, delay=5e-4)
    assert wall_ripple(GRIPS[grip], device, 0.95 * device.largest_stiffness(1e-3)) < 1e-9


def test_bound_counts_the_rendered_damping_of_either_sign():
    device = DeviceSpecification(damping=2.0, delay=5e-4)
    assert device.largest_stiffness(1e-3, 0.5) == device.largest_stiffness(1e-3, -0.5) == pytest.approx(1500.0)
    assert device.largest_stiffness(1e-3, 2.0) == device.largest_stiffness(1e-3, -7.0) == 0.0
    for period, damping in ((0.0, 0.0), (math.nan, 0.0), (1e-3, math.inf)):
        with pytest.raises(SettingError):
            device.largest_stiffness(period, damping)


@pytest.mark.parametrize(
    ("friction", "count", "stiffness"),
    [(0.3, 1e-3, 600.0), (0.0, 1e-3, 100.0), (0.0, 1e-5, 2000.0), (0.0, 0.0, 2000.0)],
)
def test_one_count_of_the_encoder_changes_the_force_by_little(friction, count, stiffness):
    device = DeviceSpecification(damping=2.0, friction=friction, resolution=count, delay=5e-4)
    assert device.largest_stiffness(1e-3) == pytest.approx(stiffness)


# --- ticks, encoder, clutch -------------------------------------------------------------------------------------------


def test_the_encoder_shows_the_nearest_whole_count():
    hand = Hand(
        ScriptedOperator(0.012, 0.009, seed=1), GRIPS["normal"], DeviceSpecification(damping=2.0, resolution=5e-5)
    )
    for i in range(3000):
        shown = hand.read(i * TICK)
        assert abs(shown - hand.exact_position) <= 2.5e-5 + 1e-15
        assert shown / 5e-5 == pytest.approx(round(shown / 5e-5), abs=1e-9)


def test_the_device_tells_its_limit():
    hand = Hand(At(), GRIPS["soft"], DeviceSpecification(damping=2.0, force_limit=3.0))
    assert [hand.render(force) for force in (1.0, 5.0, -1.0, math.nan, math.inf)] == [1.0, 3.0, 0.0, 0.0, 3.0]


def test_a_late_tick_finds_the_hand_where_it_would_have_been():
    late, punctual = (Hand(At(0.01), GRIPS["soft"], SMOOTH) for _ in range(2))
    for hand in (late, punctual):
        hand.read(0)
        hand.render(1.0)
    run(punctual, 0.3)
    assert late.read(299 * TICK) == pytest.approx(punctual.exact_position, abs=1e-13)


def test_a_force_acts_a_delay_later_and_no_longer_than_the_watchdog_lets_it():
    """Free of friction and damping a hand of 0.1 kg moves by f t^2 / 2 m."""
    device = DeviceSpecification(damping=0.0, friction=0.0, resolution=0.0, delay=5e-4, watchdog=2e-2)
    hand = Hand(At(0.0), Grip(0.0, 0.0, 0.0), device)
    hand.read(0)
    hand.render(1.0)
    for now, acted in ((1e-3, 5e-4), (1.1e-2, 1.05e-2), (2.05e-2, 2e-2)):
        hand.read(round(now * 1e9))
        assert hand.exact_velocity == pytest.approx(-10.0 * acted, rel=1e-9)
        assert hand.exact_position == pytest.approx(-5.0 * acted**2, rel=1e-9)
    hand.read(10**8)
    assert hand.exact_velocity == pytest.approx(-0.2, rel=1e-9)


def test_a_night_counts_as_a_second():
    slept, awake = (Hand(At(0.01), GRIPS["soft"], SMOOTH) for _ in range(2))
    for hand in (slept, awake):
        run(hand, 0.1)
        hand.render(1.0)
    begin = time.perf_counter()
    slept.read(8 * 3600 * 10**9)
    assert time.perf_counter() - begin < 5.0  # 29 million ticks, each computed, take a minute
    awake.read(1099 * TICK)
    assert slept.exact_position == awake.exact_position


def test_before_the_first_tick_nothing_is_known():
    hand = Hand(At(0.02), GRIPS["soft"], DeviceSpecification(damping=2.0, resolution=0.0), clutch=((0.0, 1.0),))
    assert math.isnan(hand.exact_position)
    assert math.isnan(hand.exact_velocity)
    assert math.isnan(hand.intention)
    assert not hand.clutched
    assert hand.read(5 * 10**9) == hand.exact_position == hand.intention == 0.02
    assert hand.exact_velocity == 0.0
    assert hand.clutched


def test_clutch_is_held_in_its_times_and_when_the_operator_says_so():
    operator = At()
    hand = Hand(operator, GRIPS["normal"], DeviceSpecification(damping=2.0), clutch=((1.0, 1.5), (2.0, 2.25)))
    held = []
    for i in range(3000):
        hand.read(10**12 + i * TICK)
        held.append(hand.clutched)
    assert np.flatnonzero(np.diff(np.array(held).astype(int))).tolist() == [999, 1499, 1999, 2249]
    assert not hand.clutched
    operator.holds_clutch = True
    assert hand.clutched


def test_a_mouse_can_be_held_by_a_hand():
    mouse = BrowserOperator(ScriptedOperator(0.012, 0.009, seed=3), deepest=0.04)
    hand = Hand(mouse, GRIPS["normal"], DeviceSpecification(damping=2.0))
    assert hand.name == "browser"
    assert hand.intention_device is mouse
    run(hand, 2.0)
    for i in range(800):
        if i % 50 == 0:
            mouse.take(0.03, True, (2000 + i) * TICK)
        hand.read((2000 + i) * TICK)
    assert hand.intention == pytest.approx(0.03, abs=1e-5)
    assert hand.exact_position == pytest.approx(0.03, abs=1e-3)


# --- settings ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (lambda: DeviceSpecification(damping=2.0, mass=-0.1), "mass = -0.1: must lie between 0.001 and 10"),
        (lambda: DeviceSpecification(damping=2.0, mass=0.0), "mass = 0.0: must lie between 0.001"),
        (lambda: DeviceSpecification(damping=-1.0), "damping = -1.0: must lie between 0"),
        (lambda: DeviceSpecification(damping=2.0, friction=math.nan), "friction = nan: must lie between 0"),
        (lambda: DeviceSpecification(damping=2.0, force_limit=0.0), "force_limit = 0.0: must be finite and above 0"),
        (lambda: DeviceSpecification(damping=2.0, resolution=0.1), "resolution = 0.1: must lie between 0"),
        (lambda: Grip(-0.1, 1.0, 1.0), "mass = -0.1: must lie between 0"),
        (lambda: Grip(0.1, math.inf, 1.0), "damping = inf: must lie between 0"),
        (lambda: Grip(0.1, 1.0, -1.0), "stiffness = -1.0: must lie between 0"),
        (lambda: Hand(At(), NOBODY, SMOOTH, ((2.0, 1.0),)), "clutch = .*: must be 0 <= start < end"),
        (lambda: Hand(At(), NOBODY, SMOOTH, ((0.0, math.nan),)), "clutch = .*: must be 0 <= start < end"),
        (lambda: Hand(Hand(At(), NOBODY, SMOOTH), NOBODY, SMOOTH), "intention = 'at': must be an operator"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(make, rule):
    with pytest.raises(SettingError, match=rule) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("grip", GRIPS.values())
def test_grips_get_stiffer_and_are_neither_loose_nor_dead(grip):
    assert 0.4 < grip.damping / (2.0 * math.sqrt(grip.stiffness * grip.mass)) < 0.7


def test_grips_are_those_of_the_documentation():
    page = (Path(__file__).parents[2] / "docs" / "rooms" / "devices.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", page, re.MULTILINE)
    assert {name: Grip(*map(float, numbers)) for name, *numbers in rows} == dict(GRIPS)


def test_grips_are_ordered():
    for quantity in ("mass", "damping", "stiffness"):
        numbers = [getattr(GRIPS[name], quantity) for name in ("soft", "normal", "stiff")]
        assert numbers == sorted(numbers)
        assert len(set(numbers)) == 3
