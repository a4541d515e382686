"""Fig. 7b: a material that changes continuously from Hunt-Crossley to Kelvin-Voigt."""

from __future__ import annotations

import numpy as np

from foretouch.report import COLOURS
from foretouch.reproduction.choices import NEAREST, PRINTED, claims_of, runs_of
from foretouch.reproduction.estimates import Curve, parameter_figure, parameter_table
from foretouch.reproduction.presses import true_parameters
from foretouch.reproduction.section import Section

NAMES = ("follows", "arrives")


def make() -> Section:
    """As printed and under the choice that comes nearest, beside the truth."""
    choice = NEAREST["follows"]
    pressed, printed = runs_of(PRINTED, ("continuous",))["continuous"]
    _, nearest = runs_of(choice, ("continuous",))["continuous"]
    truth = true_parameters(pressed)
    errors = {name: np.abs(trace.force - pressed.true_force)[20:] for name, trace in (("p", printed), ("n", nearest))}
    text = (
        "k, lambda, n and alpha change with time as the paper prints them. The force is followed (error at most "
        f"{errors['p'].max():.3g} N as printed, {errors['n'].max():.2g} N under the nearest choice, of "
        f"{pressed.true_force.max():.0f} N), but by other parameters than those that made it: over the one or two slow "
        "strokes of Fig. 6 a change of k and s with time looks the same as a change with depth and velocity, and the "
        "four numbers of (18) share it out among themselves. That is not for want of tuning: no combination of the "
        f"open choices follows, nor does a higher rate (section fast). The nearest choice drawn here: {choice}."
    )
    curves = [
        Curve("true, linearised", truth, "black", "--", 1.2),
        Curve.of("as printed", printed, COLOURS[0]),
        Curve.of("nearest choice", nearest, COLOURS[1], "-."),
    ]
    figure = parameter_figure(curves, ((0.0, 8000.0), (0.0, 1.8), (-150.0, 150.0), (-8.0, 8.0)))
    data = {"printed": parameter_table(printed, truth), "nearest": parameter_table(nearest, truth)}
    return Section("fig7b", "Fig. 7b: continuous change of the material", text, figure, data, claims_of(NAMES))
