"""Figs. 2 and 3: a mass meets a Kelvin-Voigt and a Hunt-Crossley material; hysteresis loop, power and energies."""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.models import HuntCrossley, KelvinVoigt
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.section import Claim, Section, verdict_of
from foretouch.reproduction.theory.energy_loss import damping_ratio
from foretouch.reproduction.theory.impact import MASS, SPEED, Impact, impact_of, impact_table, speed_exponent

GIVEN, BACK, PULLED = COLOURS[0], COLOURS[2], COLOURS[1]  # colours of H1, H2 and H3

HALVES = {"force": (np.maximum, np.minimum), "power": (np.minimum, np.maximum)}
"""In the rebound: the part of force and power that gives energy back to the mass, and the part that takes it again."""


def loop_and_power_apart(impact: Impact) -> float:
    """Greatest difference of H1, H2 and H3 [J] as areas of force over depth, and of power over time."""
    deepest = int(np.argmax(impact.depth))
    areas: list[list[float]] = []
    for along, height in (("depth", "force"), ("time", "power")):
        x, y = getattr(impact, along), getattr(impact, height)
        parts = [(y[: deepest + 1], x[: deepest + 1])]
        parts += [(half(y[deepest:], 0.0), x[deepest:]) for half in HALVES[height]]
        areas.append([float(np.trapezoid(*part)) for part in parts])
    return float(np.abs(np.diff(areas, axis=0)).max())


def impact_figure(impact: Impact, name: str) -> Any:
    """Hysteresis loop and power exchange side by side, the layout of the paper's Figs. 2 and 3."""
    figure = new_figure(4.3)
    loop, flow = figure.subplots(1, 2)
    given, *halves = (f"$H_{number}$ = {1e3 * energy:.1f} mJ" for number, energy in enumerate(impact.areas, 1))
    deepest = int(np.argmax(impact.depth))
    into, out = slice(0, deepest + 1), slice(deepest, None)
    x = {"force": 1e3 * impact.depth, "power": 1e3 * impact.time}
    for axes, height in ((loop, "force"), (flow, "power")):
        along, y = x[height], getattr(impact, height)
        axes.fill_between(along[into], y[into], color=GIVEN, alpha=0.2, linewidth=0.0, label=given)
        for half, colour, alpha, label in zip(HALVES[height], (BACK, PULLED), (0.45, 0.6), halves, strict=True):
            axes.fill_between(along[out], half(y[out], 0.0), color=colour, alpha=alpha, linewidth=0.0, label=label)
        axes.plot(along, y, color="black", linewidth=1.4)
        axes.axhline(0.0, color="0.3", linewidth=0.8)
    step, arrow = max(1, impact.time.size // 100), {"arrowstyle": "-|>", "color": "black", "mutation_scale": 16.0}
    for at in (0.45 * deepest, deepest + 0.45 * (impact.time.size - deepest)):
        tail, head = ((x["force"][i], impact.force[i]) for i in (int(at), int(at) + step))
        loop.annotate("", xy=head, xytext=tail, arrowprops=arrow)
    loop.set(title=f"(a) Hysteresis loop, {name}", xlabel="depth [mm]", ylabel="force on the mass [N]")
    flow.set(title="(b) Power into the material", xlabel="time [ms]", ylabel="power [W]")
    for axes in (loop, flow):
        legend(axes, columns=3)
    return finished(figure, 1)


VOIGT = KelvinVoigt(stiffness=6000.0, damping=40.0)
"""K as in the paper's <1>. B is ours: with the 500 N s/m of <1> no mass under B^2 / (4 K) = 10.4 kg comes back."""


def make_fig2() -> Section:
    """The impact as the equation has it, pulling at release, and as it is rendered, held at zero."""
    printed, rendered = impact_of(VOIGT), impact_of(VOIGT, allow_tension=False)
    given, back, pulled = printed.areas
    apart = loop_and_power_apart(printed)
    pulling = printed.depth[(printed.force < 0.0) & (printed.velocity < 0.0)]
    first = float(VOIGT.force(1e-9, SPEED))
    exponents = [speed_exponent(VOIGT, MASS, speed, allow_tension=True) for speed in (0.01, 0.1, 1.0, 10.0)]
    paper_law = impact_of(KelvinVoigt(6000.0, 500.0))
    setting = (
        f"(1) with K = {VOIGT.stiffness:g} N/m, B = {VOIGT.damping:g} N s/m (B is ours), {MASS:g} kg at {SPEED:g} m/s, "
        "negative force left as printed"
    )
    text = (
        f"A mass of {MASS:g} kg meets the material at {SPEED:g} m/s; equation (1) integrated as printed. The force "
        f"jumps to {first:.1f} N at first touch, and pulls the mass by up to {-printed.force.min():.1f} N over the "
        f"last {1e3 * pulling.max():.1f} mm of its rebound: the mass pays H3 = {1e3 * pulled:.1f} mJ on top. Held at "
        f"zero there, as foretouch renders it, H3 is {1e3 * rendered.areas[2]:.1f} mJ and the mass leaves at "
        f"{rendered.rebound_speed:.3f} instead of {printed.rebound_speed:.3f} m/s. The paper gives no numbers for this "
        "figure, and none were read off it. With the B of 500 N s/m that the paper simulates later, this mass "
        + ("would leave." if paper_law.separated else "would never leave: the equation holds it back for good.")
    )
    claims = (
        Claim(
            "Kelvin-Voigt: shock force at first touch, where there is no depth yet",
            "force follows the speed at the beginning",
            f"{first:.1f} N at depth 0 (B v = {VOIGT.damping * SPEED:.1f} N)",
            verdict_of(abs(first - VOIGT.damping * SPEED) < 1e-3 * first),
            setting,
        ),
        Claim(
            "Kelvin-Voigt: negative force at the end of restitution takes the energy H3 from the mass",
            "H3 extracted from the mass even in the restitution phase",
            f"down to {printed.force.min():.2f} N below {1e3 * pulling.max():.2f} mm; H1 = {1e3 * given:.2f}, "
            f"H2 = {1e3 * back:.2f}, H3 = {1e3 * pulled:.2f} mJ, sum = loss = {1e3 * printed.energy_loss:.2f} mJ",
            verdict_of(printed.force.min() < 0.0 < pulled),
            setting,
        ),
        Claim(
            "Areas of the loop (a) are the areas under the power (b)",
            "H_i in (b) correspond to (a)",
            f"apart by at most {1e6 * apart:.2g} uJ of {1e6 * given:.3g} uJ",
            verdict_of(apart < 1e-5 * given),
            f"{setting}; trapezoids over {printed.time.size} samples",
        ),
        Claim(
            "Kelvin-Voigt: energy loss proportional to the square of the impact speed",
            "exponent 2",
            f"{min(exponents):.4f} to {max(exponents):.4f}",
            verdict_of(max(abs(e - 2.0) for e in exponents) < 1e-3),
            f"integrated impacts at 0.01 to 10 m/s, {setting}; the equation is linear, so at any damping",
        ),
    )
    data = {"printed": impact_table(printed), "rendered": impact_table(rendered)}
    figure = impact_figure(printed, "Kelvin-Voigt")
    return Section("fig2", "Fig. 2: impact on a Kelvin-Voigt material", text, figure, data, claims)


HUNT = HuntCrossley(stiffness=3000.0, damping=1500.0, exponent=1.4)  # the paper's <2>
SPEEDS = (0.001, 0.01, 0.1, 0.5, 2.0, 10.0)  # speeds at which the exponent of the energy loss is measured [m/s]


def make_fig3() -> Section:
    """The impact as the equation has it; it pulls nowhere, so it is also the rendered one."""
    impact = impact_of(HUNT)
    given, back, pulled = impact.areas
    apart = loop_and_power_apart(impact)
    ends = float(max(abs(impact.force[0]), abs(impact.force[-1])))
    exponents = {speed: speed_exponent(HUNT, MASS, speed, allow_tension=True) for speed in SPEEDS}
    slow, own = exponents[SPEEDS[0]], exponents[SPEED]
    fast = impact_of(HUNT, speed=SPEEDS[-1])
    limit = HUNT.stiffness / HUNT.damping
    setting = f"(2) with the paper's <2>, {MASS:g} kg at {SPEED:g} m/s, negative force left as printed"
    text = (
        f"The same mass at the same speed, equation (2) with the paper's k = {HUNT.stiffness:g}, lambda = "
        f"{HUNT.damping:g}, n = {HUNT.exponent:g}. The force is zero at both ends and H3 = {1e3 * pulled:.1f} mJ. In "
        f"an impact the law never pulls, whatever the speed: the mass cannot come out faster than k / lambda = "
        f"{limit:g} m/s (thrown in at {SPEEDS[-1]:g} m/s it comes out at {fast.rebound_speed:.3f} m/s). A hand that is "
        "pulled out faster than that would be held back. The loss grows as the cube of the speed only while the "
        f"damping is low: at {SPEED:g} m/s (damper over spring {float(damping_ratio(HUNT, MASS, SPEED)):.2f}) the "
        f"exponent is {own:.2f}, at {SPEEDS[-1]:g} m/s {exponents[SPEEDS[-1]]:.2f}."
    )
    claims = (
        Claim(
            "Hunt-Crossley: no shock force at beginning and end",
            "shock force disappears at both",
            f"{ends:.1g} N at touch and release; smallest force {impact.force.min():.1g} N",
            verdict_of(ends < 1e-6 * impact.force.max() and impact.force.min() >= 0.0),
            setting,
        ),
        Claim(
            "Hunt-Crossley: no energy taken at the end of restitution",
            "no power extracted",
            f"H1 = {1e3 * given:.2f}, H2 = {1e3 * back:.2f}, H3 = {1e3 * pulled:.2f} mJ "
            f"(at {SPEEDS[-1]:g} m/s: H3 = {1e3 * fast.areas[2]:.2f} mJ); (a) and (b) apart by {1e6 * apart:.2g} uJ",
            verdict_of(abs(pulled) < 1e-9 * given and apart < 1e-5 * given),
            setting,
        ),
        Claim(
            "Hunt-Crossley: energy loss proportional to the cube of the impact speed",
            "exponent 3",
            ", ".join(f"{exponent:.3f} at {speed:g} m/s" for speed, exponent in exponents.items()),
            verdict_of(choice=abs(slow - 3.0) < 0.01),
            f"choice: low damping, here under about 0.01 m/s; integrated impacts, <2>, {MASS:g} kg",
        ),
    )
    data = {"impact": impact_table(impact)}
    figure = impact_figure(impact, "Hunt-Crossley")
    return Section("fig3", "Fig. 3: impact on a Hunt-Crossley material", text, figure, data, claims)
