"""The search of what the paper leaves open: every combination, and which claims hold under it."""

from __future__ import annotations

import textwrap
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import FPRLS
from foretouch.report import finished, new_figure
from foretouch.reproduction.choices import BEST, PRINTED, VALUES, Choice, combinations, runs_of
from foretouch.reproduction.presses import MATERIALS, follow, press
from foretouch.reproduction.questions.tried import QUESTIONS, Answer
from foretouch.reproduction.section import Claim, Section, Table

PURE = ("kelvin-voigt", "hunt-crossley")
"""Materials of Fig. 7a."""

LEVELS, SEEDS = (0.002, 0.005, 0.02, 0.1), 10
"""Of the force noise [N], and how many runs with each."""


class Search:
    """All answers to all questions.

    Attributes:
        choices: All combinations.
        answers: By question, one for each combination.
        holds: By question, whether the claim holds under each combination.
    """

    def __init__(self, choices: list[Choice]) -> None:
        self.choices = choices
        self.answers: dict[str, list[Answer]] = {name: [] for name in QUESTIONS}
        for choice in choices:
            runs = runs_of(choice, MATERIALS)
            for name, question in QUESTIONS.items():
                self.answers[name].append(question.measure(runs))
        self.holds: dict[str, NDArray[np.bool_]] = {
            name: np.array([question.holds(answer) for answer in self.answers[name]])
            for name, question in QUESTIONS.items()
        }

    @property
    def held(self) -> NDArray[np.int64]:
        """How many claims hold under each combination."""
        return np.asarray(sum(holds.astype(np.int64) for holds in self.holds.values()))


def search() -> Search:
    """Try all combinations; some 20 s."""
    return Search(list(combinations()))


def best_of(found: Search, name: str) -> int:
    """Index of a claim's combination: of those that hold the fewest departures, then the nearest; else the nearest."""
    holds, answers = found.holds[name], found.answers[name]

    def rank(index: int) -> tuple[bool, int, float]:
        departures = len(found.choices[index].departures) if holds[index] else 0
        return not holds[index], departures, answers[index].value

    return min(range(len(holds)), key=rank)


def noise_shares() -> dict[float, dict[str, float]]:
    """For force noise of several levels [N], the share of seeds under which each claim of Fig. 7a holds.

    Each claim under its own best choice, exact velocity.
    """
    names = [name for name, question in QUESTIONS.items() if question.materials[0] in PURE]
    shares: dict[float, dict[str, float]] = {}
    for level in LEVELS:
        presses = [{material: press(material, noise=level, seed=seed) for material in PURE} for seed in range(SEEDS)]
        shares[level] = {}
        for name in names:
            question, estimator = QUESTIONS[name], FPRLS(BEST.get(name, PRINTED).options)
            held = 0
            for pressed in presses:
                runs = {}
                for material in question.materials:
                    estimator.reset()
                    runs[material] = (pressed[material], follow(estimator, pressed[material]))
                held += question.holds(question.measure(runs))
            shares[level][name] = held / SEEDS
    return shares


def make() -> Section:
    """Shares of the combinations under which each claim holds, and the best of each."""
    found = search()
    held, printed = found.held, found.choices.index(PRINTED)
    most = min(range(len(held)), key=lambda index: (-held[index], len(found.choices[index].departures)))
    missing = [name for name in QUESTIONS if not found.holds[name][most]]
    never = [name for name, holds in found.holds.items() if not holds.any()]
    text = (
        f"{len(held)} combinations of what the paper leaves open, each on all four simulations; the figure shows for "
        "every value of every choice the share of its combinations under which a claim holds. Recovery after sudden "
        "changes takes depths in metres and P enlarged before the gain, whatever the rest; P0 and theta_0 decide "
        f"how soon k and s are found. No combination gives {len(never)} of the {len(QUESTIONS)} claims "
        f"({'; '.join(QUESTIONS[name].claim for name in never)})."
    )
    noise = noise_shares()
    text += " With force noise the claims of Fig. 7a hold, each under its best choice and in the order of the rows, in "
    text += f"so many of {SEEDS} runs: " + "; ".join(
        f"{level:g} N: " + ", ".join(str(round(SEEDS * share)) for share in shares.values())
        for level, shares in noise.items()
    )
    text += "."
    claims = (
        Claim(
            "One setting of the estimator gives all of Figs. 7 and 8",
            "all of them, one algorithm",
            f"at most {held[most]} of {len(QUESTIONS)} at once; as printed {held[printed]}; median {np.median(held):g}"
            + "; not: "
            + "; ".join(QUESTIONS[name].claim for name in missing),
            "holds"
            if held[printed] == len(QUESTIONS)
            else "holds under stated choice"
            if held[most] == len(QUESTIONS)
            else "does not hold",
            f"{found.choices[most]}, of {len(held)} combinations",
        ),
    )
    data = {"combinations": _table(found), "claims": _claim_table(found), "noise": _noise_table(noise)}
    title = "Open choices: which claims hold under which"
    return Section("choices", title, text, _figure(found), data, claims)


def _table(found: Search) -> Table:
    """Every combination with every value."""
    return {
        **{field.name: np.array([getattr(choice, field.name) for choice in found.choices]) for field in fields(Choice)},
        **{_column(name): np.array([a.value for a in answers]) for name, answers in found.answers.items()},
        **{f"{_column(name)}_holds": holds for name, holds in found.holds.items()},
    }


def _claim_table(found: Search) -> Table:
    """Every claim with its share and its best combination."""
    best = {name: best_of(found, name) for name in QUESTIONS}
    return {
        "claim": np.array([question.claim for question in QUESTIONS.values()]),
        "share": np.array([float(found.holds[name].mean()) for name in QUESTIONS]),
        "best_choice": np.array([str(found.choices[index]) for index in best.values()]),
        "best_measured": np.array([found.answers[name][index].text for name, index in best.items()]),
    }


def _noise_table(noise: dict[float, dict[str, float]]) -> Table:
    """Levels down, claims across."""
    names = next(iter(noise.values()))
    return {
        "noise_N": np.array(list(noise)),
        **{_column(name): np.array([shares[name] for shares in noise.values()]) for name in names},
    }


def _column(name: str) -> str:
    return name.replace(", ", "_").replace(" ", "_")


def _figure(found: Search) -> Any:
    """Claims down, values across, shares in the cells."""
    columns = [(name, value) for name, values in VALUES.items() for value in values]
    values = {name: np.array([getattr(choice, name) for choice in found.choices]) for name in VALUES}
    shares = np.array(
        [[found.holds[q].mean()] + [found.holds[q][values[name] == v].mean() for name, v in columns] for q in QUESTIONS]
    )
    figure = new_figure(8.6)
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for row, line in enumerate(shares):
        for column, share in enumerate(line):
            text = "" if share == 0.0 else f"{100.0 * share:.0f}" if share >= 0.005 else "<1"
            colour = "white" if share > 0.6 else "black"
            axes.text(column, row, text, ha="center", va="center", fontsize="x-small", color=colour)
    names = ["all", *(f"{value:g}" if isinstance(value, float) else str(value) for _, value in columns)]
    axes.set_xticks(range(len(names)), names, rotation=60.0, ha="right", fontsize="small")
    axes.set_yticks(
        range(len(QUESTIONS)),
        ["\n".join(textwrap.wrap(question.claim, 46)) for question in QUESTIONS.values()],
        fontsize="small",
    )
    edge = 0.5
    top = axes.secondary_xaxis("top")
    middles = [0.0]
    for group in VALUES.values():
        axes.axvline(edge, color="0.3", linewidth=0.9)
        middles.append(edge + 0.5 * len(group))
        edge += len(group)
    heads = [
        "",
        "depth\nin",
        "test\non",
        "enlarge P,\nthe gain",
        "P by\ndelta",
        "rho [1/m]",
        "k of\ntheta_0",
        "P0",
        "noise\n[N]",
        "velocity",
    ]
    top.set_xticks(middles, heads, fontsize="small")
    top.tick_params(length=0)
    axes.set_title("Share of combinations under which a claim holds [%]; empty: none", pad=40.0)
    figure = finished(figure, 1, above=1.0)
    figure.subplots_adjust(left=0.36, bottom=0.11)
    axes.grid(visible=False)
    return figure
