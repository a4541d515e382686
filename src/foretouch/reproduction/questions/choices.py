"""What the paper leaves open about its estimator: every combination of it, and which one each claim needs."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from foretouch.identification import FPRLS, FPRLSOptions
from foretouch.identification.linear.options import DepthUnit
from foretouch.identification.linear.recursion import ErrorUnit, PerturbationForm, PerturbationMoment
from foretouch.quantities import Flags
from foretouch.report import finished, new_figure
from foretouch.reproduction.presses import MATERIALS, Press, Trace, follow, press
from foretouch.reproduction.questions.tried import QUESTIONS, Answer
from foretouch.reproduction.section import Claim, Section, Table, verdict_of

SMALL_STIFFNESS = 100.0  # theta_0 of a small k [N/m^s], with s = 1


@dataclass(frozen=True, slots=True)
class Choice:
    """One combination; the defaults are (20) as printed in SI units, on ideal data."""

    unit: DepthUnit = "m"  # of depth in the regressors
    error: ErrorUnit = "log"  # what the self-perturbing test sees
    moment: PerturbationMoment = "after"  # whether P is enlarged before or after the gain of the sample that trips it
    form: PerturbationForm = "add"  # whether delta I is added to P or takes its place
    rho: float = 1000.0  # parameter rho of the forgetting factor [1/m]
    initial: float = 1.0  # k of theta_0 [N/m^s]: 1 is theta_0 = 0, more comes with s = 1
    covariance: float = 1e6  # factor of I in P_0
    noise: float = 0.0  # standard deviation of the force noise [N]
    velocity: str = "exact"  # or the difference of two depths

    @property
    def options(self) -> FPRLSOptions:
        """The options of the estimator."""
        return FPRLSOptions(
            depth_unit=self.unit,
            perturbation_error=self.error,
            perturbation_moment=self.moment,
            perturbation_form=self.form,
            forgetting_rate=self.rho,
            initial_parameters=(math.log(self.initial), 0.0 if self.initial == 1.0 else 1.0, 0.0, 0.0),
            initial_covariance=self.covariance,
        )

    @property
    def departures(self) -> dict[str, Any]:
        """What differs from the printed one."""
        return {name: getattr(self, name) for name in OPEN if getattr(self, name) != getattr(PRINTED, name)}

    def __str__(self) -> str:
        return "; ".join(OPEN[name].words.format(value) for name, value in self.departures.items()) or "as printed"


class Open(NamedTuple):
    """What is left open: how a choice reads, its heading in the figure, and the values that are tried."""

    words: str
    head: str
    values: tuple[Any, ...]


PRINTED = Choice()  # all choices as printed
PRINTED_WORDS = (
    "FPRLS (20) as printed at 10 Hz: metres, test on the error of ln F, delta I added to P after the gain, "
    "P0 = delta = 10^6, rho = 1000 / m, theta_0 = 0, no noise, exact velocity"
)

OPEN: dict[str, Open] = {
    "unit": Open("depth in {}", "depth\nin", ("m", "mm")),
    "error": Open("test on the error in {}s", "test\non", ("log", "newton")),
    "moment": Open("P enlarged {} the gain", "enlarge P,\nthe gain", ("after", "before")),
    "form": Open("P {} to delta I", "P by\ndelta", ("add", "reset")),
    "rho": Open("rho = {:g} / m", "rho [1/m]", (0.0, 100.0, 1000.0, 10000.0)),
    "initial": Open("theta_0 with k = {:g}, s = 1", "k of\ntheta_0", (1.0, SMALL_STIFFNESS)),
    "covariance": Open("P0 = {:g} I", "P0", (1e2, 1e4, 1e6, 1e8)),
    "noise": Open("force noise {:g} N", "noise\n[N]", (0.0, 0.02)),
    "velocity": Open("{} velocity", "velocity", ("exact", "differenced")),
}
"""The attributes of a `Choice`; noise and differenced velocity are not tried together."""

BEST: dict[str, Choice] = {
    "kvm k, s": Choice(covariance=1e8),
    "hcm k, s": Choice(covariance=1e8),
    "hcm b2": Choice(initial=SMALL_STIFFNESS, covariance=1e8),
    "step 1": Choice(moment="before"),
    "step 2": Choice(moment="before"),
    "step b1": Choice(moment="before"),
    "step b2": Choice(unit="mm", moment="before", rho=1e4),
    "step force": Choice(moment="before"),
}
"""For each claim that does not hold as printed, the combination with the fewest departures that makes it hold, and of
these the nearest to the paper's number; the search of the section `choices` finds them."""

NEAREST: dict[str, Choice] = {
    "follows": Choice("m", "newton", "before", "reset", 1e4, SMALL_STIFFNESS, 1e2, 0.0, "differenced"),
    "arrives": Choice("m", "newton", "after", "reset", 0.0, SMALL_STIFFNESS, 1e6, 0.0, "differenced"),
    "better": Choice(error="newton", rho=1e4, covariance=1e2),
}
"""For each claim that no combination makes hold, the one that comes nearest."""


def combinations() -> Iterator[Choice]:
    """All of them."""
    for choice in itertools.starmap(Choice, itertools.product(*(one.values for one in OPEN.values()))):
        if choice.noise == 0.0 or choice.velocity == "exact":
            yield choice


@lru_cache(maxsize=32)
def _press(material: str, noise: float, velocity: str) -> Press:
    return press(material, noise=noise, differenced=velocity == "differenced")


def run_of(choice: Choice, material: str) -> tuple[Press, Trace]:
    """Press a material and estimate it from scratch."""
    pressed = _press(material, choice.noise, choice.velocity)
    return pressed, follow(FPRLS(choice.options), pressed)


def answer(name: str, choice: Choice) -> Answer:
    """One question under one choice."""
    question = QUESTIONS[name]
    return question.measure(*run_of(choice, question.material))


def claims_of(names: Iterable[str]) -> tuple[Claim, ...]:
    """Questions as claims: as printed, and where that does not give it, under the choice that comes nearest."""
    return tuple(map(_claim, names))


def _claim(name: str) -> Claim:
    question, printed = QUESTIONS[name], answer(name, PRINTED)
    setting, measured = f"{PRINTED_WORDS}. Holds if {question.rule}", printed.text
    verdict = verdict_of(question.holds(printed))
    if verdict != "holds":
        choice = BEST.get(name, NEAREST.get(name, PRINTED))
        best = answer(name, choice)
        verdict = verdict_of(choice=question.holds(best))
        if verdict == "does not hold":
            setting += f"; none of {sum(1 for _ in combinations())} combinations of the open choices gives it"
            measured += f"; nearest, with {choice}: {best.text}"
        else:
            setting, measured = f"{choice}. {setting}", f"{best.text}; as printed: {measured}"
    return Claim(question.claim, question.paper, measured, verdict, setting)


PURE = ("kelvin-voigt", "hunt-crossley")  # materials of Fig. 7a.
LEVELS, SEEDS = (0.002, 0.005, 0.02, 0.1), 10  # levels of the force noise [N], and number of runs with each


class Search:
    """All answers to all questions under some choices, by question, and whether each claim holds; some 20 s for all."""

    def __init__(self, choices: list[Choice]) -> None:
        self.choices = choices
        self.answers: dict[str, list[Answer]] = {name: [] for name in QUESTIONS}
        for choice in choices:
            runs = {material: run_of(choice, material) for material in MATERIALS}
            for name, question in QUESTIONS.items():
                self.answers[name].append(question.measure(*runs[question.material]))
        self.holds: dict[str, Flags] = {
            name: np.array([question.holds(answer) for answer in self.answers[name]])
            for name, question in QUESTIONS.items()
        }
        self.held = np.asarray(sum(holds.astype(np.int64) for holds in self.holds.values()))  # claims, by choice


def best_of(result: Search, name: str) -> int:
    """Index of a claim's combination: of those that hold the fewest departures, then the nearest; else the nearest."""
    holds, answers = result.holds[name], result.answers[name]

    def rank(index: int) -> tuple[bool, int, float]:
        departures = len(result.choices[index].departures) if holds[index] else 0
        return not holds[index], departures, answers[index].value

    return min(range(len(holds)), key=rank)


def noise_shares() -> dict[float, dict[str, float]]:
    """At several levels of force noise [N], the fraction of seeds under which each claim of Fig. 7a holds.

    Each claim under its own best choice, exact velocity.
    """
    fractions: dict[float, dict[str, float]] = {}
    for level in LEVELS:
        presses = {one: [press(one, noise=level, seed=seed) for seed in range(SEEDS)] for one in PURE}
        fractions[level] = {}
        for name, question in QUESTIONS.items():
            if question.material in PURE:
                options = BEST.get(name, PRINTED).options
                answers = (question.measure(one, follow(FPRLS(options), one)) for one in presses[question.material])
                fractions[level][name] = sum(map(question.holds, answers)) / SEEDS
    return fractions


def make() -> Section:
    """Fractions of the combinations under which each claim holds, and the best of each."""
    result = Search(list(combinations()))
    held, printed = result.held, result.choices.index(PRINTED)
    most = min(range(len(held)), key=lambda index: (-held[index], len(result.choices[index].departures)))
    missing = [name for name in QUESTIONS if not result.holds[name][most]]
    never = [name for name, holds in result.holds.items() if not holds.any()]
    noise = noise_shares()
    counts = "; ".join(
        f"{level:g} N: " + ", ".join(str(round(SEEDS * fraction)) for fraction in fractions.values())
        for level, fractions in noise.items()
    )
    text = (
        f"{len(held)} combinations of what the paper leaves open, each on all four simulations; the figure shows for "
        "every value of every choice the share of its combinations under which a claim holds. Recovery after sudden "
        "changes takes depths in metres and P enlarged before the gain, whatever the rest; P0 and theta_0 decide "
        f"how soon k and s are found. No combination gives {len(never)} of the {len(QUESTIONS)} claims "
        f"({'; '.join(QUESTIONS[name].claim for name in never)}). With force noise the claims of Fig. 7a hold, each "
        f"under its best choice and in the order of the rows, in so many of {SEEDS} runs: {counts}."
    )
    claims = (
        Claim(
            "One setting of the estimator gives all of Figs. 7 and 8",
            "all of them, one algorithm",
            f"at most {held[most]} of {len(QUESTIONS)} at once; as printed {held[printed]}; median {np.median(held):g}"
            + "; not: "
            + "; ".join(QUESTIONS[name].claim for name in missing),
            verdict_of(held[printed] == len(QUESTIONS), choice=held[most] == len(QUESTIONS)),
            f"{result.choices[most]}, of {len(held)} combinations",
        ),
    )
    best = {name: best_of(result, name) for name in QUESTIONS}
    data: dict[str, Table] = {
        "combinations": {
            **{name: np.array([getattr(choice, name) for choice in result.choices]) for name in OPEN},
            **{_column(name): np.array([one.value for one in answers]) for name, answers in result.answers.items()},
            **{f"{_column(name)}_holds": holds for name, holds in result.holds.items()},
        },
        "claims": {
            "claim": np.array([question.claim for question in QUESTIONS.values()]),
            "share": np.array([float(result.holds[name].mean()) for name in QUESTIONS]),
            "best_choice": np.array([str(result.choices[index]) for index in best.values()]),
            "best_measured": np.array([result.answers[name][index].text for name, index in best.items()]),
        },
        "noise": {
            "noise_N": np.array(list(noise)),
            **{_column(name): np.array([one[name] for one in noise.values()]) for name in noise[LEVELS[0]]},
        },
    }
    title = "Open choices: which claims hold under which"
    return Section("choices", title, text, _figure(result), data, claims)


def _column(name: str) -> str:
    return name.replace(", ", "_").replace(" ", "_")


def _figure(result: Search) -> Any:
    columns = [(name, value) for name, one in OPEN.items() for value in one.values]
    values = {name: np.array([getattr(choice, name) for choice in result.choices]) for name in OPEN}
    fractions = np.array(
        [
            [result.holds[q].mean()] + [result.holds[q][values[name] == v].mean() for name, v in columns]
            for q in QUESTIONS
        ]
    )
    figure = new_figure(8.6)
    axes = figure.subplots()
    axes.imshow(fractions, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for row, line in enumerate(fractions):
        for column, fraction in enumerate(line):
            text = "" if fraction == 0.0 else f"{100.0 * fraction:.0f}" if fraction >= 0.005 else "<1"
            colour = "white" if fraction > 0.6 else "black"
            axes.text(column, row, text, ha="center", va="center", fontsize="x-small", color=colour)
    names = ["all", *(f"{value:g}" if isinstance(value, float) else str(value) for _, value in columns)]
    axes.set_xticks(range(len(names)), names, rotation=60.0, ha="right", fontsize="small")
    axes.set_yticks(
        range(len(QUESTIONS)),
        ["\n".join(textwrap.wrap(question.claim, 46)) for question in QUESTIONS.values()],
        fontsize="small",
    )
    edge, middles = 0.5, [0.0]
    top = axes.secondary_xaxis("top")
    for one in OPEN.values():
        axes.axvline(edge, color="0.3", linewidth=0.9)
        middles.append(edge + 0.5 * len(one.values))
        edge += len(one.values)
    top.set_xticks(middles, ["", *(one.head for one in OPEN.values())], fontsize="small")
    top.tick_params(length=0)
    axes.set_title("Share of combinations under which a claim holds [%]; empty: none", pad=40.0)
    figure = finished(figure, 1, above=1.0)
    figure.subplots_adjust(left=0.36, bottom=0.11)
    axes.grid(visible=False)
    return figure
