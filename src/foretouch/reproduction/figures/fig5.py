"""Fig. 5: what linearising the law leaves out, equations (15) to (18); how far (16) reaches in phi, (17) in depth."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foretouch.models import ContinuousSwitching
from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import linearisation_press
from foretouch.reproduction.section import Claim, Section, Table, verdict_of
from foretouch.reproduction.theory.linearisation import (
    TABLE_1,
    LinearisationError,
    fit_polynomial,
    linearisation_error,
    taylor_error_depth,
)

NOTICED = 0.1  # relative error of force that a hand begins to notice [-]
CONDITION = 0.1  # the paper's bound of phi


def _law(switching: float) -> ContinuousSwitching:
    """A law of k = lambda, so that its velocity is phi."""
    return ContinuousSwitching(1.0, 1.0, 1.4 - switching, switching)


def phi_range(switching: float, depth: float, tolerance: float) -> tuple[float, float]:
    """Phi at release and while deepening [m^alpha] at which the step to (16) alone has a relative error of force [-].

    The depth is in m, and alpha and the error [-] are given.
    """
    from scipy.optimize import brentq

    def beyond(phi: float) -> float:
        return float(_taylor_curve(switching, phi, depth)) - tolerance

    pulls = depth**switching
    release = brentq(beyond, -pulls * (1.0 - 1e-9), -1e-9 * pulls)
    return float(release), float(brentq(beyond, 1e-9 * pulls, 10.0 * pulls))


def scaled_error(switching: float, deepest: float) -> tuple[float, float]:
    """Error of x^(2 - alpha) by a1 x^2 + a2 x over depths up to one [m]: as ratios to the largest, and relative at 5 %.

    The second is that of 1/x^alpha at a twentieth of the greatest depth.
    """
    fraction = np.linspace(0.0, 1.0, 2001)[1:]
    depth = deepest * fraction
    fit = fit_polynomial(switching, depth, depth_power=2.0)
    exact = depth ** (2.0 - switching)
    whole = float(np.abs(fit.a1 * depth**2 + fit.a2 * depth - exact).max() / exact.max())
    near = 0.05 * deepest
    return whole, float((fit.a1 + fit.a2 / near) * near**switching - 1.0)


def claims_of_phi(largest: float) -> tuple[Claim, ...]:
    """Whether the paper's bound of phi is conservative, beside the greatest phi of the paper's own runs."""
    ends = {alpha: phi_range(alpha, 0.020, NOTICED) for alpha in (0.0, *TABLE_1)}
    at_bound = {alpha: 100.0 * _taylor_curve(alpha, np.array([-CONDITION, CONDITION])) for alpha in ends}
    texts = {
        alpha: f"{release:+.1f} % and {into:+.1f} % at phi = -0.1 and 0.1; {100.0 * NOTICED:.0f} % at phi = "
        f"{ends[alpha][0]:.3f} and {ends[alpha][1]:.3f}"
        for alpha, (release, into) in at_bound.items()
    }
    depths = {alpha: taylor_error_depth(_law(alpha), -CONDITION, NOTICED) for alpha in TABLE_1}
    wide = min(abs(end) for end in ends[0.0]) > CONDITION
    narrow = min(abs(end) for alpha in TABLE_1 for end in ends[alpha]) < CONDITION
    return (
        Claim(
            "||phi|| < 0.1 is conservative, for Hunt-Crossley",
            "rather conservative in many cases",
            texts[0.0],
            verdict_of(choice=wide),
            "choice: alpha = 0, where phi is damper over spring and has no unit; error of force by (16), any depth",
        ),
        Claim(
            "||phi|| < 0.1 is conservative, for the continuous switching law of Table 1",
            "rather conservative in many cases",
            "; ".join(
                f"alpha = {alpha:g}: {texts[alpha]}; under 10 % up to 0.1 only beyond {1e3 * depths[alpha]:.0f} mm"
                for alpha in TABLE_1
            ),
            verdict_of(not narrow),
            f"error of force by (16) at 20 mm; the paper's own runs stay below phi = {largest:.4f} and do not test it",
        ),
    )


def claims_of_polynomial() -> tuple[Claim, ...]:
    """The accuracy of (17), whether small depths help, and its two limiting cases."""
    small = {alpha: scaled_error(alpha, 0.040) for alpha in TABLE_1}
    large = {alpha: scaled_error(alpha, 40.0) for alpha in TABLE_1}
    same = max(abs(a - b) for alpha in TABLE_1 for a, b in zip(small[alpha], large[alpha], strict=True))
    depth = np.linspace(0.5e-3, 40e-3, 400)
    fits = {
        (alpha, power): fit_polynomial(alpha, depth, depth_power=power) for alpha in (0.0, 1.0) for power in (0, 1, 2)
    }
    off = max(max(abs(fit.a1 - (1.0 - alpha)), abs(fit.a2 - alpha)) for (alpha, _), fit in fits.items())
    between = [fit_polynomial(alpha, depth) for alpha in np.linspace(0.1, 0.9, 9)]
    return (
        Claim(
            "(17): x^(2 - alpha) is a1 x^2 + a2 x",
            "approximately",
            "; ".join(
                f"alpha = {alpha:g}: within {100.0 * whole:.1f} % of the largest value, but 1/x^alpha wrong by "
                f"{100.0 * near:+.0f} % at a twentieth of the depth"
                for alpha, (whole, near) in small.items()
            ),
            verdict_of(choice=max(whole for whole, _ in small.values()) < 0.05),
            "choice: measured in shares of the largest value; least squares over depths to 40 mm, evenly spaced",
        ),
        Claim(
            "(17) is good if the value of x is small",
            "x small",
            f"relative errors over depths to 40 mm and to 40 m are equal to {same:.1g}",
            verdict_of(same >= 1e-6),
            "only the ratio of greatest to smallest depth matters; fits as in the row above",
        ),
        Claim(
            "a1 = 0 is Kelvin-Voigt (alpha = 1), a2 = 0 is Hunt-Crossley (alpha = 0)",
            "limiting cases",
            f"fits at alpha = 0 and 1 within {off:.1g} of (1, 0) and (0, 1); both positive at alpha = 0.1 to 0.9",
            verdict_of(off < 1e-9 and min(min(fit.a1, fit.a2) for fit in between) > 0.0),
            "least squares of (17) in three forms over 0.5 to 40 mm; between the ends the spring keeps its exponent s, "
            "so the Kelvin-Voigt part is one only where s = 1",
        ),
    )


def _taylor_curve(switching: float, phi: ArrayLike, depth: float = 0.020) -> Array:
    """Relative error of force by (16) at a depth [m] over phi; NaN where (15) has no value."""
    error = linearisation_error(_law(switching), 1.0, 0.0, depth, phi)
    return error.taylor / error.force


_MATERIALS = product(((1000.0, 1.4, 800.0), (5000.0, 1.6, 3000.0), (20000.0, 1.8, 5000.0)), TABLE_1)
CASES = {
    number: ContinuousSwitching(stiffness, damping, s - alpha, alpha)
    for number, ((stiffness, s, damping), alpha) in enumerate(_MATERIALS, 1)
}
"""The six materials of Table 1."""

SMALL = 0.01  # error that the paper calls too small to be sensed [N]

DURATION, RATE = 12.5, 10.0
"""Duration of the press, as long as the sine stays inside [s], and rate of the paper's simulations [Hz]."""


def press_error(
    law: ContinuousSwitching,
    *,
    rate: float = RATE,
    duration: float = DURATION,
    seed: int = 0,
    by_differences: bool = False,
) -> tuple[Array, LinearisationError]:
    """Times [s] and the error along the paper's trajectory, with the a1 and a2 of Table 1.

    The rate [Hz], the duration [s] and the seed of the noise are the trajectory's; `by_differences` takes the velocity
    from the noisy depth instead of the sine's own.
    """
    time = np.arange(round(duration * rate) + 1) / rate
    depth, velocity = linearisation_press(time, seed=seed)
    if by_differences:
        velocity = np.gradient(depth, time)
    return time, linearisation_error(law, *TABLE_1[law.switching], depth, velocity)


def share_small(error: LinearisationError) -> float:
    """Fraction of the samples with an error below `SMALL` [-]; where (15) has no value it is not below."""
    return float(np.mean(np.abs(error.total) < SMALL))


def breaking_depth(law: ContinuousSwitching, velocity: float) -> float:
    """Depth [m] below which (18), with Table 1, is wrong by more than `NOTICED` at a velocity [m/s]."""
    depth = np.geomspace(1e-6, 40e-3, 4001)
    relative = np.abs(linearisation_error(law, *TABLE_1[law.switching], depth, velocity).relative)
    wrong = ~(relative <= NOTICED)  # also where (15) has no value
    return float(depth[np.nonzero(wrong)[0][-1]]) if wrong.any() else 0.0


def make() -> Section:
    """The six cases along the trajectory, the ends of (16), and of (17)."""
    runs = {number: press_error(law) for number, law in CASES.items()}
    fractions = {number: share_small(error) for number, (_, error) in runs.items()}
    breaks = {number: breaking_depth(law, -0.010) for number, law in CASES.items()}
    largest = max(float(np.abs(error.phi).max()) for _, error in runs.values())
    text = (
        "Force by (15) as lines and by (18) as dots, along x = 40 sin(t / 4) + 0.5 rand() mm at 10 Hz, with Table 1's "
        f"a1 and a2. {100.0 * min(fractions.values()):.0f} % (case {min(fractions, key=fractions.__getitem__)}) to "
        f"{100.0 * max(fractions.values()):.0f} % of the samples are within {SMALL} N. Small errors in newtons hide "
        "where the force is small: near the surface (18) goes as exp(b2 v / x), without bound on the way in and to "
        f"zero in the release. At a release of 10 mm/s it is wrong by more than {100.0 * NOTICED:.0f} % below "
        f"{', '.join(f'{1e3 * depth:.2f}' for depth in breaks.values())} mm (cases 1 to 6); sampled faster, the same "
        "press meets those depths. It is psi = phi / x^alpha, damper over spring, that must be small, not phi, whose "
        f"unit is m^alpha. In these runs phi never exceeds {largest:.4f}, so they say nothing about the bound of 0.1. "
        "Whether depth is small does not matter to (17): its relative error depends only on the ratio of greatest to "
        "smallest depth, as a change of unit shows."
    )
    claims = (*_claims_of_press(runs, fractions), *claims_of_phi(largest), *claims_of_polynomial())
    data: dict[str, Table] = {f"case-{number}": _table(time, error) for number, (time, error) in runs.items()}
    phi = np.concatenate([-np.geomspace(0.5, 1e-3, 200), np.geomspace(1e-3, 0.5, 200)])
    curves = {f"relative_error_alpha_{alpha:g}": _taylor_curve(alpha, phi) for alpha in (0.0, *TABLE_1)}
    data["taylor"] = {"phi": phi, **curves}
    figure = _figure(runs, data["taylor"])
    return Section("fig5", "Fig. 5: error of the linearised equation", text, figure, data, claims)


def _table(time: Array, error: LinearisationError) -> Table:
    depth, velocity = linearisation_press(time)
    return {
        "time_s": time,
        "depth_m": depth,
        "velocity_m_s": velocity,
        "force_N": error.force,
        "linearised_force_N": error.force + error.total,
        "taylor_error_N": error.taylor,
        "polynomial_error_N": error.polynomial,
        "phi": error.phi,
        "psi": error.psi,
    }


def _claims_of_press(runs: dict[int, tuple[Array, LinearisationError]], shares: dict[int, float]) -> tuple[Claim, ...]:
    fast = {n: share_small(press_error(law, rate=1000.0, by_differences=True)[1]) for n, law in CASES.items()}
    others = [
        share_small(press_error(law, duration=duration, seed=seed, by_differences=by_differences)[1])
        for law in CASES.values()
        for duration in (6.3, 8.0, 10.0, 12.5)
        for seed in range(3)
        for by_differences in (False, True)
    ]
    big = [np.abs(error.total) >= SMALL for _, error in runs.values()]
    by_fit = sum(
        int(np.sum(np.abs(error.polynomial[where]) > np.abs(error.taylor[where])))
        for where, (_, error) in zip(big, runs.values(), strict=True)
    )
    count = sum(int(where.sum()) for where in big)
    setting = f"Table 1 as printed, {DURATION:g} s at {RATE:g} Hz, seed 0, velocity of the sine"
    return (
        Claim(
            "Error of (18) against (15) is mostly below 0.01 N",
            "most below 0.01 N",
            ", ".join(f"{100.0 * fraction:.0f} % (case {number})" for number, fraction in shares.items())
            + "; largest "
            + ", ".join(f"{np.abs(error.total).max():.3f}" for _, error in runs.values())
            + " N",
            verdict_of(min(shares.values()) > 0.5),
            f"{setting}; over 4 durations, 3 seeds and both velocities at {RATE:g} Hz: {100.0 * min(others):.0f} to "
            f"{100.0 * max(others):.0f} %",
        ),
        Claim(
            "Linearisation error at 1 kHz, velocity from the noisy depth: mostly below 0.01 N",
            "most below 0.01 N",
            ", ".join(f"{100.0 * fraction:.0f} % (case {number})" for number, fraction in fast.items()),
            verdict_of(min(fast.values()) > 0.5),
            "as before, central differences of the depth at 1 kHz: 0.5 mm of noise are 250 mm/s",
        ),
        Claim(
            "Big errors come mostly from the constant a1 and a2",
            "mostly",
            f"{by_fit} of the {count} errors of 0.01 N and more come more from (17) than from (16)",
            verdict_of(by_fit > 0.5 * count),
            setting,
        ),
    )


def _figure(runs: dict[int, tuple[Array, LinearisationError]], table: Table) -> Any:
    figure = new_figure(8.2)
    (force, error), (surface, taylor) = figure.subplots(2, 2)
    for (number, (time, result)), colour in zip(runs.items(), COLOURS, strict=False):
        pale = {"linewidth": 4.0, "alpha": 0.45} if number % 2 else {"linewidth": 1.1}
        force.plot(time, result.force, color=colour, label=f"case {number}", **pale)
        dots = slice(4 * number, None, 24)  # each case at its own times, so that all can be seen
        force.plot(time[dots], (result.force + result.total)[dots], "o", color=colour, mec="black", mew=0.7, ms=5.0)
        error.plot(time, result.total, color=colour, linewidth=1.1)
    force.set_title("(a) Force by (15), lines, and by (18), every 24th as a dot")
    for number in (1, 3, 5):  # they differ in alpha alone, which the force hardly shows
        at = runs[number][0].size // 2
        position = (runs[number][0][at], runs[number][1].force[at])
        words = f"cases {number} and {number + 1}"
        force.annotate(words, position, (0, -24), textcoords="offset points", ha="center", fontsize="small")
    force.set_ylabel("force [N]")
    legend(force, columns=3)
    error.axhspan(-SMALL, SMALL, color="0.5", alpha=0.25, linewidth=0.0, label=r"$\pm$0.01 N")
    error.set(title="(b) Error: force by (18) less force by (15)", ylabel="error [N]")
    legend(error, columns=1)
    for axes in (force, error):
        axes.set_xlabel("time [s]")
    depth = np.geomspace(0.05e-3, 40e-3, 400)
    for (number, law), colour in zip(CASES.items(), COLOURS, strict=False):
        relative = np.abs(linearisation_error(law, *TABLE_1[law.switching], depth, -0.010).relative)
        surface.loglog(1e3 * depth, 100.0 * relative, color=colour, linewidth=1.2, label=f"case {number}")
    surface.axhline(100.0 * NOTICED, color="0.5", linestyle="--", linewidth=1.0)
    surface.set(
        ylim=(1e-3, 1e3),
        title="(c) Error of (18) near the surface, release at 10 mm/s",
        xlabel="depth [mm]",
        ylabel="size of relative error [%]",
    )
    surface.set_title(surface.get_title(), pad=22.0)
    for (name, curve), colour in zip(list(table.items())[1:], (COLOURS[6], COLOURS[0], COLOURS[1]), strict=True):
        label = rf"$\alpha$ = {name.rsplit('_', 1)[1]}"
        taylor.plot(table["phi"], 100.0 * np.asarray(curve, dtype=np.float64), color=colour, linewidth=1.4, label=label)
    taylor.axvspan(-CONDITION, CONDITION, color="0.5", alpha=0.2, linewidth=0.0, label=r"|$\varphi$| < 0.1")
    taylor.axhline(100.0 * NOTICED, color="0.5", linestyle="--", linewidth=1.0)
    taylor.set(
        ylim=(0.0, 60.0),
        title="(d) Error of (16) at 20 mm",
        xlabel=r"$\varphi = \lambda v / k$ [$m^\alpha$]",
        ylabel="relative error of force [%]",
    )
    legend(taylor, columns=4)
    return finished(figure, 2, gap=1.0)
