"""Fig. 4: what an impact costs, in closed form, and how far the closed form can be trusted."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from foretouch.models import ContinuousSwitching, KelvinVoigt
from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.section import Claim, Section, Table, verdict_of
from foretouch.reproduction.theory.energy_loss import (
    energy_loss,
    energy_loss_by_quadrature,
    h_of,
    h_of_gamma_functions,
    loss_exponent,
)
from foretouch.reproduction.theory.impact import (
    LowDampingError,
    integrate_impact,
    low_damping_error,
    low_damping_limit,
    speed_exponent,
    unit_impact,
)

LAWS = {rf"$\alpha$ = {alpha:g}": (round(1.4 * (1.0 - alpha), 12), alpha) for alpha in (0.0, 0.25, 0.5, 0.75, 1.0)}
"""n and alpha of the laws whose impacts are integrated: the paper's way from <2> to <1>."""

DAMPED = np.geomspace(1e-3, 1.0, 10)  # Damping ratios at which they are integrated [-]
UNDAMPED = 1e-4  # Damping ratio that counts as none [-]
TOLERANCE = 0.1  # Error of (12) at which the low-damping approximation is taken to end [-]


def area(points: int) -> tuple[Array, Array]:
    """N and alpha over the area of (5), its closed edges included, shape (points, points)."""
    alpha = np.linspace(0.0, 1.0, points)
    s = np.linspace(1.0, 2.0, points, endpoint=False)
    switching, total = np.meshgrid(alpha, s)
    return total - switching, switching


def measured_exponent(exponent: float, switching: float, damping_ratio: float) -> float:
    """Exponent of speed in the energy that integrated impacts cost, at one damping ratio [-]."""
    return speed_exponent(*unit_impact(exponent, switching, damping_ratio))


def make() -> Section:
    """Theory over the area of (5), and integrated impacts beside it."""
    beta = np.linspace(0.0, 0.5, 201)
    h = h_of(beta)
    damped = {name: _damped(*numbers) for name, numbers in LAWS.items()}
    limits = {name: low_damping_limit(*numbers, TOLERANCE) for name, numbers in LAWS.items()}
    n, alpha = area(101)
    data: dict[str, Table] = {
        "h": {"beta": beta, "h": h},
        "gamma": {"exponent": n.ravel(), "switching": alpha.ravel(), "gamma": loss_exponent(n, alpha).ravel()},
        **{f"impacts-alpha-{alpha:g}": damped[name] for name, (_, alpha) in LAWS.items()},
    }
    first, *_, last = limits.values()
    text = (
        "Panels (a) and (b) are the paper's: h(beta) and the map of gamma over the area of (5). The contours of (b) "
        "are straight lines through (0, -1), as (14) says; gamma = 3 along the whole edge alpha = 0, gamma = 2 only in "
        "the corner (1, 0), which is Kelvin-Voigt itself. So gamma alone does not tell laws apart. Panel (c) is how "
        "wrong (12) is against the integrated impact, in force as it is rendered (never negative), over the damping "
        "ratio lambda v_i / (k x_M^alpha), and (d) the exponent that these impacts really have. By 10 % wrong it is at "
        f"a ratio of {first.damping_ratio:.3f} for Hunt-Crossley and {last.damping_ratio:.3f} for Kelvin-Voigt, where "
        f"the mass still comes back with {first.restitution:.2f} and {last.restitution:.2f} of its speed: (12) is for "
        "nearly elastic impacts. Low speed is not enough for that: for Kelvin-Voigt the ratio does not depend on the "
        "speed, and so its exponent is 2 at any damping. Above a ratio of 0.75 / h(beta) equation (12) loses more "
        "than there is."
    )
    claims = (*_claims_of_theory(h), *_claims_of_impacts(damped, limits))
    figure = _figure(beta, h, damped)
    return Section("fig4", "Fig. 4: energy loss of an impact", text, figure, data, claims)


def _damped(exponent: float, switching: float) -> dict[str, Array]:
    rows = [low_damping_error(exponent, switching, float(ratio)) for ratio in DAMPED]
    return {
        "damping_ratio": DAMPED,
        "loss_share": np.array([row.loss for row in rows]),
        "loss_share_by_12": np.array([row.approximate_loss for row in rows]),
        "restitution": np.array([row.restitution for row in rows]),
        "exponent": np.array([measured_exponent(exponent, switching, float(ratio)) for ratio in DAMPED]),
    }


def _claims_of_theory(h: Array) -> tuple[Claim, ...]:
    n, alpha = area(201)
    gamma = loss_exponent(n, alpha)
    lowest = np.unravel_index(np.argmin(gamma), gamma.shape)
    ends = np.array_equal(gamma == 3.0, alpha == 0.0) and (n[lowest], alpha[lowest]) == (0.0, 1.0)
    inside = alpha > 0.0
    slope = (n[inside] + 1.0) / alpha[inside]  # k_line of (14)
    by_slope = float(np.abs(gamma[inside] - (3.0 - 2.0 / (slope + 1.0))).max())
    cross = float(np.abs(h / h_of_gamma_functions(np.linspace(0.0, 0.5, h.size)) - 1.0).max())
    wrong = 0.0
    for point in zip(*(values.ravel().tolist() for values in area(11)), strict=True):
        law = ContinuousSwitching(4500.0, 100.0, max(point[0], 0.0), point[1])
        wrong = max(wrong, abs(float(energy_loss(law, 1.0, 0.3)) / energy_loss_by_quadrature(law, 1.0, 0.3) - 1.0))
    return (
        Claim(
            "gamma lies in [2, 3] over the area of (5), with Kelvin-Voigt and Hunt-Crossley as its ends",
            "[2, 3]",
            f"[{gamma.min():.6g}, {gamma.max():.6g}]; 2 only at n = {n[lowest]:g}, alpha = {alpha[lowest]:g}, 3 "
            "exactly where alpha = 0",
            verdict_of(ends and gamma.min() == 2.0 and gamma.max() == 3.0),
            f"(14) on {gamma.size:,} points of (5), closed edges included; both ends are attained",
        ),
        Claim(
            "gamma follows from the slope of the line through (0, -1) and (alpha, n)",
            "(14)",
            f"both forms of (14) apart by at most {by_slope:.1g}",
            verdict_of(by_slope < 1e-12),
            f"{slope.size:,} points of (5) with alpha > 0",
        ),
        Claim(
            "h(beta) grows with beta and is bounded at [1, 2.5)",
            "[1, 2.5)",
            f"[{h[0]:.6g}, {h[-1]:.6g}], always growing; the supremum is 3 pi / 4 = {0.75 * math.pi:.6g} and attained",
            verdict_of(h[0] == 1.0 and bool((np.diff(h) > 0.0).all()) and h[-1] < 2.5),
            f"beta in [0, 0.5]; the bound is not tight; hypergeometric and gamma functions agree to {cross:.1g}",
        ),
        Claim(
            "(12) is the integral (9)",
            "equal",
            f"apart by at most {wrong:.1g} (relative)",
            verdict_of(wrong < 1e-9),
            "closed form against adaptive quadrature on 121 points of (5), upper limit M of (9) read as x_M",
        ),
    )


def _claims_of_impacts(damped: dict[str, dict[str, Array]], ends: dict[str, LowDampingError]) -> tuple[Claim, ...]:
    pairs = list(zip(*(values.ravel().tolist() for values in area(5)), strict=True))
    apart = max(
        abs(measured_exponent(max(n, 0.0), alpha, UNDAMPED) - float(loss_exponent(n, alpha))) for n, alpha in pairs
    )
    at = int(np.argmin(np.abs(DAMPED - 0.1)))
    off = {name: float(damped[name]["exponent"][at] - loss_exponent(*LAWS[name])) for name in damped}
    limits = {LAWS[name][1]: end for name, end in ends.items()}
    fractions = {
        label: [_lost(law, speed) for speed in (1.0, 0.1, 0.01)]
        for label, law in (
            ("alpha = 0", ContinuousSwitching(3000.0, 1500.0, 1.4, 0.0)),
            ("alpha = 0.5", ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5)),
            ("Kelvin-Voigt with B = 40", KelvinVoigt(6000.0, 40.0)),
        )
    }
    return (
        Claim(
            "Energy loss is proportional to the impact speed to the power gamma",
            "(13), (14)",
            f"exponent of integrated impacts within {apart:.1g} of gamma at a damping ratio of {UNDAMPED:g}; at 0.1 "
            f"off by {min(off.values()):+.3f} to {max(off.values()):+.3f}",
            verdict_of(choice=apart < 1e-3),
            f"choice: low damping; {len(pairs)} points of (5), force as rendered (never negative)",
        ),
        Claim(
            "E_diss is small enough to be negligible: where that ends",
            "low impact speed",
            f"(12) is {100.0 * TOLERANCE:g} % too large at a damping ratio of "
            + ", ".join(f"{limit.damping_ratio:.3f} (alpha = {alpha:g})" for alpha, limit in limits.items())
            + f"; restitution there {min(x.restitution for x in limits.values()):.2f} to "
            f"{max(x.restitution for x in limits.values()):.2f}",
            verdict_of(choice=min(x.damping_ratio for x in limits.values()) > 0.01),
            f"choice: speed out over speed in above {max(x.restitution for x in limits.values()):.2f}; "
            "integrated impacts, n = 1.4 (1 - alpha), force as rendered",
        ),
        Claim(
            "Due to low impact speed E_diss is negligible against E_total",
            "low impact speed suffices",
            "share lost at 1, 0.1, 0.01 m/s: "
            + "; ".join(
                f"{', '.join(f'{100.0 * x:.3g} %' for x in lost)} ({label})" for label, lost in fractions.items()
            ),
            verdict_of(choice=fractions["alpha = 0"][-1] < 0.05),
            "choice: alpha = 0; the share goes as v^(gamma - 2), so slowly for larger alpha and not at all for "
            "Kelvin-Voigt; 1 kg on the softer two materials of Fig. 7c, and on that of Fig. 2",
        ),
    )


def _lost(law: ContinuousSwitching | KelvinVoigt, speed: float) -> float:
    """Fraction of the energy that an impact of 1 kg costs [-]."""
    impact = integrate_impact(law, 1.0, speed, samples=2)
    return impact.energy_loss / (0.5 * speed**2)


def _figure(beta: Array, h: Array, damped: dict[str, dict[str, Array]]) -> Any:
    figure = new_figure(8.4)
    (factor, plane), (error, power) = figure.subplots(2, 2)
    factor.plot(beta, h, color="black", linewidth=1.6)
    factor.axhline(0.75 * math.pi, color=COLOURS[1], linewidth=1.0, label=r"supremum 3$\pi$/4")
    factor.axhline(2.5, color="0.5", linestyle="--", linewidth=1.0, label="the paper's bound 2.5")
    factor.set(title=r"(a) h($\beta$)", xlabel=r"$\beta$ [-]", ylabel="h [-]", xlim=(0.0, 0.5))
    legend(factor, columns=2)
    _draw_map(figure, plane)
    for (name, rows), colour in zip(damped.items(), COLOURS, strict=False):
        wrong = 100.0 * (rows["loss_share_by_12"] / rows["loss_share"] - 1.0)
        error.loglog(rows["damping_ratio"], wrong, color=colour, linewidth=1.4, label=name)
        power.semilogx(rows["damping_ratio"], rows["exponent"], "o-", color=colour, markersize=3.0, linewidth=1.4)
        power.axhline(float(loss_exponent(*LAWS[name])), color=colour, linestyle="--", linewidth=0.9)
    error.axhline(100.0 * TOLERANCE, color="0.5", linestyle="--", linewidth=1.0)
    error.set(title="(c) Error of (12) against integrated impacts", ylabel="energy loss too large by [%]")
    legend(error, columns=5)
    power.set_title(r"(d) Exponent of integrated impacts (dashed: $\gamma$)", pad=22.0)
    power.set_ylabel("exponent of speed [-]")
    for axes in (error, power):
        axes.set_xlabel(r"damping ratio $\lambda v_i / (k x_M^\alpha)$ [-]")
    return finished(figure, 2, gap=1.0, between=0.25)


def _draw_map(figure: Any, axes: Any) -> None:
    """Gamma over the area of (5) in colour, with the lines through (0, -1) of (14)."""
    n, alpha = area(101)
    gamma = loss_exponent(n, alpha)
    colours = axes.contourf(alpha, n, gamma, levels=np.linspace(2.0, 3.0, 21), cmap="viridis")
    lines = axes.contour(alpha, n, gamma, levels=np.arange(2.1, 3.0, 0.1), colors="white", linewidths=0.8)
    beta = 0.5 * (3.0 - lines.levels)
    middle = np.minimum(1.5, 0.96 / beta - 1.0)  # of each line inside the area: s, from which alpha and n follow
    positions = np.column_stack([beta * (middle + 1.0), middle - beta * (middle + 1.0)])
    axes.clabel(lines, fmt="%.1f", fontsize=7, manual=[tuple(position) for position in positions])
    end = {"color": COLOURS[1], "clip_on": False}
    axes.plot([1.0], [0.0], "o", label=r"Kelvin-Voigt, $\gamma$ = 2", **end)
    axes.plot([0.0, 0.0], [1.0, 2.0], linewidth=3.0, label=r"Hunt-Crossley, $\gamma$ = 3", **end)
    axes.set(title=r"(b) $\gamma$ over the area of (5)", xlabel=r"switching $\alpha$ [-]", ylabel="exponent n [-]")
    legend(axes, columns=2)
    figure.colorbar(colours, ax=axes, ticks=np.arange(2.0, 3.05, 0.2), label=r"$\gamma$ [-]")
