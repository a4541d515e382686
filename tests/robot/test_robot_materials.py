"""Materials: registry, and the properties that every material holds; passivity of the ones with memory."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError, UnknownNameError
from foretouch.models import ContactModel
from foretouch.robot import DEFAULT_MATERIAL, MATERIALS, make_material
from foretouch.robot.materials import HystereticContact, shipped_foam_fit

FOAM = make_material("foam-measured").model
DEEPEST = 1.2 * shipped_foam_fit().measured_depth
FASTEST = 0.3


def forces(model: ContactModel, path: list[float], period: float) -> list[float]:
    state, result = model.initial_state(), []
    velocity = np.diff(path, prepend=0.0) / period
    for depth, speed in zip(path, velocity.tolist(), strict=True):
        state, force, _ = model.advance(state, depth, speed, period)
        result.append(force)
    return result


def work(path: list[float], force: list[float]) -> np.ndarray:
    """Work put in from the untouched state until each step [J]: force at the end of a step times its way."""
    return np.cumsum(np.array(force) * np.diff(path, prepend=0.0))


def moves(period: float, deepest: float, fastest: float) -> st.SearchStrategy[list[float]]:
    """Motions in pieces of constant speed, from the surface, with holds, reversals and leaving contact."""
    piece = st.tuples(st.floats(-0.003, deepest), st.floats(0.002, fastest), st.integers(0, 60))

    def path_of(pieces: list[tuple[float, float, int]]) -> list[float]:
        path, here = [], 0.0
        for goal, speed, hold in pieces:
            count = max(1, math.ceil(abs(goal - here) / (speed * period)))
            path += np.linspace(here, goal, count + 1)[1:].tolist() + [goal] * hold
            here = goal
        return path

    return st.lists(piece, min_size=1, max_size=8).map(path_of)


def test_registry() -> None:
    independent = {"adhesive", "hyperelastic-fe", "mullins", "poroelastic", "sphere-viscoelastic", "thin-layer"}
    pressed_before = {"bone", "foam", "foam-measured", "hand", "hunt-crossley", "kelvin-voigt", "sponge"}
    assert set(MATERIALS) == pressed_before | independent
    assert DEFAULT_MATERIAL in MATERIALS
    with pytest.raises(
        UnknownNameError, match="unknown material 'jelly': choose one of adhesive, bone, foam, foam-measured"
    ):
        make_material("jelly")


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_a_typical_press_stays_within_the_follower_force(name: str) -> None:
    material = make_material(name)
    assert material.name == name
    assert material.provenance
    assert "\n" not in material.description
    period = 1e-3
    count = math.ceil(material.press_depth / (0.01 * period))
    force = forces(material.model, np.linspace(0.0, material.press_depth, count).tolist(), period)
    assert 2.0 < force[-1] < (math.inf if name == "bone" else 15.0)  # on bone the robot's limit ends the press


@pytest.mark.parametrize("name", sorted(MATERIALS))
@settings(max_examples=20)
@given(path=moves(1e-3, 0.012, FASTEST))
def test_force_is_finite_never_negative_and_zero_outside(name: str, path: list[float]) -> None:
    """What pulls may do so from its first touch on, and at the rim of the contact is let go within 2 mm."""
    material = make_material(name)
    force, depth = np.array(forces(material.model, path, 1e-3)), np.array(path)
    assert np.isfinite(force).all()
    outside = depth <= 0.0
    if material.pulls:
        outside &= (np.maximum.accumulate(depth) <= 0.0) | (depth < -0.002) & (np.roll(depth, 1) < -0.002)
    else:
        assert (force >= 0.0).all()
    assert (force[outside] == 0.0).all()


@settings(max_examples=40)
@given(path=moves(5e-4, DEEPEST, FASTEST))
def test_foam_never_gives_more_energy_than_it_took(path: list[float]) -> None:
    assert work(path, forces(FOAM, path, 5e-4)).min() >= -1e-12


@settings(max_examples=30)
@given(path=st.lists(st.floats(-0.005, DEEPEST), min_size=1, max_size=200), period=st.sampled_from([1e-4, 1e-3, 0.1]))
def test_foam_is_passive_for_any_jumps_at_any_period(path: list[float], period: float) -> None:
    force = forces(FOAM, path, period)
    assert np.isfinite(force).all()
    assert work(path, force).min() >= -1e-12


def test_foam_is_passive_in_continuous_time_too() -> None:
    """With the trapezoidal rule on a smooth motion the work agrees with the stepwise one as the step falls."""
    for frequency in (0.5, 3.0):
        time = np.arange(0.0, 3.0, 1e-4)
        path = 0.5 * DEEPEST * (1.0 - np.cos(2.0 * np.pi * frequency * time))
        force = np.array(forces(FOAM, path.tolist(), 1e-4))
        trapezoid = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(path))
        assert trapezoid.min() >= -1e-6
        assert trapezoid[-1] == pytest.approx(work(path.tolist(), force.tolist())[-1], rel=0.03)


def random_laws() -> st.SearchStrategy[HystereticContact]:
    place = st.tuples(st.floats(0.0, 0.008), st.floats(1e-4, 0.008)).map(lambda ab: (ab[0], ab[0] + ab[1]))
    spring = st.tuples(place, st.floats(0.01, 20.0)).map(lambda row: (*row[0], row[1]))
    branch = st.tuples(
        place,
        st.floats(1.0, 5000.0),
        st.one_of(st.floats(0.01, 5.0), st.just(math.inf)),
        st.one_of(st.floats(1e-3, 5.0), st.just(math.inf)),
    ).map(lambda row: (*row[0], *row[1:]))
    return st.builds(
        lambda springs, branches: HystereticContact(tuple(springs), tuple(branches)),
        st.lists(spring, max_size=3),
        st.lists(branch, min_size=3, max_size=3),  # one length of state: compiled once
    )


@settings(max_examples=40)
@given(law=random_laws(), path=moves(1e-3, 0.016, FASTEST))
def test_any_hysteretic_law_is_passive(law: HystereticContact, path: list[float]) -> None:
    assert work(path, forces(law, path, 1e-3)).min() >= -1e-10


def test_foam_force_is_continuous() -> None:
    """A hundredfold finer motion has no jumps: the force moves with the depth, also at touch and at release."""
    time = np.arange(0.0, 1.0, 1e-5)
    path = (0.004 - 0.006 * np.cos(2.0 * np.pi * 2.0 * time)).tolist()
    force = np.array(forces(FOAM, path, 1e-5))
    assert force.max() > 4.0
    assert np.abs(np.diff(force)).max() < 0.02


def test_foam_shows_hysteresis_relaxation_and_a_late_surface() -> None:
    period = 1e-3
    press = np.linspace(0.0, 0.009, 180).tolist()
    force = forces(FOAM, press + [0.009] * 2000 + press[::-1], period)
    middle = 120  # the same depth in and out
    assert force[middle] > force[-1 - middle] + 0.5
    assert force[180] > force[2100] + 0.3
    quick = np.linspace(0.009, 0.0, 30).tolist()
    state = FOAM.initial_state()
    for depth in press + quick[:25]:
        state, last, _ = FOAM.advance(state, depth, 0.0, period)
    assert last == 0.0
    assert state[0] > quick[24] + 1e-4  # the surface has not followed the probe
    for _ in range(3000):
        state, last, _ = FOAM.advance(state, -0.001, 0.0, period)
    assert state[0] < 1e-3


def test_foam_takes_a_depth_that_is_not_finite() -> None:
    state = FOAM.initial_state()
    for depth in np.linspace(0.0, 0.005, 50).tolist():
        state, _, _ = FOAM.advance(state, depth, 0.0, 1e-3)
    after, force, _ = FOAM.advance(state, math.nan, math.nan, 1e-3)
    assert force == 0.0
    assert after[0] == state[0]
    assert all(math.isfinite(value) for value in after)


@pytest.mark.parametrize(
    "tables",
    [
        {"springs": ((-1e-3, 1e-3, 1.0),)},
        {"springs": ((1e-3, 1e-3, 1.0),)},
        {"springs": ((0.0, 1e-3, -1.0),)},
        {"springs": ((0.0, 1e-3, math.nan),)},
        {"springs": (), "branches": ((0.0, 1e-3, math.inf, 1.0, 1.0),)},
    ],
)
def test_bad_tables_are_refused(tables: dict[str, tuple[tuple[float, ...], ...]]) -> None:
    with pytest.raises(SettingError, match=r"must start at 0 or deeper|strengths must be above 0"):
        HystereticContact(**tables)  # type: ignore[arg-type]


def test_importing_the_room_imports_nothing_heavy() -> None:
    check = "import sys, foretouch.robot; sys.exit(any(name in sys.modules for name in ('mujoco', 'numba', 'scipy')))"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0
