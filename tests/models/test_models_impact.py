"""Impacts: closed forms (6) to (14) against quadrature, known solutions and integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from foretouch.errors import SettingError
from foretouch.models import (
    ContactModel,
    ContactState,
    ContinuousSwitching,
    HuntCrossley,
    KelvinVoigt,
    LinearisedContinuousSwitching,
    ThresholdSwitching,
)
from foretouch.reproduction.theory.energy_loss import (
    beta_of,
    damping_ratio,
    energy_loss,
    energy_loss_by_quadrature,
    h_of,
    h_of_gamma_functions,
    loss_exponent,
    loss_scale,
    maximum_depth,
    speed_at_depth,
)
from foretouch.reproduction.theory.impact import integrate_impact, low_damping_error, low_damping_limit

CASES = [(1.5, 0.0), (1.0, 0.3), (0.7, 0.5), (0.2, 0.8), (0.0, 1.0)]
"""(n, alpha) from Hunt-Crossley to Kelvin-Voigt."""

laws = st.tuples(st.floats(100.0, 1e5), st.floats(1.0, 1e3), st.floats(1.0, 1.99), st.floats(0.0, 1.0)).map(
    lambda p: ContinuousSwitching(p[0], p[1], p[2] - p[3], p[3])
)
masses = st.floats(0.01, 10.0)
speeds = st.floats(0.001, 1.0)
quickly = settings(derandomize=True, deadline=None, max_examples=15)


# Closed forms


def test_h_is_gauss_s_theorem_and_grows_from_1_to_three_quarters_of_pi() -> None:
    beta = np.linspace(0.0, 0.5, 101)
    h = h_of(beta)
    np.testing.assert_allclose(h, h_of_gamma_functions(beta), rtol=1e-13)
    assert (np.diff(h) > 0.0).all()
    assert h[0] == 1.0
    assert h[-1] == pytest.approx(3.0 * math.pi / 4.0, rel=1e-14)
    assert h[-1] == pytest.approx(2.3562, abs=5e-5)


def test_gamma_lies_between_2_and_3_and_is_the_slope_form_of_14() -> None:
    s, alpha = np.meshgrid(np.linspace(1.0, 2.0, 51), np.linspace(0.0, 1.0, 51))
    gamma = loss_exponent(s - alpha, alpha)
    assert gamma.min() == 2.0
    assert gamma.max() == 3.0
    slope = (s[1:] - alpha[1:] + 1.0) / alpha[1:]
    np.testing.assert_allclose(gamma[1:], 3.0 - 2.0 / (slope + 1.0), rtol=1e-14)
    assert beta_of(0.0, 1.0) == 0.5


@quickly
@given(law=laws, mass=masses, speed=speeds)
def test_12_is_the_quadrature_of_9(law: ContinuousSwitching, mass: float, speed: float) -> None:
    assert float(energy_loss(law, mass, speed)) == pytest.approx(energy_loss_by_quadrature(law, mass, speed), rel=1e-8)


@quickly
@given(law=laws, mass=masses, speed=speeds)
def test_12_with_the_constants_as_the_paper_writes_them(law: ContinuousSwitching, mass: float, speed: float) -> None:
    k, damping, n, alpha = law.general_form
    a = 2.0 * damping * math.sqrt(2.0 * k / (mass * (n + alpha + 1.0)))
    b = 2.0 * a / (n + alpha + 1.0)
    beta = alpha / (n + alpha + 1.0)
    y = math.sqrt(float(maximum_depth(law, mass, speed)) ** (n + alpha + 1.0))
    expected = b / 3.0 * y ** (3.0 - 2.0 * beta) * float(h_of(beta))
    assert float(energy_loss(law, mass, speed)) == pytest.approx(expected, rel=1e-10)
    assert loss_scale(law, mass) * speed ** (3.0 - 2.0 * beta) == pytest.approx(expected, rel=1e-10)


@quickly
@given(law=laws, mass=masses, speed=speeds)
def test_the_share_lost_is_the_damping_ratio(law: ContinuousSwitching, mass: float, speed: float) -> None:
    _, _, n, alpha = law.general_form
    share = float(energy_loss(law, mass, speed)) / (0.5 * mass * speed**2)
    ratio = float(damping_ratio(law, mass, speed))
    assert share == pytest.approx(4.0 / 3.0 * float(h_of(beta_of(n, alpha))) * ratio, rel=1e-9)


def test_kelvin_voigt_loses_what_a_half_swing_loses() -> None:
    """The damper along x_M sin(omega t) over half a period takes pi B v^2 / (2 omega)."""
    law, mass, speed = KelvinVoigt(6000.0, 1.0), 0.5, 0.1
    omega = math.sqrt(6000.0 / 0.5)
    assert float(energy_loss(law, mass, speed)) == pytest.approx(math.pi * speed**2 / (2.0 * omega))


@quickly
@given(law=laws, mass=masses, speed=speeds, share=st.floats(0.0, 1.0))
def test_7_and_8_conserve_energy(law: ContinuousSwitching, mass: float, speed: float, share: float) -> None:
    deepest = float(maximum_depth(law, mass, speed))
    energy = 0.5 * mass * speed**2
    assert float(law.stored_energy(deepest)) == pytest.approx(energy, rel=1e-10)
    there = float(speed_at_depth(law, mass, speed, share * deepest))
    assert 0.5 * mass * there**2 + float(law.stored_energy(share * deepest)) == pytest.approx(energy, rel=1e-10)


def test_depths_that_are_not_reached_have_no_speed() -> None:
    law = HuntCrossley(3000.0, 10.0, 1.4)
    deepest = float(maximum_depth(law, 0.1, 0.1))
    assert np.isnan(speed_at_depth(law, 0.1, 0.1, [-0.1 * deepest, 1.1 * deepest])).all()


@pytest.mark.parametrize(("mass", "speed"), [(0.0, 0.1), (0.1, 0.0), (0.1, -0.1), (math.nan, 0.1), (0.1, math.inf)])
def test_masses_and_speeds_must_be_positive(mass: float, speed: float) -> None:
    law = HuntCrossley(3000.0, 10.0, 1.4)
    for function in (maximum_depth, energy_loss, energy_loss_by_quadrature, damping_ratio, integrate_impact):
        with pytest.raises(SettingError, match=r"^(mass|speed) = "):
            function(law, mass, speed)


# Integration


@quickly
@given(law=laws, mass=masses, speed=speeds, tension=st.booleans())
def test_energy_is_conserved(law: ContinuousSwitching, mass: float, speed: float, tension: bool) -> None:
    impact = integrate_impact(law, mass, speed, allow_tension=tension, samples=101)
    energy = 0.5 * mass * speed**2
    assert impact.damping_work == pytest.approx(impact.energy_loss, abs=1e-6 * energy)
    assert sum(impact.areas) == pytest.approx(impact.energy_loss, abs=1e-12 * energy)
    stored = law.stored_energy(impact.depth)
    left = 0.5 * mass * impact.velocity**2 + stored
    assert (np.diff(left) <= 1e-6 * energy).all()  # it only ever falls
    assert 0.0 <= impact.restitution < 1.0
    assert impact.maximum_depth <= float(maximum_depth(law, mass, speed)) * (1.0 + 1e-9)
    if not tension:
        assert impact.separated
        assert impact.force.min() >= 0.0


@pytest.mark.parametrize(("n", "alpha"), CASES)
def test_the_loss_is_the_integral_of_the_damping_power(n: float, alpha: float) -> None:
    law = ContinuousSwitching(3000.0, 30.0, n, alpha)
    impact = integrate_impact(law, 0.1, 0.2, samples=20001)
    work = np.trapezoid(law.dissipated_power(impact.depth, impact.velocity), impact.time)
    tolerance = 1e-3 if n == 0.0 else 1e-4  # the sum does not see the jump of the Kelvin-Voigt force at the surface
    assert work == pytest.approx(impact.energy_loss, rel=tolerance)
    assert np.trapezoid(impact.power, impact.time) == pytest.approx(impact.energy_loss, rel=tolerance)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.9])
def test_kelvin_voigt_that_pulls_is_the_damped_swing(ratio: float) -> None:
    """x = v exp(-zeta w t) sin(wd t) / wd is 0 again after half a period; e = exp(-pi zeta / sqrt(1 - zeta^2))."""
    stiffness, mass, speed = 6000.0, 0.5, 0.1
    omega = math.sqrt(stiffness / mass)
    damped = omega * math.sqrt(1.0 - ratio**2)
    impact = integrate_impact(
        KelvinVoigt(stiffness, 2.0 * ratio * math.sqrt(stiffness * mass)), mass, speed, allow_tension=True
    )
    assert impact.restitution == pytest.approx(math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)), rel=1e-7)
    assert impact.duration == pytest.approx(math.pi / damped, rel=1e-7)
    expected = speed / damped * np.exp(-ratio * omega * impact.time) * np.sin(damped * impact.time)
    np.testing.assert_allclose(impact.depth, expected, atol=1e-8 * speed / omega)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.7])
def test_kelvin_voigt_that_does_not_pull_lets_go_where_the_force_is_zero(ratio: float) -> None:
    stiffness, mass, speed = 6000.0, 0.5, 0.1
    damping = 2.0 * ratio * math.sqrt(stiffness * mass)
    omega = math.sqrt(stiffness / mass)
    damped = omega * math.sqrt(1.0 - ratio**2)

    def motion(time: float) -> tuple[float, float]:
        swing = speed / damped * math.exp(-ratio * omega * time)
        x = swing * math.sin(damped * time)
        return x, swing * damped * math.cos(damped * time) - ratio * omega * x

    def force(time: float) -> float:
        x, v = motion(time)
        return stiffness * x + damping * v

    release = brentq(force, 0.5 * math.pi / damped, math.pi / damped, xtol=1e-15)
    depth, velocity = motion(release)
    law = KelvinVoigt(stiffness, damping)
    impact = integrate_impact(law, mass, speed)
    assert impact.rebound_speed == pytest.approx(-velocity, rel=1e-6)
    assert impact.duration == pytest.approx(release + depth / -velocity, rel=1e-6)
    assert float(law.tension_depth(velocity)) == pytest.approx(depth)


@pytest.mark.parametrize("exponent", [1.0, 1.4, 1.9])
@pytest.mark.parametrize("ratio", [0.01, 0.5, 3.0])
def test_hunt_crossley_s_rebound_does_not_depend_on_its_exponent(exponent: float, ratio: float) -> None:
    """m v dv = -x^n (k + lambda v) dx: with r = lambda v_i / k, r - ln(1 + r) = -r e - ln(1 - r e)."""
    stiffness, speed = 3000.0, 0.2
    impact = integrate_impact(HuntCrossley(stiffness, ratio * stiffness / speed, exponent), 0.3, speed)

    def balance(e: float) -> float:
        return ratio - math.log1p(ratio) + ratio * e + math.log1p(-ratio * e)

    expected = brentq(balance, 0.01, min(1.0, 1.0 / ratio) - 1e-12)
    assert impact.restitution == pytest.approx(expected, rel=1e-6)


def test_a_mass_that_is_pulled_back_sticks_to_an_overdamped_material() -> None:
    impact = integrate_impact(KelvinVoigt(6000.0, 500.0), 0.1, 0.1, allow_tension=True)
    assert not impact.separated
    assert impact.rebound_speed == 0.0
    assert impact.energy_loss == pytest.approx(0.5 * 0.1 * 0.1**2)


def test_areas_of_the_two_figures() -> None:
    """Fig. 2: Kelvin-Voigt as printed takes energy once more at release. Fig. 3: Hunt-Crossley does not."""
    kelvin_voigt = integrate_impact(KelvinVoigt(6000.0, 15.0), 0.1, 0.1, allow_tension=True, samples=20001)
    into, back, again = kelvin_voigt.areas
    power = kelvin_voigt.power
    turn, release = kelvin_voigt.depth.argmax(), np.nonzero(power < 0.0)[0][-1]
    assert into == pytest.approx(np.trapezoid(power[:turn], kelvin_voigt.time[:turn]), rel=1e-3)
    assert back == pytest.approx(np.trapezoid(power[turn:release], kelvin_voigt.time[turn:release]), rel=1e-3)
    assert again == pytest.approx(np.trapezoid(power[release:], kelvin_voigt.time[release:]), rel=1e-3)
    assert again > 0.0
    assert kelvin_voigt.force[1] == pytest.approx(15.0 * 0.1, rel=1e-2)  # the shock at first touch
    hunt_crossley = integrate_impact(HuntCrossley(3000.0, 1500.0, 1.4), 0.1, 0.1, allow_tension=True)
    assert hunt_crossley.areas[2] == pytest.approx(0.0, abs=1e-12)
    assert hunt_crossley.force[0] == 0.0
    assert hunt_crossley.force.min() >= 0.0


@pytest.mark.parametrize(("n", "alpha"), CASES)
def test_gamma_is_the_slope_of_the_losses_over_speed(n: float, alpha: float) -> None:
    law, mass = ContinuousSwitching(3000.0, 0.01, n, alpha), 0.1
    speed = np.geomspace(0.01, 0.1, 4)
    loss = [integrate_impact(law, mass, v, samples=2).damping_work for v in speed]
    slope = np.polyfit(np.log(speed), np.log(loss), 1)[0]
    assert slope == pytest.approx(float(loss_exponent(n, alpha)), abs=5e-4)
    np.testing.assert_allclose(loss, energy_loss(law, mass, speed), rtol=2e-3)


def test_the_linearised_law_takes_part_and_its_duration_is_finite() -> None:
    exact = HuntCrossley(3000.0, 30.0, 1.4)
    linearised = LinearisedContinuousSwitching(math.log(3000.0), 1.4, 0.01, 0.0)
    one, other = (integrate_impact(law, 0.5, 0.2) for law in (exact, linearised))
    assert other.restitution == pytest.approx(one.restitution, rel=1e-3)
    assert other.duration == pytest.approx(one.duration, rel=1e-3)


def test_a_chosen_law_bounces_as_by_itself() -> None:
    threshold = ThresholdSwitching(5000.0, 5.0, 3000.0, 1500.0, 1.4, 4000.0)
    by_itself = integrate_impact(KelvinVoigt(5000.0, 5.0), 0.5, 0.2)
    assert integrate_impact(threshold, 0.5, 0.2).rebound_speed == by_itself.rebound_speed


class Remembering(ContactModel):
    """A law with a memory, which no impact can be made of by depth and velocity."""

    law = "remembering"
    parameter_names = ()

    def initial_state(self) -> ContactState:
        return (0.0,)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        return (max(depth, state[0]),), 100.0 * max(depth, 0.0), math.nan


def test_what_cannot_be_integrated_is_refused() -> None:
    with pytest.raises(SettingError, match="must have no memory"):
        integrate_impact(Remembering(), 0.1, 0.1)
    with pytest.raises(SettingError, match="no force below zero"):
        integrate_impact(LinearisedContinuousSwitching(8.0, 1.4, 0.0, 0.0), 0.1, 0.1, allow_tension=True)
    with pytest.raises(SettingError, match="samples"):
        integrate_impact(KelvinVoigt(1.0, 1.0), 0.1, 0.1, samples=1)


def test_an_impact_without_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foretouch.reproduction.theory.impact._MOST_EVALUATIONS", 1000)
    with pytest.raises(SettingError, match=r"^law = .*: an impact of 0.1 kg at 0.1 m/s cannot be integrated"):
        integrate_impact(KelvinVoigt(6000.0, 1e5), 0.1, 0.1, allow_tension=True)


# Where the approximation ends


@pytest.mark.parametrize(("n", "alpha"), CASES)
@pytest.mark.parametrize("tension", [False, True])
def test_the_error_of_12_vanishes_in_proportion_to_the_damping(n: float, alpha: float, tension: bool) -> None:
    ratios = np.geomspace(1e-4, 1e-2, 3)
    errors = [low_damping_error(n, alpha, ratio, allow_tension=tension).relative_error for ratio in ratios]
    order = np.polyfit(np.log(ratios), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.02)


def test_the_error_of_12_in_shares_depends_on_the_damping_ratio_alone() -> None:
    law, mass, speed = ContinuousSwitching(4500.0, 20.0, 0.7, 0.5), 0.3, 0.05
    impact = integrate_impact(law, mass, speed, samples=2)
    relative = float(energy_loss(law, mass, speed)) / impact.energy_loss - 1.0
    same = low_damping_error(0.7, 0.5, float(damping_ratio(law, mass, speed)))
    assert same.relative_error == pytest.approx(relative, rel=1e-5)
    assert same.restitution == pytest.approx(impact.restitution, rel=1e-8)


@pytest.mark.parametrize(
    ("n", "alpha", "ratio", "restitution"),
    [(1.5, 0.0, 0.0993, 0.938), (0.7, 0.5, 0.0839, 0.927), (0.0, 1.0, 0.0518, 0.923)],
)
def test_12_is_wrong_by_a_tenth_at_a_rebound_of_over_nine_tenths(
    n: float, alpha: float, ratio: float, restitution: float
) -> None:
    limit = low_damping_limit(n, alpha, 0.1)
    assert limit.relative_error == pytest.approx(0.1, abs=1e-6)
    assert limit.damping_ratio == pytest.approx(ratio, abs=1e-4)
    assert limit.restitution == pytest.approx(restitution, abs=1e-3)


def test_12_promises_more_than_there_is_at_high_damping() -> None:
    row = low_damping_error(0.0, 1.0, 1.0)
    assert row.approximate_loss == pytest.approx(math.pi)
    assert row.loss < 1.0
