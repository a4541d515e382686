"""Table 1: where the paper's a1 and a2 come from, as far as a search of the open choices can tell."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import linearisation_press
from foretouch.reproduction.section import Claim, Section, verdict_of
from foretouch.reproduction.theory.linearisation import TABLE_1, fit_polynomial

DEPTHS = np.geomspace(0.5e-3, 40e-3, 400)  # depths over which the lines are drawn [m]

CLOSE = 0.01
"""Relative difference up to which a fit counts as the printed one [-]: one unit of the last digit of a2 is more."""

Line = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Choice:
    """What the paper leaves open about the fit of (17)."""

    duration: float  # duration of the trajectory of Fig. 5 [s]
    rate: float  # samples per second [Hz]
    noise: float  # greatest of the trajectory's noise [m]
    power: int  # power of depth that (17) is multiplied by: 0 as printed, 1, or 2 for x^(2 - alpha) = a1 x^2 + a2 x
    forgetting_factor: float  # forgetting factor of the recursive least squares [-]; 1 is the plain one
    covariance: float  # initial P of them, times I, in metres; infinite for a start without opinion

    def __str__(self) -> str:
        form = ("1/x^alpha", "x^(1-alpha)", "x^(2-alpha)")[self.power]
        noise = f"noise {1e3 * self.noise:g} mm" if self.noise else "no noise"
        start = "" if np.isinf(self.covariance) else f", P = {self.covariance:.0e}"
        return (
            f"{self.duration:g} s at {self.rate:g} Hz, {noise}, fit of {form}, forgetting {self.forgetting_factor:g}"
            f"{start}"
        )


def choices() -> Iterator[Choice]:
    """The grid that is searched."""
    durations = np.arange(5.0, 12.75, 0.5).tolist()
    forgetting = (1.0, 0.999, 0.995, 0.99, 0.98, 0.97, 0.95)
    starts = (*((mu, np.inf) for mu in forgetting), (1.0, 1e6), (1.0, 1e4), (1.0, 1e2))
    for duration, rate, noise, power in itertools.product(
        durations, (2.0, 10.0, 20.0, 50.0, 100.0), (0.0, 0.5e-3), (0, 1, 2)
    ):
        for forgetting_factor, covariance in starts:
            yield Choice(duration, rate, noise, power, forgetting_factor, covariance)


def recursive_fit(choice: Choice, switching: float) -> Line:
    r"""a1 [m^-alpha] and a2 [m^(1 - alpha)] at which recursive least squares from zero end.

    .. math:: \min_{a_1, a_2} \sum_{i=1}^N \mu^{N-i} \left[x_i^p (x_i^{-\alpha} - a_1 - a_2 / x_i)\right]^2
        + \mu^N (a_1^2 + a_2^2) / P_0
    """
    depth = _depths(choice.duration, choice.rate, choice.noise)
    memory = choice.forgetting_factor ** np.arange(depth.size - 1, -1, -1)
    weighted = depth**choice.power
    columns = np.stack([weighted, weighted / depth])
    ridge = choice.forgetting_factor**depth.size / choice.covariance * np.eye(2)
    a1, a2 = np.linalg.solve(
        (columns * memory) @ columns.T + ridge, (columns * memory) @ (weighted * depth**-switching)
    )
    return float(a1), float(a2)


@cache
def _depths(duration: float, rate: float, noise: float) -> Array:
    """Depths of Fig. 5's trajectory [m], from its first sample inside."""
    time = np.arange(1, round(duration * rate) + 1) / rate
    depth, _ = linearisation_press(time, noise=noise)
    return depth[depth > 0.0]


def distance(line: Line, switching: float) -> float:
    """Distance of a fit from Table 1: the greater relative difference of a1 and a2 [-]."""
    return max(abs(result / printed - 1.0) for result, printed in zip(line, TABLE_1[switching], strict=True))


def fitted(choice: Choice) -> dict[float, Line]:
    """The fit for each alpha of Table 1."""
    return {switching: recursive_fit(choice, switching) for switching in TABLE_1}


def make() -> Section:
    """All choices, the nearest to both columns at once, and to each alone."""
    tried = [(choice, fitted(choice)) for choice in choices()]
    apart = np.array([[distance(lines[alpha], alpha) for alpha in TABLE_1] for _, lines in tried])
    both = int(np.argmin(apart.max(axis=1)))
    alone = {alpha: int(np.argmin(apart[:, i])) for i, alpha in enumerate(TABLE_1)}
    exact = {
        alpha: sum((round(lines[alpha][0], 2), round(lines[alpha][1], 3)) == printed for _, lines in tried)
        for alpha, printed in TABLE_1.items()
    }
    errors = {alpha: np.abs(_relative(TABLE_1[alpha], alpha)) for alpha in TABLE_1}
    deep = max(error[DEPTHS >= 5e-3].max() for error in errors.values())
    near = min(error[DEPTHS < 2e-3].min() for error in errors.values())
    in_mm = [line[0] * 1e3**-alpha for alpha, line in TABLE_1.items()]
    text = (
        "The paper fits (17) by recursive least squares over its trajectory of Fig. 5, and leaves open the form of "
        "(17), how long, how often, with how much forgetting and from which P. In metres the numbers are what such "
        f"fits give. {len(tried):,} settings were tried: the nearest to both columns at once "
        f"({tried[both][0]}) gives {_say(tried[both][1][0.3])} and {_say(tried[both][1][0.5])}. Each column alone is "
        "met much better by a setting of its own; but duration and forgetting are two free numbers to meet two with. "
        f"The table is in metres (in millimetres a1 would be {in_mm[0]:.2f} and {in_mm[1]:.2f}). Panel (b) is "
        "what a constant pair costs, the printed one and a fit of x^(1-alpha) over even depths: the printed "
        f"ones are within {100.0 * deep:.0f} % of x^-alpha beyond 5 mm, and more than {100.0 * near:.0f} % wrong at "
        "every depth under 2 mm."
    )
    claims = (
        Claim(
            "Table 1: a1 and a2 for both alphas, from one and the same fit",
            "2.35, 0.016 (alpha 0.3); 3.44, 0.067 (alpha 0.5)",
            f"nearest {_say(tried[both][1][0.3])} and {_say(tried[both][1][0.5])}, "
            f"{100.0 * apart.max(axis=1)[both]:.1f} % off",
            verdict_of(choice=apart.max(axis=1)[both] < CLOSE),
            f"{tried[both][0]}; best of {len(tried):,} settings, metres",
        ),
        *(_claim_alone(alpha, tried, apart, exact[alpha], alone[alpha]) for alpha in TABLE_1),
    )
    data = {
        "search": {
            **{one.name: np.array([getattr(choice, one.name) for choice, _ in tried]) for one in fields(Choice)},
            **{
                f"a{i + 1}_alpha_{alpha:g}": np.array([lines[alpha][i] for _, lines in tried])
                for alpha in TABLE_1
                for i in (0, 1)
            },
        },
        "error": {
            "depth_m": DEPTHS,
            **{f"printed_alpha_{alpha:g}": _relative(TABLE_1[alpha], alpha) for alpha in TABLE_1},
        },
    }
    return Section("table1", "Table 1: a1 and a2 of (17)", text, _figure(), data, claims)


def _claim_alone(
    alpha: float, tried: list[tuple[Choice, dict[float, Line]]], apart: Array, exact: int, nearest: int
) -> Claim:
    choice, lines = tried[nearest]
    off = float(apart[nearest, list(TABLE_1).index(alpha)])
    return Claim(
        f"Table 1: a1 and a2 for alpha = {alpha:g} alone",
        f"{TABLE_1[alpha][0]:g}, {TABLE_1[alpha][1]:g}",
        f"{_say(lines[alpha])} ({100.0 * off:.1f} % off); {exact} of the settings round to the printed digits",
        verdict_of(choice=off < CLOSE),
        f"choice: {choice}, metres; within {100.0 * CLOSE:g} % counts as met",
    )


def _say(line: Line) -> str:
    return f"{line[0]:.3f}, {line[1]:.4f}"


def _relative(line: Line, alpha: float) -> Array:
    """a1 + a2 / x over x^-alpha, less one, at `DEPTHS`."""
    return (line[0] + line[1] / DEPTHS) * DEPTHS**alpha - 1.0


def _figure() -> Any:
    figure = new_figure(4.6)
    values, error = figure.subplots(1, 2)
    depth = 1e3 * DEPTHS
    for (alpha, line), colour in zip(TABLE_1.items(), COLOURS, strict=False):
        values.loglog(depth, DEPTHS**-alpha, color=colour, linewidth=1.6, label=rf"$x^{{-{alpha:g}}}$")
        values.loglog(depth, line[0] + line[1] / DEPTHS, "--", color=colour, linewidth=1.3, label="Table 1")
        error.semilogx(depth, 100.0 * _relative(line, alpha), "--", color=colour, label=rf"Table 1, $\alpha$ = {alpha}")
        ours = fit_polynomial(alpha, np.linspace(0.5e-3, 40e-3, 400), depth_power=1.0)
        relative = 100.0 * _relative((ours.a1, ours.a2), alpha)
        error.semilogx(depth, relative, color=colour, linewidth=1.2, label=rf"even fit, $\alpha$ = {alpha}")
    values.set(title="(a) Both sides of (17)", ylabel=r"$x^{-\alpha}$ and $a_1 + a_2 / x$ [$m^{-\alpha}$]")
    error.set(title="(b) Error of (17)", ylabel="relative error [%]", ylim=(-20.0, 60.0))
    error.axhline(0.0, color="0.3", linewidth=0.8)
    for axes in (values, error):
        axes.set_xlabel("depth [mm]")
        axes.set_xticks([0.5, 1, 2, 5, 10, 20, 40], ["0.5", "1", "2", "5", "10", "20", "40"])
        axes.minorticks_off()
    legend(values, columns=4)
    legend(error, columns=2)
    return finished(figure, 1, above=0.75)
