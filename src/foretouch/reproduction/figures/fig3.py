"""Fig. 3: a mass meets a Hunt-Crossley material."""

from __future__ import annotations

from foretouch.models import HuntCrossley
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
from foretouch.reproduction.theory import damping_ratio

LAW = HuntCrossley(stiffness=3000.0, damping=1500.0, exponent=1.4)
"""The paper's <2>."""

SPEEDS = (0.001, 0.01, 0.1, 0.5, 2.0, 10.0)
"""At which the exponent of the energy loss is measured [m/s]."""


def make() -> Section:
    """The impact as the equation has it; it pulls nowhere, so it is also the rendered one."""
    impact = impact_of(LAW)
    given, back, pulled = impact.areas
    loop, power = areas_of_loop(impact), areas_of_power(impact)
    apart = max(abs(a - b) for a, b in zip(loop, power, strict=True))
    ends = float(max(abs(impact.force[0]), abs(impact.force[-1])))
    exponents = {speed: slope(LAW, speed) for speed in SPEEDS}
    slow, own = exponents[SPEEDS[0]], exponents[SPEED]
    fast = impact_of(LAW, speed=SPEEDS[-1])
    limit = LAW.stiffness / LAW.damping
    setting = f"(2) with the paper's <2>, {MASS:g} kg at {SPEED:g} m/s, negative force left as printed"
    text = (
        f"The same mass at the same speed, equation (2) with the paper's k = {LAW.stiffness:g}, lambda = "
        f"{LAW.damping:g}, n = {LAW.exponent:g}. The force is zero at both ends and H3 = {1e3 * pulled:.1f} mJ. In an "
        f"impact the law never pulls, whatever the speed: the mass cannot come out faster than k / lambda = "
        f"{limit:g} m/s (thrown in at {SPEEDS[-1]:g} m/s it comes out at {fast.rebound_speed:.3f} m/s). A hand that is "
        "pulled out faster than that would be held back. The loss grows as the cube of the speed only while the "
        f"damping is low: at {SPEED:g} m/s (damper over spring {float(damping_ratio(LAW, MASS, SPEED)):.2f}) the "
        f"exponent is {own:.2f}, at {SPEEDS[-1]:g} m/s {exponents[SPEEDS[-1]]:.2f}."
    )
    claims = (
        Claim(
            "Hunt-Crossley: no shock force at beginning and end",
            "shock force disappears at both",
            f"{ends:.1g} N at touch and release; smallest force {impact.force.min():.1g} N",
            "holds" if ends < 1e-6 * impact.force.max() and impact.force.min() >= 0.0 else "does not hold",
            setting,
        ),
        Claim(
            "Hunt-Crossley: no energy taken at the end of restitution",
            "no power extracted",
            f"H1 = {1e3 * given:.2f}, H2 = {1e3 * back:.2f}, H3 = {1e3 * pulled:.2f} mJ "
            f"(at {SPEEDS[-1]:g} m/s: H3 = {1e3 * fast.areas[2]:.2f} mJ); (a) and (b) apart by {1e6 * apart:.2g} uJ",
            "holds" if abs(pulled) < 1e-9 * given and apart < 1e-5 * given else "does not hold",
            setting,
        ),
        Claim(
            "Hunt-Crossley: energy loss proportional to the cube of the impact speed",
            "exponent 3",
            ", ".join(f"{exponent:.3f} at {speed:g} m/s" for speed, exponent in exponents.items()),
            "holds under stated choice" if abs(slow - 3.0) < 0.01 else "does not hold",
            f"choice: low damping, here under about 0.01 m/s; integrated impacts, <2>, {MASS:g} kg",
        ),
    )
    data = {"impact": impact_table(impact)}
    figure = impact_figure(impact, "Hunt-Crossley")
    return Section("fig3", "Fig. 3: impact on a Hunt-Crossley material", text, figure, data, claims)
