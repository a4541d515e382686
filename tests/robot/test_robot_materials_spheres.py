"""Solutions of contact mechanics: a sphere on a viscoelastic, poroelastic and layered ground, and on rubbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from foretouch.devices import ScriptedOperator
from foretouch.errors import SettingError
from foretouch.models import ContactModel, advance
from foretouch.robot import MATERIALS, Material, RcmArm, make_material, make_robot
from foretouch.robot.materials import (
    AdhesiveSphere,
    MullinsSphere,
    PoroelasticSphere,
    TabulatedContact,
    ThinLayer,
    ViscoelasticSphere,
)
from foretouch.session.conformance import check_material, failed

NAMES = ("adhesive", "hyperelastic-fe", "mullins", "poroelastic", "sphere-viscoelastic", "thin-layer")
PERIOD = 1e-3


def follow(model: ContactModel, path: np.ndarray, period: float = PERIOD) -> np.ndarray:
    state, force = model.initial_state(), np.empty(path.size)
    for index, depth in enumerate(path.tolist()):
        state, force[index], _ = advance(model, state, depth, 0.0, period)
        assert all(map(math.isfinite, state))
        assert state == tuple(map(float, state))
    return force


def work(path: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Work put in from the untouched state until each step [J]: force at the end of a step times its way."""
    return np.cumsum(force * np.diff(path, prepend=0.0))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.first
def test_conformance(name: str) -> None:
    assert failed(check_material(lambda: make_material(name), name=name)) == []


PUSHING = tuple(name for name in NAMES if not MATERIALS[name]().pulls)


@pytest.mark.parametrize("name", PUSHING)
@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    shares=st.lists(st.floats(-0.5, 1.3), min_size=1, max_size=150),
    period=st.sampled_from([1e-5, 5e-4, 1e-3, 0.1, 10.0]),
)
def test_material_is_passive_for_any_jumps_at_any_period(name: str, shares: list[float], period: float) -> None:
    material = make_material(name)
    path = material.press_depth * np.array(shares)
    force = follow(material.model, path, period)
    assert force.min() >= 0.0
    assert (force[path <= 0.0] == 0.0).all()
    assert work(path, force).min() >= -1e-12


@settings(max_examples=100, derandomize=True, deadline=None)
@given(shares=st.lists(st.floats(-0.5, 1.3), min_size=1, max_size=150))
def test_what_pulls_gives_back_at_most_the_energy_of_its_surface(shares: list[float]) -> None:
    """Work in is at least the energy of elasticity and surface, which is lowest where nothing acts, and 0 when free."""
    gives_back_no_more(0.005 * np.array(shares))


def gives_back_no_more(path: np.ndarray) -> float:
    """Hold that for a path [m], and return the least work on the way [J]."""
    lowest = surface_energy(STICKY, EASE)
    state, done, before, least = STICKY.initial_state(), 0.0, 0.0, 0.0
    for depth in path.tolist():
        state, force, _ = STICKY.advance(state, depth, 0.0, PERIOD)
        done, before = done + force * (depth - before), depth
        least = min(least, done)
        assert done >= (lowest if state[0] > 0.0 else 0.0) - 1e-12
    return least


def test_a_quick_touch_and_a_quick_release_make_no_energy() -> None:
    """Drawn in slowly, it gives what the jump at the surface has left of it; torn off in one step, all is paid."""
    slowly, left = np.linspace(1e-7, EASE, 3000), surface_energy(STICKY, EASE) - surface_energy(STICKY, 0.0)
    assert left < -2e-4
    assert gives_back_no_more(np.concatenate([slowly, [-0.005]] * 3)) == pytest.approx(left, rel=0.01)
    assert gives_back_no_more(np.concatenate([[-0.002], slowly] * 3)) == pytest.approx(left, rel=0.01)


STICKY = AdhesiveSphere(modulus=150e3, adhesion=35.0)
EASE = brentq(lambda depth: STICKY.force(STICKY.root_at(depth)), 0.0, 0.01)
"""Depth at which it neither pulls nor pushes [m]."""


def surface_energy(law: AdhesiveSphere, depth: float) -> float:
    """Energy of a contact at a depth above that of a free sphere [J]: elastic, by the stress, less w a^2 pi."""
    a = law.root_at(depth) ** 2
    flat = depth - a**2 / (3.0 * law.radius)
    elastic = law.modulus * (a * flat**2 + 4.0 * a**5 / (45.0 * law.radius**2))
    return elastic - math.pi * law.adhesion * a**2


@pytest.mark.parametrize("name", NAMES)
def test_nonsense_and_great_depths_leave_finite_numbers(name: str) -> None:
    model = make_material(name).model
    path = np.array([0.001, math.nan, math.inf, -math.inf, 1e300, 5.0, 1.0, 0.001, -1.0, 0.002])
    assert np.isfinite(follow(model, path)).all()
    state = model.initial_state()
    for depth in (0.001, math.nan, math.inf):
        state, force, _ = model.advance(state, depth, math.nan, PERIOD)
        assert math.isfinite(force)


@pytest.mark.parametrize("name", PUSHING)
@pytest.mark.first
def test_force_is_continuous_and_converges_with_the_step(name: str) -> None:
    material = make_material(name)
    coarse, fine = (
        follow(material.model, 0.5 * material.press_depth * (1.0 - np.cos(np.pi * np.arange(0.0, 3.0, h))), h)
        for h in (1e-3, 1e-4)
    )
    assert np.abs(np.diff(fine)).max() < 0.01 * fine.max()
    assert np.abs(coarse - fine[::10]).max() < 0.02 * fine.max()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.first
def test_arm_presses_the_material_by_script(name: str) -> None:
    robot = make_robot(name, seed=0)
    material = robot.material
    script = ScriptedOperator(material.surface, material.press_depth, 0)
    samples = [robot.exchange(script.read(tick * 1_000_000)) for tick in range(6000)]
    force = np.array([sample.exact_force for sample in samples])
    assert np.isfinite(force).all()
    assert 2.0 < force.max() < 13.0
    assert (force == 0.0).any()
    assert (-1.0 < force.min() < -0.9) if material.pulls else force.min() == 0.0
    position = np.array([sample.exact_position for sample in samples])
    assert np.abs(np.diff(position)).max() < 1e-4


# A viscoelastic half-space


VISCOELASTIC = ViscoelasticSphere(modulus=400e3, relaxation=((0.35, 0.05), (0.25, 0.7)))


def modulus(time: float) -> float:
    """E*(t) [Pa]."""
    return 400e3 * (1.0 - sum(g * -math.expm1(-time / tau) for g, tau in VISCOELASTIC.relaxation))


def hertz(depth: float) -> float:
    """x^(3/2) sqrt(R) 4 / 3 [m^2]."""
    return 4.0 / 3.0 * math.sqrt(VISCOELASTIC.radius) * max(depth, 0.0) ** 1.5


def test_a_step_of_depth_relaxes_with_the_modulus() -> None:
    force = follow(VISCOELASTIC, np.full(2001, 0.004))
    for index in (0, 20, 100, 700, 2000):
        assert force[index] == pytest.approx(modulus(index * PERIOD) * hertz(0.004), rel=5e-4)


def test_a_ramp_is_lee_and_radoks_integral_in_closed_form() -> None:
    """x = c t: F = E* sum (g_i times) the integral of e^{-(t - s) / tau} 3/2 s^(1/2), by quadrature."""
    speed, period = 0.004, 1e-3
    time = period * np.arange(1, 1001)
    force = follow(VISCOELASTIC, speed * time, period)
    for index in (199, 499, 999):
        end = float(time[index])
        exact = quad(lambda s, end=end: modulus(end - s) * 1.5 * math.sqrt(s), 0.0, end, epsabs=1e-9)[0]
        assert force[index] == pytest.approx(exact * hertz(speed), rel=4e-3)


@pytest.mark.parametrize("rate", [0.5, 1.5, 6.0])
def test_a_press_and_its_release_are_tings_solution(rate: float) -> None:
    """By Ting's two integrals and a search for t_1, with nothing in common with the rings."""
    deepest, period = 0.004, 2e-4
    time = period * np.arange(1, round(1.0 / rate / period) + 1)

    def depth(t: float) -> float:
        return 0.5 * deepest * (1.0 - math.cos(2.0 * math.pi * rate * t))

    def speed(t: float) -> float:
        return math.pi * rate * deepest * math.sin(2.0 * math.pi * rate * t)

    def left(earlier: float, now: float) -> float:
        return quad(lambda s: modulus(now - s) * speed(s), earlier, now, limit=200)[0]

    def load(earlier: float, now: float) -> float:
        return quad(lambda s: modulus(now - s) * 1.5 * math.sqrt(depth(s)) * speed(s), 0.0, earlier, limit=200)[0]

    force = follow(VISCOELASTIC, np.array([depth(t) for t in time.tolist()]), period)
    top = 0.5 / rate
    seen = {"grows": 0, "shrinks": 0, "left": 0}
    for share in (0.2, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.8, 0.9):
        index = round(share / rate / period) - 1
        now = float(time[index])
        earlier = now
        if now > top * (1.0 + 1e-9):
            earlier = brentq(left, 0.0, top, args=(now,)) if left(0.0, now) > 0.0 else 0.0
        exact = 4.0 / 3.0 * math.sqrt(VISCOELASTIC.radius) * load(earlier, now)
        assert force[index] == pytest.approx(exact, abs=6e-3 * force.max())
        seen["left" if earlier == 0.0 else "shrinks" if earlier < now else "grows"] += 1
    assert min(seen.values()) >= 1


def test_what_follows_meets_a_surface_that_is_not_back() -> None:
    """A second press is softer; once the surface is back, after some seconds, one is the first one again."""
    press = 0.002 * (1.0 - np.cos(2.0 * np.pi * np.arange(500) / 500))
    first = follow(VISCOELASTIC, press)
    again = follow(VISCOELASTIC, np.concatenate([press, press]))[500:]
    late = follow(VISCOELASTIC, np.concatenate([press, np.full(7000, -0.001), press]))[7500:]
    assert again[50] == 0.0 < first[50]
    assert again.max() < 0.97 * first.max()
    assert late == pytest.approx(first, abs=2e-3)


def test_rings_are_hertz_at_their_depths_and_between() -> None:
    elastic = replace(VISCOELASTIC, relaxation=())
    for j in (1, 8, 20, 64):
        depth = elastic.deepest * (j / elastic.rings) ** 2
        assert follow(elastic, np.array([depth]))[0] == pytest.approx(400e3 * hertz(depth), rel=1e-12)
    for depth in np.linspace(0.02, 1.0, 300) * elastic.deepest:
        assert follow(elastic, np.array([depth]))[0] == pytest.approx(400e3 * hertz(depth), rel=6e-3)


# A gel that drains


def test_a_held_press_drains_as_hu_and_others_say() -> None:
    law = make_material("poroelastic").model
    assert isinstance(law, PoroelasticSphere)
    for depth in (0.001, 0.006):
        force = follow(law, np.full(8001, depth))
        first = 16.0 / 3.0 * law.shear_modulus * math.sqrt(law.radius) * depth**1.5
        last = first / (2.0 * (1.0 - law.poisson_ratio))
        assert force[0] == pytest.approx(first, rel=1e-12)
        for index in (1, 10, 100, 1000, 8000):
            scaled = law.diffusivity * index * PERIOD / (law.radius * depth)
            exact = 0.491 * math.exp(-0.908 * math.sqrt(scaled)) + 0.509 * math.exp(-1.679 * scaled)
            assert (force[index] - last) / (first - last) == pytest.approx(exact, abs=5e-3)


def test_a_small_contact_drains_sooner() -> None:
    law = make_material("poroelastic").model
    halves = []
    for depth in (0.001, 0.004):
        force = follow(law, np.full(20001, depth))
        halves.append(int(np.argmax(force < 0.5 * (force[0] + force[-1]))))
    assert halves[1] / halves[0] == pytest.approx(4.0, rel=0.05)  # as the square of the contact radius


# A thin layer


def layer_force(radius: float, count: int = 60) -> tuple[float, float]:
    """Depth and force at a contact radius, all by R = h = E* = 1, by the integral equation of a bonded layer, nu = 1/2.

    The pressure is the transform of phi, with phi(x) less the integral of its kernel over 0 to a equal to
    2 / pi (depth - x^2), and phi(a) = 0; the layer's compliance over the half-space's at the wave number u is L(u).
    """
    nodes, weights = leggauss(count)
    x, w = 0.5 * radius * (nodes + 1.0), 0.5 * radius * weights
    nodes, weights = leggauss(400)
    u, v = 12.0 * (nodes + 1.0), 12.0 * weights
    compliance = (2.0 * np.sinh(2.0 * u) - 4.0 * u) / (2.0 * np.cosh(2.0 * u) + 2.0 + 4.0 * u * u)
    waves = np.cos(np.outer(np.append(x, radius), u))
    kernel = 2.0 / math.pi * (waves * (v * (1.0 - compliance))) @ waves[:-1].T * w
    one, square = (
        np.linalg.solve(np.eye(count) - kernel[:-1], right)
        for right in (np.full(count, 2.0 / math.pi), 2.0 / math.pi * x * x)
    )
    depth = (2.0 / math.pi * radius**2 + kernel[-1] @ square) / (2.0 / math.pi + kernel[-1] @ one)
    return float(depth), float(math.pi * w @ (depth * one - square))


@pytest.mark.parametrize(("radius", "tolerance"), [(0.1, 0.002), (0.4, 0.003), (0.6, 0.01), (0.8, 0.025), (1.0, 0.06)])
def test_a_layer_is_what_its_integral_equation_says(radius: float, tolerance: float) -> None:
    depth, force = layer_force(radius)
    law = ThinLayer(modulus=0.75, thickness=1.0, retardation=1.0, radius=1.0)
    assert law.elastic(depth) == pytest.approx(force, rel=tolerance)


def test_a_layer_is_a_kelvin_voigt_solid() -> None:
    law = make_material("thin-layer").model
    assert isinstance(law, ThinLayer)
    speed, period = 0.02, 1e-4
    force = follow(law, speed * period * np.arange(1, 1001), period)
    for index in (299, 999):
        depth = speed * period * (index + 1)
        slope = (law.elastic(1.001 * depth) - law.elastic(0.999 * depth)) / (0.002 * depth)
        assert force[index] == pytest.approx(law.elastic(depth) + law.retardation * slope * speed, rel=5e-3)
    held = follow(law, np.full(2000, 0.002))
    assert held[-1] == pytest.approx(law.elastic(0.002), rel=1e-12)


def test_the_surface_of_a_layer_comes_back_late() -> None:
    law = make_material("thin-layer").model
    assert isinstance(law, ThinLayer)
    state, _, _ = law.advance(law.initial_state(), 0.002, 0.0, PERIOD)
    for _ in range(10):
        state, force, _ = law.advance(state, -0.001, 0.0, PERIOD)
        assert force == 0.0
    assert state[0] / law.elastic(0.002) == pytest.approx(math.exp(-0.01 / law.retardation), rel=0.06)


# Rubbers


def test_mullins_softens_what_was_pressed_before_and_nothing_else() -> None:
    law = make_material("mullins").model
    assert isinstance(law, MullinsSphere)
    first = np.linspace(0.0, 0.002, 201)[1:]
    path = np.concatenate([first[:150], first[148::-1], first])
    force = follow(law, path)
    virgin = 4.0 / 3.0 * law.modulus * math.sqrt(law.radius) * first**1.5
    assert force[:150] == pytest.approx(virgin[:150], rel=1e-12)
    assert force[299:449] == pytest.approx(np.append(force[150:299][::-1], virgin[149]), rel=1e-9)
    assert force[449:] == pytest.approx(virgin[150:], rel=1e-12)
    energy = 0.4 * first * virgin
    width = law.energy + law.growth * energy[149]
    softer = virgin[75] * (1.0 - math.erf((energy[149] - energy[75]) / width) / law.softening)
    assert force[299 + 75] == pytest.approx(softer, rel=1e-12)
    lost = work(path[:299], force[:299])[-1]
    assert 0.2 * energy[149] < lost < energy[149] / law.softening


def test_jkr_in_closed_form() -> None:
    """Pull-off under a load, -3/2 pi w R, and at a displacement, -5/6 pi w R at its depth; Hertz without adhesion."""
    weak = math.pi * STICKY.adhesion * STICKY.radius
    roots = np.linspace(STICKY.least_root, 0.1, 200001)
    assert min(map(STICKY.force, roots.tolist())) == pytest.approx(-1.5 * weak, rel=1e-6)
    assert STICKY.force(STICKY.least_root) == pytest.approx(-5.0 / 6.0 * weak, rel=1e-12)
    assert STICKY.force(STICKY.root_at(0.0)) == pytest.approx(-4.0 / 3.0 * weak, rel=1e-9)
    spring = (math.pi**2 * STICKY.adhesion**2 * STICKY.radius / STICKY.modulus**2) ** (1.0 / 3.0)
    assert STICKY.release_depth == pytest.approx(-0.75 * spring, rel=1e-12)
    for depth in (STICKY.release_depth + 1e-6, 0.0, 0.001, 0.005):
        root = STICKY.root_at(depth)
        found = root**4 / STICKY.radius - math.sqrt(2.0 * math.pi * STICKY.adhesion / STICKY.modulus) * root
        assert found == pytest.approx(depth, abs=1e-12)
    dry = replace(STICKY, adhesion=1e-12)
    assert dry.force(dry.root_at(0.002)) == pytest.approx(
        4.0 / 3.0 * dry.modulus * math.sqrt(dry.radius) * 0.002**1.5, rel=1e-4
    )


def test_a_sphere_jumps_in_at_the_surface_and_lets_go_beyond_it() -> None:
    path = np.concatenate([np.linspace(-0.003, 0.003, 6001), np.linspace(0.003, -0.003, 6001)])
    force = follow(STICKY, path)
    inwards, outwards = force[:6001], force[6001:][::-1]
    assert (inwards[path[:6001] < 0.0] == 0.0).all()
    assert inwards[3002] == pytest.approx(-4.0 / 3.0 * math.pi * 35.0 * 0.006, rel=0.02)
    held = path[:6001] > 1e-5
    assert outwards[held] == pytest.approx(inwards[held], abs=1e-9)
    pulled = path[:6001][outwards < 0.0]
    assert pulled.min() == pytest.approx(STICKY.release_depth, abs=2e-6)
    assert outwards.min() == pytest.approx(-1.5 * math.pi * 35.0 * 0.006, rel=1e-4)


def test_the_force_is_the_slope_of_the_energy() -> None:
    """JKR's force against the energy of a flat punch and a sphere less that of the surface, and stable in a."""
    for depth in (-0.001, 0.0, 0.002):
        slope = (surface_energy(STICKY, depth + 1e-7) - surface_energy(STICKY, depth - 1e-7)) / 2e-7
        assert STICKY.force(STICKY.root_at(depth)) == pytest.approx(slope, abs=1e-5)

        def energy(a: float, depth: float = depth) -> float:
            flat = depth - a**2 / (3.0 * STICKY.radius)
            elastic = STICKY.modulus * (a * flat**2 + 4.0 * a**5 / (45.0 * STICKY.radius**2))
            return elastic - math.pi * STICKY.adhesion * a**2

        a = STICKY.root_at(depth) ** 2
        best = minimize_scalar(energy, bounds=(0.8 * a, 1.2 * a), method="bounded", options={"xatol": 1e-9})
        assert best.x == pytest.approx(a, rel=1e-3)


def test_an_arm_is_pulled_only_by_what_pulls() -> None:
    """The probe on a slow way out, past the surface: the sensor sees the pull, unless the material is said to push."""
    sticky = make_material("adhesive")
    smallest = []
    for material in (sticky, replace(sticky, pulls=False)):
        robot = RcmArm(material, seed=0)
        path = np.concatenate([np.linspace(0.0, 0.012, 600), np.linspace(0.012, 0.005, 1000)])
        samples = [robot.exchange(position) for position in path.tolist()]
        felt = [sample.sensor_force - robot.specification.tool_force(sample.acceleration) - 0.3 for sample in samples]
        smallest.append((min(sample.exact_force for sample in samples), min(felt[200:])))
    assert smallest[0] == pytest.approx((-0.99, -0.99), abs=0.15)
    assert smallest[1] == pytest.approx((0.0, 0.0), abs=0.15)


def test_a_table_is_met_and_smooth_and_never_falls() -> None:
    law = TabulatedContact((0.0, 0.001, 0.002, 0.004, 0.005), (0.0, 0.5, 2.0, 2.1, 7.0))
    assert follow(law, np.array(law.depth)) == pytest.approx(law.force, abs=1e-12)
    path = np.linspace(0.0, 0.007, 70001)
    force = follow(law, path)
    assert (np.diff(force) >= 0.0).all()
    slope = np.diff(force[10:]) / np.diff(path[10:])
    assert np.abs(np.diff(slope)).max() < 0.01 * slope.max()
    assert np.ptp(np.diff(force[60000:])) < 1e-12


def test_finite_elements_are_hertz_at_small_depths_and_the_table_is_between() -> None:
    """Hertz's force with Dimitriadis's first two terms of the thickness at nu = 0.45; left-out rows are found again."""
    law = make_material("hyperelastic-fe").model
    assert isinstance(law, TabulatedContact)
    for depth, force in list(zip(law.depth, law.force, strict=True))[1:6]:
        half_space = 4.0 / 3.0 * 100e3 / (1.0 - 0.45**2) * math.sqrt(0.006) * depth**1.5
        thickness = math.sqrt(0.006 * depth) / 0.012
        assert force / half_space == pytest.approx(1.0 + 1.041 * thickness + 1.084 * thickness**2, rel=0.01)
    coarse = TabulatedContact(law.depth[::2] + law.depth[-1:], law.force[::2] + law.force[-1:])
    for depth, force in list(zip(law.depth, law.force, strict=True))[3::2]:
        assert coarse.advance((), depth, 0.0, PERIOD)[1] == pytest.approx(force, rel=2e-3, abs=1e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ViscoelasticSphere(0.0, ()),
        lambda: ViscoelasticSphere(1e5, ((0.5, 1.0), (0.5, 1.0))),
        lambda: ViscoelasticSphere(1e5, ((0.5, math.inf),)),
        lambda: ViscoelasticSphere(1e5, (), rings=1),
        lambda: PoroelasticSphere(1e5, 0.6, 1e-5),
        lambda: ThinLayer(1e5, 0.0, 0.01),
        lambda: MullinsSphere(1e5, 1.0, 1e-3),
        lambda: AdhesiveSphere(1e5, -1.0),
        lambda: TabulatedContact((0.0, 0.001), (0.0, 1.0)),
        lambda: TabulatedContact((0.0, 0.001, 0.002), (0.0, 1.0, 1.0)),
        lambda: TabulatedContact((0.0, 0.001, 0.002), (0.1, 1.0, 2.0)),
        lambda: TabulatedContact((0.0, 0.001, 0.002), (0.0, 1.0, 2.0, 3.0)),
        lambda: Material("a", "b", "c", STICKY, press_depth=0.0),
    ],
)
def test_bad_numbers_are_refused(make: object) -> None:
    with pytest.raises(SettingError, match=r"must be|below 1|must lie"):
        make()  # type: ignore[operator]
