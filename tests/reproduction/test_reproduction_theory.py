"""Sections of the paper's theory: their numbers against computations that do not use the models' code."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import SettingError
from foretouch.models import ContinuousSwitching
from foretouch.reproduction import Claim, counted, make_section, write_report
from foretouch.reproduction.figures import impacts as hunt_crossley
from foretouch.reproduction.figures import impacts as kelvin_voigt
from foretouch.reproduction.figures.fig4 import area, measured_exponent
from foretouch.reproduction.figures.fig5 import CASES, breaking_depth, phi_range, press_error, scaled_error, share_small
from foretouch.reproduction.figures.impacts import MASS, SPEED
from foretouch.reproduction.figures.simulations import turns
from foretouch.reproduction.figures.table1 import Choice, choices, distance, recursive_fit
from foretouch.reproduction.presses import STEP_LAWS, WAVES, linearisation_press, two_presses
from foretouch.reproduction.questions.shock import comparable_law, greatest_pull
from foretouch.reproduction.run import SHOWN
from foretouch.reproduction.theory.linearisation import TABLE_1

SLOW = ("fig2", "shock", "fig4", "fig5", "table1")

section = cache(make_section)


def claim(name: str, words: str) -> Claim:
    """The one claim of a section with some words in it."""
    result = [claim for claim in section(name).claims if words in claim.claim]
    assert len(result) == 1
    return result[0]


def column(name: str, table: str, key: str) -> np.ndarray:
    return np.asarray(section(name).data[table][key])


def damped_oscillator() -> tuple[float, float, float]:
    """Duration, rebound speed and greatest speed on the way out of the impact of Fig. 2, in closed form."""
    k, b = kelvin_voigt.VOIGT.stiffness, kelvin_voigt.VOIGT.damping
    decay = b / (2.0 * MASS)
    turn = math.sqrt(k / MASS - decay**2)

    def speed_out(time: float) -> float:
        return -SPEED * math.exp(-decay * time) * (math.cos(turn * time) - decay / turn * math.sin(turn * time))

    end = math.pi / turn
    # The force is m times the second derivative of exp(-d t) sin(w t), zero where tan(w t) = 2 d w / (d^2 - w^2).
    free = (math.atan2(2.0 * decay * turn, decay**2 - turn**2)) / turn
    return end, speed_out(end), speed_out(free)


def hunt_crossley_rebound(ratio: float) -> float:
    """Speed out over speed in of a Hunt-Crossley impact: v dv / (k + lambda v) = -x^n dx / m, integrated both ways."""

    def spent(speed: float) -> float:
        return ratio * speed - math.log1p(ratio * speed)

    return float(brentq(lambda out: spent(-out) - spent(1.0), 0.0, min(1.0, (1.0 - 1e-15) / ratio), xtol=1e-15))


@pytest.mark.parametrize("name", ["fig3", "fig6", *(pytest.param(name, marks=pytest.mark.long) for name in SLOW)])
def test_a_section_is_whole_and_the_same_again(name: str, tmp_path: Path) -> None:
    made = section(name)
    assert made.name == name
    assert made.title
    assert made.text
    assert made.claims
    for table in made.data.values():
        sizes = {np.asarray(values).shape for values in table.values()}
        assert len(sizes) == 1
        assert len(next(iter(sizes))) == 1
    for row in made.claims:
        assert row.verdict in {"holds", "holds under stated choice", "does not hold"}
        assert all(row.as_row().values())
        assert ("choice: " in row.setting) == (row.verdict == "holds under stated choice")
        assert "nan" not in row.measured.split()
    made.figure.savefig(tmp_path / "figure.png", dpi=40)
    if name in {"fig2", "fig6"}:  # the quick ones
        assert make_section(name).claims == made.claims


def test_the_command_writes_page_figures_data_and_claims(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["reproduce", "--only", "fig6", "--out", str(tmp_path), "--json"])
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)
    assert [row["claim"] for row in rows] == [claim.claim for claim in section("fig6").claims]
    assert {path.name for path in tmp_path.iterdir()} == {
        "index.html",
        "fig6.svg",
        "fig6.png",
        "fig6-trajectory.parquet",
    }


def test_the_page_begins_with_its_summary_and_each_claim_is_a_folded_card_with_its_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("foretouch.reproduction.run.embedded", lambda figure, caption: caption)  # drawn above
    monkeypatch.setattr("foretouch.reproduction.run._write_files", lambda *arguments: None)
    sections = [section(name) for name in ("fig2", "fig5")]
    claims = [claim for one in sections for claim in one.claims]
    page = write_report(tmp_path, sections, {"command": "foretouch reproduce"}).read_text()
    counts = counted(claims)
    assert sum(counts.values()) == len(claims)
    summary, _, rest = page.partition("Equations that are named")
    assert "doi:10.1007/s40747-021-00464-0" in summary
    assert f"Of {len(claims)} claims {counts['holds']} hold as printed" in summary
    assert "Error of (18) against (15)" in summary  # one of the five that matter
    for verdict, (style, sign, words) in SHOWN.items():
        assert rest.count(f'<details class="claim {style}"><summary><b>{sign} {words}</b>') == counts[verdict]
    assert "<details open" not in page
    named = set(re.findall(r'href="#([^"]+)"', page))
    assert {"fig2", "fig5", "equation-1", "equation-15", "equation-18"} <= named
    assert named <= set(re.findall(r'id="([^"]+)"', page))
    assert 'id="equation-16"' in page  # a text names it


def test_what_the_terminal_is_told_fits_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for words in (["reproduce", "--only", "fig3"], ["reproduce", "--only", "fig6"]):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
        assert max(map(len, result.stdout.splitlines())) <= 80
    assert "Of 2 claims: 1 hold as printed, 0 under a stated choice, 1 not." in result.stdout
    assert "measured: 2 compressions and 1 restitution" in " ".join(result.stdout.split())


def test_kelvin_voigt_impact_is_the_damped_oscillator() -> None:
    end, rebound, fastest = damped_oscillator()
    assert column("fig2", "printed", "time_s")[-1] == pytest.approx(end, rel=1e-8)
    assert column("fig2", "printed", "velocity_m_s")[-1] == pytest.approx(-rebound, rel=1e-7)
    energies = [0.5 * MASS * SPEED**2, -0.5 * MASS * fastest**2, 0.5 * MASS * (fastest**2 - rebound**2)]
    output = claim("fig2", "negative force").measured
    for number, energy in enumerate(energies, 1):
        assert f"H{number} = {1e3 * energy:.2f}" in output
    assert energies[2] > 0.0
    assert column("fig2", "rendered", "force_N").min() == 0.0
    assert claim("fig2", "square").verdict == "holds"


def test_hunt_crossley_impact_is_its_integral() -> None:
    ratio = hunt_crossley.HUNT.damping * SPEED / hunt_crossley.HUNT.stiffness
    rebound = SPEED * hunt_crossley_rebound(ratio)
    assert column("fig3", "impact", "velocity_m_s")[-1] == pytest.approx(-rebound, rel=1e-7)
    assert f"H2 = {-5e2 * MASS * rebound**2:.2f}" in claim("fig3", "no energy").measured
    assert claim("fig3", "no energy").verdict == claim("fig3", "no shock").verdict == "holds"
    assert claim("fig3", "cube").verdict == "holds under stated choice"


@pytest.mark.parametrize("ratio", [1e-3, 0.1, 0.25, 1.0])
def test_exponents_of_hunt_crossley_follow_from_its_integral(ratio: float) -> None:
    def lost(speed: float) -> float:
        return speed**2 * (1.0 - hunt_crossley_rebound(ratio * speed) ** 2)

    expected = math.log(lost(1.01) / lost(0.99)) / math.log(1.01 / 0.99)
    assert measured_exponent(1.4, 0.0, ratio) == pytest.approx(expected, abs=2e-6)
    assert measured_exponent(1.9, 0.0, ratio) == pytest.approx(expected, abs=2e-6)


@pytest.mark.long  # the figure is computed whole
def test_the_area_of_5_and_its_ends() -> None:
    n, alpha = area(51)
    assert (n + alpha).min() == pytest.approx(1.0, abs=1e-12)
    assert (n + alpha).max() < 2.0
    assert (alpha.min(), alpha.max()) == (0.0, 1.0)
    for end, exponent, switching in ((2.0, 0.0, 1.0), (3.0, 1.0, 0.0)):
        assert measured_exponent(exponent, switching, 1e-4) == pytest.approx(end, abs=2e-4)
    gamma = column("fig4", "gamma", "gamma")
    line = (column("fig4", "gamma", "exponent") + 1.0) / np.maximum(column("fig4", "gamma", "switching"), 1e-300)
    np.testing.assert_allclose(gamma, 3.0 - 2.0 / (line + 1.0), rtol=1e-12)
    assert (gamma.min(), gamma.max()) == (2.0, 3.0)
    assert claim("fig4", "[2, 3]").verdict == "holds"


@pytest.mark.long
def test_h_is_the_integral_of_11() -> None:
    for beta, h in zip(column("fig4", "h", "beta")[::50], column("fig4", "h", "h")[::50], strict=True):
        integral = quad(lambda u: math.sqrt(u), 0.0, 1.0, weight="alg", wvar=(0.0, -beta))[0]
        assert h == pytest.approx(1.5 * integral, rel=1e-8)
    assert claim("fig4", "h(beta)").verdict == "holds"


@pytest.mark.long
def test_low_damping_ends_where_the_integral_of_hunt_crossley_says() -> None:
    def beyond(ratio: float) -> float:
        return 4.0 / 3.0 * ratio / (1.0 - hunt_crossley_rebound(ratio) ** 2) - 1.1

    ratio = brentq(beyond, 1e-3, 1.0)
    assert f"{ratio:.3f} (alpha = 0)" in claim("fig4", "where that ends").measured
    row = section("fig4").data["impacts-alpha-0"]
    for at in (0, 5, 9):
        assert row["restitution"][at] == pytest.approx(hunt_crossley_rebound(float(row["damping_ratio"][at])), rel=1e-7)


@pytest.mark.long
def test_the_share_that_kelvin_voigt_loses_knows_no_speed() -> None:
    _, _, fastest = damped_oscillator()  # held at zero from there on, the force lets the mass go at that speed
    share = 100.0 * (1.0 - (fastest / SPEED) ** 2)
    output = claim("fig4", "Due to low impact speed").measured.split("; ")[-1]
    assert output.startswith(", ".join(3 * [f"{share:.3g} %"]))


@pytest.mark.long
@pytest.mark.parametrize("name", list(STEP_LAWS))
def test_where_the_equation_pulls(name: str) -> None:
    law = STEP_LAWS[name]
    k, damping, n, alpha = law.stiffness, law.damping, law.exponent, law.switching
    depth, pull = greatest_pull(law, 0.05)
    if alpha == 0.0:
        assert (depth, pull) == (0.0, 0.0)
        return

    def force(x: float) -> float:
        return k * x ** (n + alpha) - damping * x**n * 0.05

    end = brentq(force, 1e-7, 1.0, xtol=1e-15)
    inside = np.linspace(1e-9, end, 5000)
    assert pull == pytest.approx(float(np.min([force(x) for x in inside])), rel=1e-4)
    assert force(1.01 * end) > 0.0 > force(0.99 * end)
    if name == "middle":
        assert f"below {1e3 * end:.3f} mm" in claim("shock", "at release").measured


def test_comparable_laws_differ_in_alpha_alone() -> None:
    for alpha in (0.0, 0.25, 0.5, 1.0):
        law = comparable_law(alpha)
        s = law.exponent + alpha
        assert law.stiffness * 0.010**s == pytest.approx(30.0)
        deepest = (MASS * SPEED**2 * (s + 1.0) / (2.0 * law.stiffness)) ** (1.0 / (s + 1.0))
        assert law.damping * SPEED / (law.stiffness * deepest**alpha) == pytest.approx(0.25)
        assert law.validity() == ()


def test_shock_at_touch_needs_n_and_at_release_alpha() -> None:
    assert claim("shock", "at first touch").verdict == "holds under stated choice"
    assert claim("shock", "at release").verdict == "does not hold"
    share = column("shock", "release", "pulled_energy_share")
    assert (np.diff(share) > 0.0).all()
    assert share[0] > 1e-10
    law = comparable_law(1.0)
    decay = law.damping / (2.0 * MASS)
    turn = math.sqrt(law.stiffness / MASS - decay**2)

    def speed_out(time: float) -> float:
        return math.exp(-decay * time) * (decay / turn * math.sin(turn * time) - math.cos(turn * time))

    free = math.atan2(2.0 * decay * turn, decay**2 - turn**2) / turn
    assert share[-1] == pytest.approx(speed_out(free) ** 2 - speed_out(math.pi / turn) ** 2, rel=1e-6)


@pytest.mark.parametrize("number", list(CASES))
def test_the_error_along_the_press_is_18_less_15(number: int) -> None:
    law = CASES[number]
    k, damping, n, alpha = law.stiffness, law.damping, law.exponent, law.switching
    a1, a2 = TABLE_1[alpha]
    time, error = press_error(law)
    x = 0.040 * np.sin(time / 4.0) + 0.5e-3 * np.random.default_rng(0).random(time.size)
    v = 0.010 * np.cos(time / 4.0)
    exact = k * x ** (n + alpha) + damping * x**n * v
    linear = k * x ** (n + alpha) * np.exp(damping / k * (a1 * v + a2 * v / x))
    np.testing.assert_allclose(error.total, linear - exact, atol=1e-9)
    share = float(np.mean(np.abs(linear - exact) < 0.01))
    assert share_small(error) == share > 0.5
    assert f"{100.0 * share:.0f} % (case {number})" in claim("fig5", "is mostly below").measured
    depth = breaking_depth(law, -0.010)
    deeper = np.linspace(1.005 * depth, 0.040, 2000)
    ratio = np.exp(-damping / k * 0.010 * (a1 + a2 / deeper)) / (1.0 - damping / k * 0.010 / deeper**alpha)
    assert np.abs(ratio - 1.0).max() < 0.1 < abs(float(_ratio(law, a1, a2)(0.99 * depth)) - 1.0)


def _ratio(law: ContinuousSwitching, a1: float, a2: float) -> Callable[[float], float]:
    """Force of (18) over force of (15) at a release of 10 mm/s."""
    phi = -0.010 * law.damping / law.stiffness
    return lambda x: math.exp(phi * (a1 + a2 / x)) / (1.0 + phi / x**law.switching)


def test_the_bound_of_phi() -> None:
    def beyond(psi: float) -> float:
        return math.exp(psi) / (1.0 + psi) - 1.1

    release, into = brentq(beyond, -0.99, -1e-3), brentq(beyond, 1e-3, 5.0)
    for alpha, depth in ((0.0, 0.020), (0.3, 0.020), (0.5, 0.005)):
        assert phi_range(alpha, depth, 0.1) == pytest.approx((release * depth**alpha, into * depth**alpha), rel=1e-6)
    assert claim("fig5", "for Hunt-Crossley").verdict == "holds under stated choice"
    output = claim("fig5", "continuous switching law of Table 1")
    assert output.verdict == "does not hold"
    for alpha in TABLE_1:
        assert f"beyond {1e3 * (0.1 / -release) ** (1.0 / alpha):.0f} mm" in output.measured


def test_17_does_not_care_whether_depth_is_small() -> None:
    for alpha in (0.2, 0.3, 0.5, 0.8):
        assert scaled_error(alpha, 0.040) == pytest.approx(scaled_error(alpha, 40.0), rel=1e-9)
        share = np.linspace(0.0, 1.0, 2001)[1:]
        columns = np.column_stack([share**2, share])
        line, *_ = np.linalg.lstsq(columns, share ** (2.0 - alpha), rcond=None)
        worst = np.abs(columns @ line - share ** (2.0 - alpha)).max()
        assert scaled_error(alpha, 0.010)[0] == pytest.approx(worst, rel=1e-6)
    assert claim("fig5", "value of x is small").verdict == "does not hold"
    assert claim("fig5", "a1 = 0").verdict == "holds"


@pytest.mark.parametrize(
    "choice",
    [
        Choice(12.0, 20.0, 0.0, 1, 0.99, 1e8),
        Choice(8.0, 10.0, 0.5e-3, 2, 1.0, 1e4),
        Choice(6.0, 10.0, 0.5e-3, 0, 0.95, 1e5),
    ],
)
def test_the_fit_is_what_recursive_least_squares_end_at(choice: Choice) -> None:
    time = np.arange(1, round(choice.duration * choice.rate) + 1) / choice.rate
    depth, _ = linearisation_press(time, noise=choice.noise)
    theta, mu = np.zeros(2), choice.forgetting_factor
    covariance = choice.covariance * np.eye(2)
    for x in depth:
        phi = x**choice.power * np.array([1.0, 1.0 / x])
        gain = covariance @ phi / (mu + phi @ covariance @ phi)
        theta = theta + gain * (x ** (choice.power - 0.3) - phi @ theta)
        covariance = (covariance - np.outer(gain, phi @ covariance)) / mu
        covariance = 0.5 * (covariance + covariance.T)
    assert recursive_fit(choice, 0.3) == pytest.approx(tuple(theta), rel=1e-5)


@pytest.mark.long  # all choices are fitted
def test_table_1_is_met_one_column_at_a_time() -> None:
    tried = list(choices())
    both = [max(distance(recursive_fit(choice, alpha), alpha) for alpha in TABLE_1) for choice in tried]
    assert 0.05 < min(both) < 0.06
    assert claim("table1", "both alphas").verdict == "does not hold"
    a1, a2 = recursive_fit(Choice(12.0, 20.0, 0.0, 1, 0.99, math.inf), 0.5)
    assert (round(a1, 2), round(a2, 3)) == TABLE_1[0.5]
    for alpha in ("0.3", "0.5"):
        assert claim("table1", f"alpha = {alpha} alone").verdict == "holds under stated choice"


def test_the_trajectory_of_fig_6() -> None:
    time = np.linspace(0.0, 25.0, 25001)
    depth, velocity = two_presses(time)
    printed = (
        20.0
        + 2.5 * np.sin(time / 2.0)
        + 15.0 * np.sin(time / 4.0)
        - 5.0 * np.sin(time / 6.0)
        + 5.0 * np.sin(time / 8.0)
    )
    np.testing.assert_allclose(1e3 * depth, printed, rtol=1e-12)
    np.testing.assert_allclose(np.gradient(depth, time)[1:-1], velocity[1:-1], atol=1e-9)
    still, none = two_presses(time, waves=())
    assert (still == 0.020).all()
    assert (none == 0.0).all()
    assert np.ptp(two_presses(time, waves=WAVES[:1])[0]) == pytest.approx(0.005, rel=1e-6)
    directions = np.sign(np.diff(printed))
    changes = time[1:-1][directions[1:] != directions[:-1]]
    np.testing.assert_allclose(turns(25.0), changes, atol=2e-3)
    assert len(changes) == 2
    assert printed.min() > 8.0
    assert claim("fig6", "twice").verdict == "does not hold"
    assert claim("fig6", "starts at").verdict == "holds"


def test_the_noise_of_fig_5_is_seeded_and_of_one_sign() -> None:
    time = np.linspace(0.1, 12.0, 200)
    clean, velocity = linearisation_press(time, noise=0.0)
    noisy, same = linearisation_press(time, seed=3)
    np.testing.assert_array_equal(noisy, linearisation_press(time, seed=3)[0])
    assert not np.array_equal(noisy, linearisation_press(time, seed=4)[0])
    np.testing.assert_array_equal(velocity, same)
    np.testing.assert_allclose(np.gradient(clean, time)[1:-1], velocity[1:-1], atol=5e-6)
    assert ((noisy >= clean) & (noisy < clean + 0.5e-3)).all()
    with pytest.raises(SettingError, match="noise"):
        linearisation_press(time, noise=-1e-3)
