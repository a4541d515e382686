"""Fig. 8: force error of continuous switching against threshold switching while the material changes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from foretouch.identification import (
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    ThresholdSwitching,
    TwoStageOptions,
)
from foretouch.identification.linear.recursion import PerturbationForm
from foretouch.quantities import Array, Flags
from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.reproduction.presses import Press, press
from foretouch.reproduction.questions.choices import NEAREST, PRINTED, PRINTED_WORDS, claims_of, run_of
from foretouch.reproduction.questions.tried import THRESHOLD, errors_of_fprls_threshold, errors_of_threshold, ordinal
from foretouch.reproduction.section import Claim, Section, verdict_of

FORGETTING = (1.0, 0.99, 0.98, 0.97, 0.95, 0.93, 0.9, 0.88, 0.86, 0.85, 0.84, 0.82, 0.8, 0.7, 0.5)
"""Forgetting factors of threshold switching that are tried, both its estimators alike."""

RATES = (0.0, 100.0, *(100.0 * step for step in range(5, 41)), 5000.0, 1e4)
"""rho [1/m] of threshold switching by FPRLS that are tried; the paper gives none."""

FPRLS_RATE = 2300.0
"""The rate of the figure [1/m], in the middle of those at which there is one switch with a shock of some 4.5 N."""

DRAWN = (1.0, 0.95, 0.85)  # forgetting factors that the figure draws
PAPER_SWITCH, PAPER_SHOCK = 198, 4.5  # iteration of the paper's switch, and error [N] just before it


@dataclass(frozen=True)
class Switch:
    """Threshold switching under one choice."""

    choice: str  # choice by which both laws were learnt, in words
    data: str  # data that it was given
    iterations: tuple[int, ...]  # iterations at which the law went from Hunt-Crossley to Kelvin-Voigt
    back: tuple[int, ...]  # iterations at which it went back
    shocks: tuple[tuple[float, float], ...]  # error before and after each of `iterations` [N]

    @property
    def text(self) -> str:
        """Iterations of the switches, and the errors around."""
        if not self.iterations:
            return "never switches"
        each = (
            f"{ordinal(at)} ({before:.2g} N before, {after:.2g} N after)"
            for at, (before, after) in zip(self.iterations, self.shocks, strict=True)
        )
        back = f", and back at the {', '.join(map(ordinal, self.back))}" if self.back else ""
        return f"at the {', '.join(each)}{back}"

    @property
    def distance(self) -> float:
        """Distance from the paper's iteration; inf where there is no switch."""
        return float(min((abs(at - PAPER_SWITCH) for at in self.iterations), default=np.inf))

    @property
    def single(self) -> bool:
        """One switch and no way back."""
        return len(self.iterations) == 1 and not self.back

    @property
    def holds(self) -> bool:
        """One switch, within 2 iterations of the paper's."""
        return self.single and self.distance <= 2.0

    @property
    def shock_distance(self) -> float:
        """Distance of the error before a single switch from the paper's [N]; inf unless it then is below 0.5 N."""
        return abs(self.shocks[0][0] - PAPER_SHOCK) if self.single and self.shocks[0][1] < 0.5 else np.inf

    @property
    def shock_holds(self) -> bool:
        """One switch, at which the error goes from 4 to 5 N to below 0.5 N."""
        return self.shock_distance <= 0.5


METHODS: dict[str, Callable[[float], HuntCrossleyLogRLS | HuntCrossleyTwoStage]] = {
    "log-rls": lambda factor: HuntCrossleyLogRLS(HuntCrossleyLogOptions(forgetting_factor=factor)),
    "two-stage": lambda factor: HuntCrossleyTwoStage(TwoStageOptions(forgetting_factor=factor)),
}
"""Estimators of the Hunt-Crossley law by their names, with a forgetting factor."""


def switching(factor: float, method: str) -> ThresholdSwitching:
    """Threshold 4000, and one forgetting factor for all recursions."""
    stiff = KelvinVoigtRLS(KelvinVoigtOptions(forgetting_factor=factor))
    return ThresholdSwitching(THRESHOLD, stiff, METHODS[method](factor))


def data_of_switching() -> dict[str, Press]:
    """What threshold switching is tried on."""
    return {
        "ideal data": press("continuous"),
        "force noise 0.02 N": press("continuous", noise=0.02),
        "differenced velocity": press("continuous", differenced=True),
    }


def switching_grid() -> Iterator[Switch]:
    """Threshold switching by least squares with one forgetting factor, under all its choices."""
    for (name, pressed), method, factor in itertools.product(data_of_switching().items(), METHODS, FORGETTING):
        estimator = switching(factor, method)
        yield _switch(f"forgetting {factor:g}, {method}", name, *errors_of_threshold(pressed, estimator))


def fprls_grid() -> Iterator[Switch]:
    """Threshold switching by the paper's recursion, the printed form of it and ideal data first."""
    forms: dict[PerturbationForm, str] = {"add": "as printed", "reset": "P set to delta I"}
    for (name, pressed), (form, words), rate in itertools.product(data_of_switching().items(), forms.items(), RATES):
        yield _switch(f"FPRLS {words}, rho = {rate:g} / m", name, *errors_of_fprls_threshold(pressed, rate, form))


def _switch(choice: str, data: str, error: Array, stiff: Flags) -> Switch:
    change = np.diff(stiff.astype(np.int64))
    on, off = (np.nonzero(change == sign)[0] + 1 for sign in (1, -1))
    shocks = tuple((float(error[i - 1]), float(error[i])) for i in on.tolist())
    return Switch(choice, data, tuple((on + 1).tolist()), tuple((off + 1).tolist()), shocks)


def make() -> Section:
    """Errors of both, over the iterations."""
    choice = NEAREST["better"]
    pressed, printed = run_of(PRINTED, "continuous")
    _, nearest = run_of(choice, "continuous")
    errors = {
        "continuous switching, as printed": np.abs(printed.force - pressed.true_force),
        "continuous switching, best choice": np.abs(nearest.force - pressed.true_force),
    }
    stiff: dict[float | None, Flags] = {}
    for factor in DRAWN:
        error, chosen = errors_of_threshold(pressed, switching(factor, "log-rls"))
        errors[f"threshold switching, forgetting {factor:g}"] = error
        stiff[factor] = chosen
    best = errors["continuous switching, best choice"]
    fractions = {factor: _share(best, errors[f"threshold switching, forgetting {factor:g}"]) for factor in DRAWN}
    error, stiff[None] = errors_of_fprls_threshold(pressed, FPRLS_RATE)
    by_fprls = f"threshold switching, FPRLS {FPRLS_RATE:g}"
    errors[by_fprls] = error
    least_squares, fprls = list(switching_grid()), list(fprls_grid())
    text = (
        "The continuous change of Fig. 7b, and |F - F_hat| with the parameters that were learnt from the sample too; "
        "from the 20th iteration on, where each law has one. Which of the two is better depends on how fast threshold "
        "switching forgets, which the paper does not say. The best choice of continuous switching "
        f"({choice}) is better at {100 * fractions[1.0]:.1f} % of the samples where threshold switching forgets "
        f"nothing, at {100 * fractions[0.95]:.1f} % where it forgets with 0.95, at {100 * fractions[0.85]:.1f} % with "
        "0.85: a law of two or three numbers that forgets fast needs no right law to fit a few samples. "
        "By least squares it reaches the threshold at all only where it forgets with 0.95 or faster. Where both its "
        "laws are learnt by the paper's own recursion, Kelvin-Voigt tested on its error in newtons, the switch and its "
        "shock come out nearly as in the paper; continuous switching is better at "
        f"{100 * _share(best, error):.1f} % of the samples there. {_rates_words(fprls[: len(RATES)])}"
    )
    claims = (*claims_of(("better",)), *_switching_claims(least_squares, fprls), _jump_claim(errors))
    data = {
        "errors": {
            "iteration": np.arange(1, 251),
            "force_N": pressed.true_force,
            **{f"{name.replace(', ', '_').replace(' ', '_')}_N": values for name, values in errors.items()},
        }
    }
    figure = _figure(errors, stiff)
    return Section("fig8", "Fig. 8: continuous against threshold switching", text, figure, data, claims)


def _share(error: Array, other: Array) -> float:
    """Fraction of the samples at which the first is smaller."""
    there = np.isfinite(other)
    return float(np.mean(error[there] < other[there]))


def _switching_claims(least_squares: list[Switch], fprls: list[Switch]) -> Iterator[Claim]:
    usual, printed = least_squares[0], fprls[: len(RATES)]
    likely = printed[RATES.index(FPRLS_RATE)]
    every = [*least_squares, *fprls]
    nearest = min(every, key=lambda switch: (not switch.holds, switch.distance, switch.shock_distance))
    setting = (
        f"threshold {THRESHOLD:g} N/m; {len(every)} combinations: least squares with a forgetting factor from "
        f"{FORGETTING[0]:g} to {FORGETTING[-1]:g}, Hunt-Crossley by logarithm or in two stages; or FPRLS (20) for both "
        "laws, Kelvin-Voigt tested on its error in newtons and Hunt-Crossley on its own of ln F, rho from "
        f"{RATES[0]:g} to {RATES[-1]:g} / m, delta I added to P or in its place; ideal data, noise 0.02 N or "
        "differenced velocity. "
    )
    exact = sum(PAPER_SWITCH in switch.iterations for switch in every)
    yield Claim(
        "Threshold switching goes from Hunt-Crossley to Kelvin-Voigt at the 198th iteration",
        "198th, once",
        f"by least squares without forgetting it {usual.text}; by {likely.choice}, {likely.text}. "
        f"{_rates_words(printed)} Nearest ({nearest.choice}, {nearest.data}): {nearest.text}. "
        f"At the 198th itself: {exact or 'none'} of {len(every)} combinations",
        verdict_of(usual.holds, choice=nearest.holds),
        setting + "Holds if there is one switch, within 2 iterations",
    )
    like = [switch for switch in every if switch.shock_holds]
    closest = min(every, key=lambda switch: switch.shock_distance)
    yield Claim(
        "The switch is a shock of 4.5 N in the force error",
        "error from 4.5 N to 0 N",
        f"by {likely.choice}, from {likely.shocks[0][0]:.2f} to {likely.shocks[0][1]:.2g} N; closest "
        f"({closest.choice}, {closest.data}): {closest.text}. Holds under {len(like)} of {len(every)} combinations, "
        f"{sum(switch.shock_holds for switch in least_squares)} of them by least squares",
        verdict_of(choice=bool(like)),
        setting + "Holds if the error goes from 4 to 5 N to below 0.5 N in a single switch",
    )


def _rates_words(printed: list[Switch]) -> str:
    """Values of rho with one switch, and its time and shock, as printed and on ideal data."""
    pairs = [(rate, switch) for rate, switch in zip(RATES, printed, strict=True) if switch.single]
    words = []
    for at, same in itertools.groupby(pairs, key=lambda pair: pair[1].iterations[0]):
        members = list(same)
        rates = " to ".join(dict.fromkeys(f"{rate:g}" for rate, _ in (members[0], members[-1])))
        shocks = " to ".join(dict.fromkeys(f"{one.shocks[0][0]:.1f}" for _, one in (members[0], members[-1])))
        words.append(f"with rho {rates} / m at the {ordinal(at)} ({shocks} N before)")
    return f"As printed there is a single switch {', '.join(words)}."


def _jump_claim(errors: dict[str, Array]) -> Claim:
    # A change less the change before it: a steep but smooth error is no jump.
    jumps = {name: float(np.nanmax(np.abs(np.diff(error[FIRST:], 2)))) for name, error in errors.items()}
    smooth, best = jumps["continuous switching, as printed"], jumps["continuous switching, best choice"]
    rough = {name: value for name, value in jumps.items() if name.startswith("threshold")}
    words = ", ".join(f"{value:.2g} N ({name.split(', ')[1]})" for name, value in rough.items())
    least = min(rough.values())
    return Claim(
        "Continuous switching changes without a jump in the force error",
        "no jumpy switch error",
        f"largest change from one sample to the next, less the one before, {smooth:.2g} N as printed, "
        f"{best:.2g} N with {NEAREST['better']}; "
        f"threshold switching {words}",
        verdict_of(smooth < least, choice=best < least),
        f"{PRINTED_WORDS}. From the 20th iteration on. Holds if smaller than that of threshold switching",
    )


FIRST = 19  # index of the first sample with laws from both


def _figure(errors: dict[str, Array], stiff: dict[float | None, Flags]) -> Any:
    figure = new_figure(6.4)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(4.0, 1.0))
    across = np.arange(1, 251)
    colours = (COLOURS[0], COLOURS[5], COLOURS[1], COLOURS[3], COLOURS[4], COLOURS[2])
    for (name, error), colour in zip(errors.items(), colours, strict=True):
        style = {"linestyle": "none", "marker": "."} if name.startswith("threshold") else {"linestyle": "-"}
        size = np.maximum(error[FIRST:], 1e-4)
        top.plot(across[FIRST:], size, color=colour, markersize=4.0, linewidth=1.6, label=name, **style)
    top.set(yscale="log", ylim=(1e-4, 300.0))
    top.axvline(PAPER_SWITCH, color="0.3", linewidth=0.8, linestyle="--")
    top.annotate("the paper's switch", (PAPER_SWITCH, 2e-4), (5, 0), textcoords="offset points", fontsize="small")
    top.set(ylabel="|F - F_hat| [N]", title="Error of the force (gaps: threshold switching has no law there)")
    legend(top, columns=3)
    for row, chosen in enumerate(stiff.values()):
        for law, colour in ((False, COLOURS[4]), (True, COLOURS[0])):
            there = across[FIRST:][chosen[FIRST:] == law]
            label = ("Kelvin-Voigt" if law else "Hunt-Crossley") if row == 0 or law else None
            bottom.plot(there, np.full(there.size, -row), "s", color=colour, markersize=4.0, label=label)
    names = ["FPRLS" if factor is None else f"forgetting {factor:g}" for factor in stiff]
    bottom.set_yticks([-row for row in range(len(stiff))], names, fontsize="small")
    bottom.set_ylim(-len(stiff) + 0.4, 0.6)
    bottom.axvline(PAPER_SWITCH, color="0.3", linewidth=0.8, linestyle="--")
    bottom.set(xlabel="iteration", title="Law in use by threshold switching", xlim=(1, 250))
    handles, labels = bottom.get_legend_handles_labels()
    known = dict(zip(labels, handles, strict=True))
    where = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": 2}
    bottom.legend(known.values(), known.keys(), frameon=False, fontsize="small", **where)
    figure = finished(figure, 2, above=0.85, gap=0.5)
    figure.subplots_adjust(left=0.13)
    return figure
