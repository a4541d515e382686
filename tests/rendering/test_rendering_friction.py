"""Friction at the hand: sticks, slides, stays in the cone, and never gives out energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.rendering import FrictionRenderer

T = 1e-3
UP = (0.0, 0.0, 1.0)


def test_it_sticks_as_a_spring_and_slides_at_the_cone() -> None:
    friction = FrictionRenderer(2000.0)
    forces = [friction.update((x, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T)[0] for x in np.arange(0.0, 1e-3, 1e-5).tolist()]
    np.testing.assert_allclose(forces, -np.minimum(2000.0 * np.arange(0.0, 1e-3, 1e-5), 0.8), atol=1e-12)
    assert friction.sliding
    back = [friction.update((1e-3 - x, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T)[0] for x in (0.0, 4e-4, 8e-4, 1e-3)]
    assert back == pytest.approx([-0.8, 0.0, 0.8, 0.8])  # Coulomb's loop, with the springs of Dahl at its ends


def test_the_bristle_lets_go_where_it_is_pressed_less() -> None:
    friction = FrictionRenderer(2000.0)
    for x in (0.0, 4e-4):
        friction.update((x, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T)
    assert friction.update((4e-4, 0.0, 0.0), UP, 1.0, 0.4, 0.0, T)[0] == pytest.approx(-0.4)
    assert friction.update((4e-4, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T)[0] == pytest.approx(-0.4)  # and stays let go
    assert friction.update((4e-4, 0.0, 0.0), UP, 0.0, 0.4, 0.0, T) == (0.0, 0.0, 0.0)
    assert friction.update((5e-4, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T) == (0.0, 0.0, 0.0)  # a new contact


def test_it_yields_as_softly_as_the_surface_does() -> None:
    friction = FrictionRenderer(5000.0)
    forces = [friction.update((x, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T, 800.0)[0] for x in np.arange(0.0, 5e-4, 1e-5)]
    assert forces == pytest.approx((-800.0 * np.arange(0.0, 5e-4, 1e-5)).tolist())
    before = forces[-1]
    assert friction.update((4.9e-4, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T, 1600.0)[0] == pytest.approx(before)
    assert friction.update((4.9e-4, 0.0, 0.0), UP, 2.0, 0.4, 0.0, T, 400.0)[0] == pytest.approx(before / 4.0)


def test_viscous_friction_is_added_to_what_the_bristle_gives_in_steady_sliding() -> None:
    friction = FrictionRenderer(1000.0)
    for step in range(400):
        force = friction.update((0.05 * T * step, 0.0, 0.0), UP, 5.0, 0.5, 3.0, T)
    assert friction.sliding
    assert force == pytest.approx((-0.5 * 5.0 - 3.0 * 0.05, 0.0, 0.0), rel=1e-6)


@given(
    seed=st.integers(0, 10_000),
    viscous=st.floats(0.0, 20.0),
    stiffness=st.floats(10.0, 1e5),
    damping=st.floats(0.1, 10.0),
    speed=st.floats(1e-4, 2.0),
)
def test_device_and_friction_never_give_out_energy(
    seed: int, viscous: float, stiffness: float, damping: float, speed: float
) -> None:
    """Forces are held for a tick while the hand moves on; normal force, mu and normal change as they like."""
    random = np.random.default_rng(seed)
    steps = 400
    moves = np.cumsum(random.normal(0.0, 0.3, (steps, 3)), axis=0)
    moves = speed * T * moves / np.abs(moves).max() + random.normal(0.0, 1e-6, (steps, 3))
    place = np.cumsum(moves, axis=0)
    normals = np.array(UP) + random.uniform(0.0, 0.5) * np.cumsum(random.normal(0.0, 0.05, (steps, 3)), axis=0)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    pressed = np.maximum(random.normal(2.0, 3.0, steps), -0.1) if seed % 2 else np.full(steps, 5.0)
    mu = random.uniform(0.0, 1.5, steps)
    bristles = 10.0 ** random.uniform(1.0, 6.0, steps) if seed % 3 else np.full(steps, math.inf)
    excess = random.uniform(0.0, 1.0, steps) * (seed % 2)  # a cone that is wider at rest: what sticks, then slips
    friction = FrictionRenderer(stiffness, damping)
    given_out = 0.0
    for k in range(steps - 1):
        given = place[k].tolist(), normals[k].tolist(), pressed[k], mu[k], viscous, T, bristles[k], excess[k]
        force = friction.update(*given)
        assert given_out + friction.stored <= 1e-12 * (1.0 + abs(given_out))
        size = math.hypot(*force)
        fastest = float(np.linalg.norm(moves, axis=1).max()) / T
        largest = (mu[k] + excess[k]) * pressed[k] + min(viscous, 0.5 * damping) * fastest if pressed[k] > 0.0 else 0.0
        assert size <= largest + 1e-9
        assert abs(np.dot(force, normals[k])) <= 1e-9 * max(size, 1.0)
        given_out += float(np.dot(force, moves[k + 1])) - damping / T * float(moves[k + 1] @ moves[k + 1])


def test_a_hand_at_rest_feels_no_chatter() -> None:
    """An encoder of 10 um that flickers between two counts: the force flickers by the bristle's count and no more."""
    friction = FrictionRenderer(1000.0, 2.0)
    random = np.random.default_rng(2)
    for step in range(300):
        friction.update((0.05 * T * step, 0.0, 0.0), UP, 2.0, 0.5, 1.0, T)
    rest = 0.05 * T * 299
    forces = np.array(
        [
            friction.update((rest + 1e-5 * float(random.integers(2)), 0.0, 0.0), UP, 2.0, 0.5, 1.0, T)[0]
            for _ in range(2000)
        ]
    )
    assert np.abs(np.diff(forces[100:])).max() < 1000.0 * 1e-5 + 1.0 * 1e-5 / T
    assert forces[100:].std() < 0.01
    still = [friction.update((rest, 0.0, 0.0), UP, 2.0, 0.5, 1.0, T)[0] for _ in range(1000)]
    assert still[-1] == pytest.approx(still[-2], abs=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", range(6))
def test_numbers_that_are_none_give_no_force(bad: float, which: int) -> None:
    friction = FrictionRenderer(1000.0, 2.0)
    friction.update((0.0, 0.0, 0.0), UP, 2.0, 0.5, 1.0, T)
    values: list[object] = [(1e-4, 0.0, 0.0), UP, 2.0, 0.5, 1.0, T]
    values[which] = (bad, 0.0, 0.0) if which < 2 else bad
    force = friction.update(*values)  # type: ignore[arg-type]
    assert all(map(math.isfinite, force))
    if which < 5:
        assert force == (0.0, 0.0, 0.0)


def test_settings_out_of_range_are_refused() -> None:
    for stiffness, damping in ((-1.0, 1.0), (math.nan, 1.0), (1.0, -1.0), (1.0, math.nan)):
        with pytest.raises(SettingError):
            FrictionRenderer(stiffness, damping)


def drag(excess: float, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed of a hand that pulls a device slowly over a surface by a spring, and the force on it, over 8 s.

    The device has 0.1 kg and 2 N s/m, the spring 400 N/m and 2 N s/m; it is drawn at 4 mm/s.
    """
    friction = FrictionRenderer(1000.0, 2.0)
    place = speed = force = 0.0
    speeds, forces = [], []
    for step in range(8000):
        for _ in range(10):
            pull = 400.0 * (4e-3 * step * T - place) + 2.0 * (4e-3 - speed)
            speed += 1e-4 / 0.1 * (pull - 2.0 * speed + force)
            place += 1e-4 * speed
        seen = round(place / resolution) * resolution
        force = friction.update((seen, 0.0, 0.0), UP, 2.0, 0.5, 0.5, T, 1500.0, excess)[0]
        speeds.append(speed)
        forces.append(force)
    return np.array(speeds), np.array(forces)


@pytest.mark.parametrize("resolution", [1e-6, 1e-5])
def test_a_slow_hand_sticks_and_slips_on_rubber_and_does_not_buzz(resolution: float) -> None:
    speeds, forces = drag(0.3, resolution)
    slips = np.diff((speeds > 8e-3).astype(int))[1000:] > 0
    assert 3 <= slips.sum() <= 40  # some each second, as the spring loads again
    assert np.ptp(forces[1000:]) > 0.2
    stuck = np.convolve(speeds, np.ones(20) / 20, "same") < 1e-3
    assert stuck[1000:].mean() > 0.1
    assert np.abs(np.diff(forces))[1000:][stuck[1001:]].max() < 0.05  # not felt: a count of the encoder or two
    smooth, _ = drag(0.0, resolution)
    assert (np.abs(smooth[2000:] - 4e-3) < 3e-3).all()  # without an excess it only slides
