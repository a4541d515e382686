"""Fig. 6: the trajectory that the simulations press along."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import two_presses
from foretouch.reproduction.section import Claim, Section

DURATION = 25.0
"""Of the paper's simulations [s]."""

LONGER = 60.0
"""How long the formula is followed beyond [s]."""

Array = NDArray[np.float64]


def turns(duration: float) -> list[float]:
    """Times [s] after the start at which the velocity changes its sign."""
    from scipy.optimize import brentq

    time = np.linspace(0.0, duration, 2001)
    sign = np.sign(two_presses(time)[1])
    changes = np.nonzero(sign[1:] * sign[:-1] < 0.0)[0]
    return [brentq(lambda t: float(two_presses(t)[1]), time[i], time[i + 1], xtol=1e-12) for i in changes]


def make() -> Section:
    """The formula as printed, its turning points and its extremes."""
    time = np.linspace(0.0, DURATION, 2501)
    depth, velocity = two_presses(time)
    ends = [0.0, *turns(DURATION), DURATION]
    phases = [float(two_presses(0.5 * (a + b))[1]) > 0.0 for a, b in pairwise(ends)]
    into, out = sum(phases), len(phases) - sum(phases)
    way = ", ".join(f"{1e3 * float(two_presses(t)[0]):.2f} mm at {t:.2f} s" for t in ends)
    later = [t for t in turns(LONGER) if t > DURATION]
    leaves = _leaves()
    text = (
        f"The formula as printed: {way}. That is {into} compressions and {out} restitution in {DURATION:g} s, not two "
        f"of each. The next restitution begins at {later[0]:.2f} s and leaves the material at {leaves:.2f} s, so no "
        "longer time mends it. It begins inside the material: first touch is not among what the paper simulates. The "
        "material is not left within the 25 s, and never pressed faster than "
        f"{1e3 * np.abs(velocity).max():.2f} mm/s: forces of damping are small throughout."
    )
    setting = f"formula as printed, analytic velocity, t in [0, {DURATION:g}] s"
    start, shallowest, deepest = 1e3 * depth[0], 1e3 * depth.min(), 1e3 * depth.max()
    claims = (
        Claim(
            "The trajectory of Fig. 6 is compression and restitution twice",
            "twice in (0, 25) s",
            f"{into} compressions and {out} restitution: {way}",
            "holds" if (into, out) == (2, 2) else "does not hold",
            f"{setting}; the second restitution begins at {later[0]:.2f} s, but leaves the material at {leaves:.2f} s",
        ),
        Claim(
            "The trajectory starts at a depth of 20 mm and stays inside the material",
            "x_0 = 20 mm",
            f"x_0 = {start:.2f} mm; {shallowest:.2f} to {deepest:.2f} mm",
            "holds" if abs(start - 20.0) < 1e-9 and shallowest > 0.0 else "does not hold",
            setting,
        ),
    )
    data = {"trajectory": {"time_s": time, "depth_m": depth, "velocity_m_s": velocity}}
    figure = _figure(time, depth, velocity, ends, phases)
    return Section("fig6", "Fig. 6: penetration depth and velocity", text, figure, data, claims)


def _leaves() -> float:
    """Time [s] at which the formula first leaves the material."""
    from scipy.optimize import brentq

    time = np.linspace(0.0, LONGER, 2001)
    outside = int(np.argmax(two_presses(time)[0] < 0.0))
    return float(brentq(lambda t: float(two_presses(t)[0]), time[outside - 1], time[outside]))


def _figure(time: Array, depth: Array, velocity: Array, ends: list[float], phases: list[bool]) -> Any:
    figure = new_figure(5.6)
    place, speed = figure.subplots(2, 1, sharex=True)
    for axes in (place, speed):
        named: set[bool] = set()
        for (start, end), into in zip(pairwise(ends), phases, strict=True):
            label = None if into in named else "compression" if into else "restitution"
            colour = COLOURS[5] if into else COLOURS[3]
            axes.axvspan(start, end, color=colour, alpha=0.18, linewidth=0.0, label=label)
            named.add(into)
        axes.set_xlim(0.0, DURATION)
    place.plot(time, 1e3 * depth, color="black", linewidth=1.6, label="depth")
    place.plot(ends[1:-1], [1e3 * float(two_presses(t)[0]) for t in ends[1:-1]], "o", color=COLOURS[1], label="turns")
    place.set_title("Penetration depth")
    place.set_ylabel("depth [mm]")
    place.set_ylim(0.0)
    speed.plot(time, 1e3 * velocity, color="black", linewidth=1.6)
    speed.axhline(0.0, color="0.3", linewidth=0.8)
    speed.set_title("Penetration velocity")
    speed.set_ylabel("velocity [mm/s]")
    speed.set_xlabel("time [s]")
    legend(place, columns=4)
    return finished(figure, 2, gap=0.5)
