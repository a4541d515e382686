"""Fig. 2: a mass meets a Kelvin-Voigt material."""

from __future__ import annotations

from foretouch.models import KelvinVoigt
from foretouch.reproduction.impacts import (
    MASS,
    SPEED,
    areas_of_loop,
    areas_of_power,
    impact_figure,
    impact_of,
    impact_table,
    slope,
)
from foretouch.reproduction.section import Claim, Section

LAW = KelvinVoigt(stiffness=6000.0, damping=40.0)
"""K as in the paper's <1>. B is ours: with the 500 N s/m of <1> no mass under B^2 / (4 K) = 10.4 kg comes back."""


def make() -> Section:
    """The impact as the equation has it, pulling at release, and as it is rendered, held at zero."""
    printed, rendered = impact_of(LAW), impact_of(LAW, allow_tension=False)
    given, back, pulled = printed.areas
    loop, power = areas_of_loop(printed), areas_of_power(printed)
    apart = max(abs(a - b) for a, b in zip(loop, power, strict=True))
    pulling = printed.depth[(printed.force < 0.0) & (printed.velocity < 0.0)]
    first = float(LAW.force(1e-9, SPEED))
    exponents = [slope(LAW, speed) for speed in (0.01, 0.1, 1.0, 10.0)]
    paper_law = impact_of(KelvinVoigt(6000.0, 500.0))
    setting = (
        f"(1) with K = {LAW.stiffness:g} N/m, B = {LAW.damping:g} N s/m (B is ours), {MASS:g} kg at {SPEED:g} m/s, "
        "negative force left as printed"
    )
    text = (
        f"A mass of {MASS:g} kg meets the material at {SPEED:g} m/s; equation (1) integrated as printed. The force "
        f"jumps to {first:.1f} N at first touch, and pulls the mass by up to {-printed.force.min():.1f} N over the "
        f"last {1e3 * pulling.max():.1f} mm of its way out: the mass pays H3 = {1e3 * pulled:.1f} mJ on top. Held at "
        f"zero there, as foretouch renders it, H3 is {1e3 * rendered.areas[2]:.1f} mJ and the mass leaves at "
        f"{rendered.rebound_speed:.3f} instead of {printed.rebound_speed:.3f} m/s. The paper gives no numbers for this "
        "figure, and none were read off it. With the B of 500 N s/m that the paper simulates later, this mass "
        + ("would leave." if paper_law.separated else "would never leave: the equation holds it back for good.")
    )
    claims = (
        Claim(
            "Kelvin-Voigt: shock force at first touch, where there is no depth yet",
            "force follows the speed at the beginning",
            f"{first:.1f} N at depth 0 (B v = {LAW.damping * SPEED:.1f} N)",
            "holds" if abs(first - LAW.damping * SPEED) < 1e-3 * first else "does not hold",
            setting,
        ),
        Claim(
            "Kelvin-Voigt: negative force at the end of restitution takes the energy H3 from the mass",
            "H3 extracted from the mass even in the restitution phase",
            f"down to {printed.force.min():.2f} N below {1e3 * pulling.max():.2f} mm; H1 = {1e3 * given:.2f}, "
            f"H2 = {1e3 * back:.2f}, H3 = {1e3 * pulled:.2f} mJ, sum = loss = {1e3 * printed.energy_loss:.2f} mJ",
            "holds" if printed.force.min() < 0.0 < pulled else "does not hold",
            setting,
        ),
        Claim(
            "Areas of the loop (a) are the areas under the power (b)",
            "H_i in (b) correspond to (a)",
            f"apart by at most {1e6 * apart:.2g} uJ of {1e6 * given:.3g} uJ",
            "holds" if apart < 1e-5 * given else "does not hold",
            f"{setting}; trapezoids over {printed.time.size} samples",
        ),
        Claim(
            "Kelvin-Voigt: energy loss proportional to the square of the impact speed",
            "exponent 2",
            f"{min(exponents):.4f} to {max(exponents):.4f}",
            "holds" if max(abs(e - 2.0) for e in exponents) < 1e-3 else "does not hold",
            f"integrated impacts at 0.01 to 10 m/s, {setting}; the equation is linear, so at any damping",
        ),
    )
    data = {"printed": impact_table(printed), "rendered": impact_table(rendered)}
    figure = impact_figure(printed, "Kelvin-Voigt")
    return Section("fig2", "Fig. 2: impact on a Kelvin-Voigt material", text, figure, data, claims)
