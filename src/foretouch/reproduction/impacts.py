"""What Figs. 2 and 3 have in common: one impact, its hysteresis loop, its power, and the three energies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.models import MemorylessLaw
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.section import Table
from foretouch.reproduction.theory import Impact, integrate_impact

MASS, SPEED = 1.0, 0.5
"""Of the impacts of Figs. 2 and 3 [kg], [m/s]; the paper gives none."""

GIVEN, BACK, PULLED = COLOURS[0], COLOURS[2], COLOURS[1]
"""Colours of H1, H2 and H3."""

Areas = tuple[float, float, float]


def impact_of(law: MemorylessLaw, *, speed: float = SPEED, allow_tension: bool = True) -> Impact:
    """One impact with so many samples that sums over them are integrals to five digits."""
    return integrate_impact(law, MASS, speed, allow_tension=allow_tension, samples=2001)


def slope(law: MemorylessLaw, speed: float, *, allow_tension: bool = True) -> float:
    """Local exponent of speed in the energy that an impact costs [-], from integrated impacts 1 % to either side."""
    low, high = (
        integrate_impact(law, MASS, speed * factor, allow_tension=allow_tension, samples=2).damping_work
        for factor in (0.99, 1.01)
    )
    return math.log(high / low) / math.log(1.01 / 0.99)


def areas_of_loop(impact: Impact) -> Areas:
    """H1, H2 and H3 [J] as areas between force and depth: way in, way out above zero, way out below zero."""
    deepest = int(np.argmax(impact.depth))
    back, force = impact.depth[deepest:], impact.force[deepest:]
    given = np.trapezoid(impact.force[: deepest + 1], impact.depth[: deepest + 1])
    returned = np.trapezoid(np.maximum(force, 0.0), back)
    pulled = np.trapezoid(np.minimum(force, 0.0), back)
    return float(given), float(returned), float(pulled)


def areas_of_power(impact: Impact) -> Areas:
    """The same [J] as areas between power and time: before the turn, below zero, and above zero after the turn."""
    deepest = int(np.argmax(impact.depth))
    time, power = impact.time[deepest:], impact.power[deepest:]
    given = np.trapezoid(impact.power[: deepest + 1], impact.time[: deepest + 1])
    return (
        float(given),
        float(np.trapezoid(np.minimum(power, 0.0), time)),
        float(np.trapezoid(np.maximum(power, 0.0), time)),
    )


def impact_table(impact: Impact) -> Table:
    """Everything that the figure draws."""
    return {
        "time_s": impact.time,
        "depth_m": impact.depth,
        "velocity_m_s": impact.velocity,
        "force_N": impact.force,
        "power_W": impact.power,
    }


def impact_figure(impact: Impact, name: str) -> Any:
    """Hysteresis loop and power exchange side by side, the layout of the paper's Figs. 2 and 3."""
    figure = new_figure(4.3)
    loop, flow = figure.subplots(1, 2)
    energies = impact.areas
    named = [f"$H_{number}$ = {1e3 * energy:.1f} mJ" for number, energy in enumerate(energies, 1)]
    deepest = int(np.argmax(impact.depth))
    into, out = slice(0, deepest + 1), slice(deepest, None)
    depth = 1e3 * impact.depth
    back_force, back_power = impact.force[out], impact.power[out]
    loop.fill_between(depth[into], impact.force[into], color=GIVEN, alpha=0.2, linewidth=0.0, label=named[0])
    loop.fill_between(depth[out], np.maximum(back_force, 0.0), color=BACK, alpha=0.45, linewidth=0.0, label=named[1])
    loop.fill_between(depth[out], np.minimum(back_force, 0.0), color=PULLED, alpha=0.6, linewidth=0.0, label=named[2])
    loop.plot(depth, impact.force, color="black", linewidth=1.4)
    for at in (0.45 * deepest, deepest + 0.45 * (impact.time.size - deepest)):
        _arrow(loop, depth, impact.force, int(at))
    loop.set_title(f"(a) Hysteresis loop, {name}")
    loop.set_xlabel("depth [mm]")
    loop.set_ylabel("force on the mass [N]")
    time = 1e3 * impact.time
    flow.fill_between(time[into], impact.power[into], color=GIVEN, alpha=0.2, linewidth=0.0, label=named[0])
    flow.fill_between(time[out], np.minimum(back_power, 0.0), color=BACK, alpha=0.45, linewidth=0.0, label=named[1])
    flow.fill_between(time[out], np.maximum(back_power, 0.0), color=PULLED, alpha=0.6, linewidth=0.0, label=named[2])
    flow.plot(time, impact.power, color="black", linewidth=1.4)
    flow.set_title("(b) Power into the material")
    flow.set_xlabel("time [ms]")
    flow.set_ylabel("power [W]")
    for axes in (loop, flow):
        axes.axhline(0.0, color="0.3", linewidth=0.8)
        legend(axes, columns=3)
    return finished(figure, 1)


def _arrow(axes: Any, x: NDArray[np.float64], y: NDArray[np.float64], at: int) -> None:
    """An arrowhead on a curve, along it."""
    step = max(1, x.size // 100)
    axes.annotate(
        "",
        xy=(x[at + step], y[at + step]),
        xytext=(x[at], y[at]),
        arrowprops={"arrowstyle": "-|>", "color": "black", "mutation_scale": 16.0},
    )
