"""Figs. 6 and 7: the trajectory of the paper's simulations, and the parameters that are identified along it.

In 7a Kelvin-Voigt and Hunt-Crossley are each identified with the four parameters of (18); in 7b a material changes
continuously from Hunt-Crossley to Kelvin-Voigt; in 7c it changes suddenly, twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from foretouch.identification import FPRLS
from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import DURATION, PERIOD, STEPS, Press, Trace, press, true_parameters, two_presses
from foretouch.reproduction.questions.choices import BEST, NEAREST, PRINTED, PRINTED_WORDS, Choice, claims_of, run_of
from foretouch.reproduction.section import Claim, Section, Table, verdict_of

LONGER = 60.0  # time for which the formula is followed beyond [s]


def turns(duration: float, of: int = 1) -> list[float]:
    """Times [s] after the start at which the velocity, or of 0 the depth, changes its sign."""
    from scipy.optimize import brentq

    time = np.linspace(0.0, duration, 2001)
    sign = np.sign(two_presses(time)[of])
    changes = np.nonzero(sign[1:] * sign[:-1] < 0.0)[0]
    return [brentq(lambda t: float(two_presses(t)[of]), time[i], time[i + 1], xtol=1e-12) for i in changes]


def make_fig6() -> Section:
    """The formula as printed, its turning points and its extremes."""
    time = np.linspace(0.0, DURATION, 2501)
    depth, velocity = two_presses(time)
    ends = [0.0, *turns(DURATION), DURATION]
    phases = [float(two_presses(0.5 * (a + b))[1]) > 0.0 for a, b in pairwise(ends)]
    into, out = sum(phases), len(phases) - sum(phases)
    way = ", ".join(f"{1e3 * float(two_presses(t)[0]):.2f} mm at {t:.2f} s" for t in ends)
    later = [t for t in turns(LONGER) if t > DURATION]
    leaves = turns(LONGER, 0)[0]
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
            verdict_of((into, out) == (2, 2)),
            f"{setting}; the second restitution begins at {later[0]:.2f} s, but leaves the material at {leaves:.2f} s",
        ),
        Claim(
            "The trajectory starts at a depth of 20 mm and stays inside the material",
            "x_0 = 20 mm",
            f"x_0 = {start:.2f} mm; {shallowest:.2f} to {deepest:.2f} mm",
            verdict_of(abs(start - 20.0) < 1e-9 and shallowest > 0.0),
            setting,
        ),
    )
    data = {"trajectory": {"time_s": time, "depth_m": depth, "velocity_m_s": velocity}}
    figure = _trajectory_figure(time, depth, velocity, ends, phases)
    return Section("fig6", "Fig. 6: penetration depth and velocity", text, figure, data, claims)


def _trajectory_figure(time: Array, depth: Array, velocity: Array, ends: list[float], phases: list[bool]) -> Any:
    figure = new_figure(5.6)
    position, speed = figure.subplots(2, 1, sharex=True)
    for axes in (position, speed):
        named: set[bool] = set()
        for (start, end), into in zip(pairwise(ends), phases, strict=True):
            label = None if into in named else "compression" if into else "restitution"
            colour = COLOURS[5] if into else COLOURS[3]
            axes.axvspan(start, end, color=colour, alpha=0.18, linewidth=0.0, label=label)
            named.add(into)
        axes.set_xlim(0.0, DURATION)
    position.plot(time, 1e3 * depth, color="black", linewidth=1.6, label="depth")
    position.plot(
        ends[1:-1], [1e3 * float(two_presses(t)[0]) for t in ends[1:-1]], "o", color=COLOURS[1], label="turns"
    )
    position.set(title="Penetration depth", ylabel="depth [mm]", ylim=0.0)
    speed.plot(time, 1e3 * velocity, color="black", linewidth=1.6)
    speed.axhline(0.0, color="0.3", linewidth=0.8)
    speed.set(title="Penetration velocity", ylabel="velocity [mm/s]", xlabel="time [s]")
    legend(position, columns=4)
    return finished(figure, 2, gap=0.5)


PANELS = {"Stiffness": "k [N/m$^s$]", "Exponent s = n + alpha": "s", "b$_1$": "b$_1$ [s/m]", "b$_2$": "b$_2$ [s]"}
"""Title and axis of each panel, in the paper's order."""


class Curve(NamedTuple):
    """One line in all four panels: k, s, b1 and b2 at each iteration, shape (4, m)."""

    label: str
    values: Array
    colour: str
    style: str = "-"
    width: float = 1.4  # [points]


def parameter_figure(curves: Sequence[Curve], limits: Sequence[tuple[float, float]]) -> Any:
    """k, s, b1 and b2 in two rows, as in the paper's Fig. 7; what leaves the limits of the vertical axes is cut."""
    figure = new_figure(6.4)
    grid = figure.subplots(2, 2, sharex=True)
    across = np.arange(1, curves[0].values.shape[1] + 1)
    for index, (axes, (title, label)) in enumerate(zip(grid.flat, PANELS.items(), strict=True)):
        for name, values, colour, style, width in curves:
            axes.plot(across, values[index], color=colour, linestyle=style, linewidth=width, label=name)
        axes.set(ylim=limits[index], xlim=(float(across[0]), float(across[-1])), ylabel=label, title=title)
    for axes in grid[1]:
        axes.set_xlabel("iteration")
    columns = 3 if len(curves) > 4 else len(curves)
    handles = grid.flat[0].get_legend_handles_labels()
    figure.legend(*handles, loc="upper center", ncols=columns, frameon=False, fontsize="small")
    return finished(figure, 2, above=0.55 + 0.2 * -(-len(curves) // columns), gap=0.5)


def parameter_table(trace: Trace, truth: Array) -> Table:
    """An estimate beside the truth."""
    names = ("k", "s", "b1_s_m", "b2_s")
    return {
        "iteration": np.arange(1, trace.k.size + 1),
        **dict(zip(names, trace.parameters, strict=True)),
        **{f"true_{name}": values for name, values in zip(names, truth, strict=True)},
        "force_N": trace.force,
        "force_ahead_N": trace.ahead,
    }


def compared(
    material: str, choice: Choice, name: str, style: str = "-"
) -> tuple[Press, Trace, Trace, list[Curve], dict[str, Table]]:
    """A press as printed and under a choice: press, both traces, and with the truth beside them curves and tables."""
    pressed, printed = run_of(PRINTED, material)
    _, other = run_of(choice, material)
    truth = true_parameters(pressed)
    curves = [
        Curve("true, linearised", truth, "black", "--", 1.2),
        Curve("as printed", printed.parameters, COLOURS[0]),
        Curve("nearest choice" if name == "nearest" else f"{choice}", other.parameters, COLOURS[1], style),
    ]
    data = {"printed": parameter_table(printed, truth), name: parameter_table(other, truth)}
    return pressed, printed, other, curves, data


def make_fig7a() -> Section:
    """Both pure laws, as printed and under the choice that finds k and s soonest."""
    materials = {"kelvin-voigt": ("Kelvin-Voigt <1>", COLOURS[0]), "hunt-crossley": ("Hunt-Crossley <2>", COLOURS[4])}
    choice = BEST["kvm k, s"]
    curves, off = [], {}
    data: dict[str, Table] = {}
    for material, (label, colour) in materials.items():
        pressed, printed, _, (true, first, best), tables = compared(material, choice, "best", "-.")
        style = "--" if material == "kelvin-voigt" else ":"
        curves += [
            Curve(f"{label}: true", true.values, "black", style, 1.0),
            first._replace(label=f"{label}: as printed", colour=colour),
            best._replace(label=f"{label}: {choice}", colour=colour),
        ]
        data |= {f"{material}-{name}": table for name, table in tables.items()}
        off[material] = 100.0 * (printed.k[19] / pressed.laws[0].general_form[0] - 1.0)
    text = (
        "Each pure law along the trajectory of Fig. 6, identified with all four parameters of (18). Ten samples in a "
        "second of slow pressing leave the regressors nearly parallel, so P0 and theta_0, which the paper does not "
        f"give, decide the start: as printed k at the 20th iteration is off by {off['kelvin-voigt']:+.1f} % and "
        f"{off['hunt-crossley']:+.1f} %, with P0 = 10^8 I it is found by then. Afterwards both laws are found to a "
        "few parts in a thousand. b1 of Kelvin-Voigt keeps its start until the press turns; what is left of it then is "
        "the second-order term of (16): the data are free of noise here, so it is the modelling error alone."
    )
    figure = parameter_figure(curves, ((0.0, 8000.0), (0.6, 1.6), (-1.2, 1.2), (-0.4, 0.4)))
    claims = claims_of(("kvm k, s", "hcm k, s", "kvm b1", "kvm b2", "hcm b2"))
    title = "Fig. 7a: estimation for Kelvin-Voigt and Hunt-Crossley"
    return Section("fig7a", title, text, figure, data, claims)


def make_fig7b() -> Section:
    """Fig. 7b as printed and under the choice that comes nearest, beside the truth."""
    choice = NEAREST["follows"]
    pressed, printed, nearest, curves, data = compared("continuous", choice, "nearest", "-.")
    worst, best = (np.abs(trace.force - pressed.true_force)[20:].max() for trace in (printed, nearest))
    text = (
        "k, lambda, n and alpha change with time as the paper prints them. The force is followed (error at most "
        f"{worst:.3g} N as printed, {best:.2g} N under the nearest choice, of "
        f"{pressed.true_force.max():.0f} N), but by other parameters than those that made it: over the one or two slow "
        "strokes of Fig. 6 a change of k and s with time looks the same as a change with depth and velocity, and the "
        "four numbers of (18) share it out among themselves. That is not for want of tuning: no combination of the "
        f"open choices follows, nor does a higher rate (section fast). The nearest choice drawn here: {choice}."
    )
    figure = parameter_figure(curves, ((0.0, 8000.0), (0.0, 1.8), (-150.0, 150.0), (-8.0, 8.0)))
    claims = claims_of(("follows", "arrives"))
    return Section("fig7b", "Fig. 7b: continuous change of the material", text, figure, data, claims)


def make_fig7c() -> Section:
    """Fig. 7c as printed and with P enlarged before the gain, beside the truth."""
    pressed, _, best, curves, data = compared("steps", BEST["step 1"], "best")
    errors = log_errors(pressed.force, best)
    jumps = [pressed.force[step - 1] - best.ahead[step - 1] for step in (FIRST, SECOND)]
    text = (
        f"To an estimate that is right, the error of ln F is {errors[FIRST - 1]:.2f} at the first change and "
        f"{errors[SECOND - 1]:.2f} at the second ({jumps[0]:+.0f} N and {jumps[1]:+.0f} N), with a threshold of 1: the "
        "self-perturbing test just trips; a change by less than a factor of e would go unnoticed. What decides is when "
        "P is enlarged. After the gain of the sample, as (20) prints it, that sample has been taken in with the old, "
        "small P: the parameters go far along the directions that the old material had left undetermined, b1 and "
        "b2, and one slow stroke does not bring them back. Enlarged before the gain, the same algorithm recovers at "
        f"once. b1 is then near 0.5 because nothing moves it: it was {best.b1[FIRST - 2]:.2f} before the change, and "
        f"the material's own is {data['best']['true_b1_s_m'][FIRST]:.2f}."
    )
    figure = parameter_figure(curves, ((0.0, 9000.0), (0.6, 2.2), (-3.0, 3.0), (-0.3, 0.3)))
    claims = (*claims_of(("step 1", "step 2", "step b1", "step b2", "step force")), _covariance_claim())
    return Section("fig7c", "Fig. 7c: sudden changes of the material", text, figure, data, claims)


FIRST, SECOND = (round(step / PERIOD) for step in STEPS)  # iterations of the changes


def log_errors(force: Array, trace: Trace) -> Array:
    """What the self-perturbing test sees: ln F less the estimate from before the sample; NaN at the first."""
    return np.asarray(np.log(force) - np.log(trace.ahead))


def covariance_at_steps(choice: Choice) -> list[float]:
    """Distance of P from delta I after each change: the largest entry of P - delta I, in delta."""
    estimator, apart = FPRLS(choice.options), []
    for iteration, sample in enumerate(press("steps").samples, 1):
        estimator.update(sample)
        if iteration in (FIRST, SECOND):
            delta = choice.options.perturbation
            apart.append(float(np.abs(estimator.unscaled_covariance / delta - np.eye(4)).max()))
    return apart


def _covariance_claim() -> Claim:
    printed, reset = covariance_at_steps(PRINTED), covariance_at_steps(replace(PRINTED, form="reset"))
    before = covariance_at_steps(replace(PRINTED, form="reset", moment="before"))

    def words(values: list[float]) -> str:
        return " and ".join(f"{100.0 * value:.2g} %" for value in values)

    within = 1e-3
    return Claim(
        "P is back to 10^6 I after a sudden change",
        "returns to 10^6 I as set at the beginning",
        f"largest entry of P - 10^6 I, of 10^6, after the two changes: reset {words(reset)}; as printed (10^6 I is "
        f"added) {words(printed)}; reset before the gain, which takes one sample away at once, {words(before)}",
        verdict_of(max(printed) <= within, choice=max(reset) <= within),
        f"P reset to delta I after the gain. {PRINTED_WORDS}. Holds if within 0.1 %",
    )
