"""Does equation (4) avoid the shock force? At first touch and at release, for every alpha between the two old laws."""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.models import ContinuousSwitching, MemorylessLaw
from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import STEP_LAWS
from foretouch.reproduction.section import Claim, Section, verdict_of
from foretouch.reproduction.theory.energy_loss import maximum_depth
from foretouch.reproduction.theory.impact import MASS, SPEED, impact_of, impact_table, integrate_impact

SWITCHINGS = (0.0, 0.25, 0.5, 0.75, 1.0)  # values of alpha whose loops are drawn

STIFFNESS_FORCE, AT_DEPTH, DAMPING_RATIO = 30.0, 0.010, 0.25
"""What makes laws of different exponents comparable: spring force [N] at a depth [m], and damper over spring [-]."""

RELEASE = 0.05  # speed at which a hand lets go [m/s]
TICK = 1e-3  # one cycle of haptic rendering [s]; with it goes the depth after the first one, at the speed of touch
TOUCH = 0.1  # speed of first touch [m/s]


def comparable_law(switching: float) -> ContinuousSwitching:
    """The law on the paper's way from n = 1.4, alpha = 0 to n = 0, alpha = 1, of equal spring force and damping."""
    exponent = 1.4 * (1.0 - switching)
    stiffness = STIFFNESS_FORCE / AT_DEPTH ** (exponent + switching)
    undamped = ContinuousSwitching(stiffness, 0.0, exponent, switching)
    deepest = float(maximum_depth(undamped, MASS, SPEED))
    damping = DAMPING_RATIO * stiffness * deepest**switching / SPEED
    return ContinuousSwitching(stiffness, damping, exponent, switching)


def greatest_pull(law: MemorylessLaw, speed: float) -> tuple[float, float]:
    """Depth [m] and force [N], negative, at which the equation pulls most at one speed of release [m/s]."""
    end = float(law.tension_depth(-speed))
    if end == 0.0:
        return 0.0, 0.0
    depth = end * np.linspace(1e-6, 1.0, 20001)
    force = law.force(depth, -speed, allow_tension=True)
    most = int(np.argmin(force))
    return float(depth[most]), float(force[most])


def make() -> Section:
    """First touch and release by the paper's own laws, and impacts on comparable ones."""
    impacts = {alpha: impact_of(comparable_law(alpha)) for alpha in SWITCHINGS}
    grid = np.linspace(0.2, 1.0, 17)  # below, the fraction is under the 1e-9 that the integration resolves
    pulled = np.array([_pulled_share(comparable_law(float(alpha))) for alpha in grid])
    first = {name: float(law.force(1e-9, TOUCH)) for name, law in STEP_LAWS.items()}
    tick = {name: float(law.force(TICK * TOUCH, TOUCH)) for name, law in STEP_LAWS.items()}
    late = ContinuousSwitching(3000.0 + 120.0 * 22.5, 1500.0 - 40.0 * 22.5, 1.4 - 0.056 * 22.5, 0.9)
    middle = STEP_LAWS["middle"]
    text = (
        "The damper of (4) has the factor x^n, so at first touch there is no force as long as n is above 0. The range "
        "(5) lets n be 0 at alpha = 1, and near there the force is continuous in name only: with the paper's gradual "
        f"change at alpha = 0.9 (n = {late.exponent:.2f}) it is {float(late.force(TICK * TOUCH, TOUCH)):.1f} N after "
        f"the first millisecond of a touch at {TOUCH:g} m/s. At release the spring falls off as x^(n + alpha) and "
        "the damper only as x^n: for every alpha above 0 the equation pulls below x = (lambda |v| / k)^(1 / alpha). "
        "No jump, for n above 0, but the energy H3 that the paper holds against Kelvin-Voigt is there for all of them; "
        "only Hunt-Crossley has none, and for small alpha it is tiny. In panels (a), (b) and (d) the laws have one "
        "spring force at 10 mm and one ratio of damper to spring, so that only alpha and n differ. foretouch holds the "
        "force at zero where the equation pulls."
    )
    setting = f"(4) with the three materials of Fig. 7c, touched at {TOUCH:g} m/s"
    fraction = {f"{alpha:g}": _pulled_share(comparable_law(alpha)) for alpha in SWITCHINGS}
    claims = (
        Claim(
            "Shock force avoided by (4), at first touch",
            "shock force in KVM is also avoided as HCM",
            "force at 1 nm: " + ", ".join(f"{force:.2g} N ({name})" for name, force in first.items()),
            verdict_of(choice=first["middle"] < 1e-3 < first["<1> Kelvin-Voigt"]),
            f"choice: n > 0, which (5) does not ask at alpha = 1; {setting}",
        ),
        Claim(
            "Shock force avoided by (4), as felt in the first millisecond",
            "shock force in KVM is also avoided as HCM",
            ", ".join(f"{force:.2g} N ({name})" for name, force in tick.items())
            + f", {float(late.force(TICK * TOUCH, TOUCH)):.1f} N (alpha = 0.9)",
            verdict_of(choice=tick["middle"] < 0.5 < float(late.force(TICK * TOUCH, TOUCH))),
            f"choice: n well above 0; {setting}, at {1e3 * TICK * TOUCH:g} mm; alpha = 0.9 is the gradual change of "
            "the paper at 22.5 s",
        ),
        Claim(
            "Shock force avoided by (4), at release: no pull, no power taken at the end of restitution",
            "power loss consistent with physical rules as in Fig. 3",
            "H3 over the energy that came in: "
            + ", ".join(f"{100.0 * value:.2g} % at alpha = {alpha}" for alpha, value in fraction.items())
            + f"; middle material at {1e3 * RELEASE:g} mm/s: pulls below "
            f"{1e3 * float(middle.tension_depth(-RELEASE)):.3f} mm, by up to "
            f"{-greatest_pull(middle, RELEASE)[1]:.2f} N",
            verdict_of(min(value for alpha, value in fraction.items() if alpha != "0") <= 0.0),
            f"equation as printed, impacts of {MASS:g} kg at {SPEED:g} m/s on laws of equal spring force and damping; "
            "holds for alpha = 0 alone, or with the force held at zero",
        ),
    )
    speeds = np.geomspace(1e-4, 1.0, 121)
    depths = {name: law.tension_depth(-speeds) for name, law in STEP_LAWS.items()}
    data = {
        **{f"impact-alpha-{alpha:g}": impact_table(impact) for alpha, impact in impacts.items()},
        "release": {"switching": grid, "pulled_energy_share": pulled},
        "tension": {"speed_m_s": speeds, **{f"depth_m_{i}": depth for i, depth in enumerate(depths.values(), 1)}},
    }
    figure = _figure(impacts, speeds, depths, (grid, pulled))
    return Section("shock", "Equation (4): is the shock force avoided?", text, figure, data, claims)


def _pulled_share(law: MemorylessLaw) -> float:
    """H3 over the energy that came in [-]."""
    impact = integrate_impact(law, MASS, SPEED, allow_tension=True, samples=2)
    return impact.areas[2] / impact.areas[0]


def _figure(impacts: dict[float, Any], speeds: Array, depths: dict[str, Array], release: tuple[Array, Array]) -> Any:
    figure = new_figure(7.6)
    (loops, touch), (where, cost) = figure.subplots(2, 2)
    for (alpha, impact), colour in zip(impacts.items(), COLOURS, strict=False):
        for axes in (loops, touch):
            axes.plot(1e3 * impact.depth, impact.force, color=colour, linewidth=1.3, label=rf"$\alpha$ = {alpha:g}")
    loops.set(title="(a) Impacts by (4), as printed", xlabel="depth [mm]")
    touch.set(title="(b) The same near the surface", xlabel="depth [mm]", xlim=(-0.005, 0.5), ylim=(-1.5, 4.0))
    for axes in (loops, touch):
        axes.axhline(0.0, color="0.3", linewidth=0.8)
        axes.set_ylabel("force [N]")
    legend(loops, columns=5)
    touch.set_title(touch.get_title(), pad=22.0)
    for (name, depth), colour in zip(depths.items(), (COLOURS[0], COLOURS[2], COLOURS[4]), strict=True):
        if depth.max() > 0.0:
            where.loglog(1e3 * speeds, 1e3 * depth, color=colour, linewidth=1.6, label=name)
    where.set(
        title="(c) Depth below which the equation pulls",
        xlabel="speed of release [mm/s]",
        ylabel="depth [mm]",
        ylim=(1e-6, 1e3),
    )
    legend(where, columns=3)
    label = r"$H_3$ (none at $\alpha$ = 0)"
    cost.semilogy(release[0], 100.0 * release[1], "o-", color="black", markersize=3.5, label=label)
    cost.set(
        xlim=(0.0, 1.02),
        title="(d) Energy taken at release, by impacts as in (a)",
        xlabel=r"switching $\alpha$, at n = 1.4 (1 - $\alpha$)",
        ylabel="share of the energy that came in [%]",
    )
    legend(cost, columns=1)
    return finished(figure, 2, gap=1.0)
