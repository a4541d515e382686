"""Fig. 10: parameters estimated over time on sponge, foam and hand, and its drawing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.models import ContactModel
from foretouch.report import COLOURS, finished, new_figure
from foretouch.reproduction.experiment import (
    FURTHER_BACK,
    MATERIALS,
    PRESS_PERIOD,
    Array,
    Experiment,
    History,
    jump,
    material_stiffness,
    run_experiment,
)
from foretouch.reproduction.figures.fig10_claims import (
    FURTHER,
    HIGHEST_FORCE,
    STATED_SHARE,
    Courses,
    parameter_claims,
    turns,
)
from foretouch.reproduction.relearning import AS_PRINTED, CHOICES, EXACT, ROBUST, Choice, learn_again
from foretouch.reproduction.section import Claim, Section

ESTIMATOR_COLOURS = {"printed": COLOURS[4], "choice": COLOURS[3], "robust": COLOURS[0], "exact": COLOURS[2]}
"""Of the estimators, in Fig. 10 and Fig. 11 alike; black and vermillion are left for true and delayed force."""

ROWS = (
    ("k", "k [N/m$^s$]", (1e1, 1e8)),
    ("s", "s [-]", (-1.0, 5.0)),
    ("b1", "$b_1$ [s/m]", (-40.0, 40.0)),
    ("b2", "$b_2$ [s]", (-0.5, 0.5)),
    ("damping", "$\\lambda$ [N s/m$^{n+1}$]", (1e1, 1e7)),
    ("exponent", "n [-]", (-0.5, 2.5)),
    ("switching", "$\\alpha$ [-]", (-0.05, 1.05)),
)
"""Parameter, label, and the range that is drawn: the same for all materials, so that they can be compared."""

LOGARITHMIC = ("k", "damping")
LONGEST_LINE = 0.1
"""Notes further apart than this are not joined [s]: nothing was learnt between."""


def parameters_figure(
    courses: Mapping[str, Sequence[History]], labels: Sequence[str], deepest: Mapping[str, Sequence[float]]
) -> Any:
    """Materials side by side, parameters one below the other, over time; grey lines where the probe is deepest.

    Args:
        courses: By material, one of each estimator.
        labels: Of the estimators.
        deepest: By material, times of greatest depth [s].
    """
    figure = new_figure(13.5)
    grid = figure.subplots(len(ROWS), len(courses), sharex=True, sharey="row")
    for column, (material, histories) in enumerate(courses.items()):
        for row, (name, label, limits) in enumerate(ROWS):
            axes = grid[row][column]
            for time in deepest[material]:
                axes.axvline(time, color="0.75", linewidth=0.8)
            for history, colour, estimator in zip(histories, ESTIMATOR_COLOURS.values(), labels, strict=True):
                axes.plot(*_line(history, name), label=estimator, color=colour, linewidth=1.2)
            if name in LOGARITHMIC:
                axes.set_yscale("log")
            axes.set_ylim(*limits)
            if column == 0:
                axes.set_ylabel(label)
            if row == 0:
                axes.set_title(f"({'abc'[column]}) {material.capitalize()}")
            if row == len(ROWS) - 1:
                axes.set_xlabel("time [s]")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=2)
    return finished(figure, len(ROWS), above=0.95, gap=0.25, between=0.08)


def _line(history: History, name: str) -> tuple[Array, Array]:
    """Time and values, broken where nothing was learnt."""
    time = history["time"]
    with np.errstate(over="ignore"):
        values = np.exp(history["ln_k"]) if name == "k" else history[name]
    breaks = np.flatnonzero(np.diff(time) > max(LONGEST_LINE, 1.5 * float(np.median(np.diff(time))))) + 1
    return np.insert(time, breaks, np.nan), np.insert(values, breaks, np.nan)


CITED_STIFFNESS = (700.0, 75_000.0)
"""Interval of the hand's dF/dx at 15 N [N/m]: see `foretouch.robot` on the material hand."""


def make() -> Section:
    """Sessions on three materials, learnt again under every choice."""
    experiments = {name: run_experiment(name) for name in MATERIALS}
    experiments[FURTHER] = run_experiment("sponge", back=FURTHER_BACK)
    courses = {
        choice.name: {name: learn_again(one.log, choice) for name, one in experiments.items()}
        for choice in (*CHOICES, ROBUST, EXACT)
    }
    claims = parameter_claims(experiments, courses)
    shown = _shown(claims)
    text = _text(experiments, courses, shown)
    data = {
        f"{name}-{label}": _table(courses[choice.name][name])
        for name in MATERIALS
        for label, choice in (("printed", AS_PRINTED), ("choice", shown), ("robust", ROBUST), ("exact", EXACT))
    }
    figure = parameters_figure(
        {name: [courses[c.name][name] for c in (AS_PRINTED, shown, ROBUST, EXACT)] for name in MATERIALS},
        ["fprls, as printed", shown.name, "robust-fprls", "exact"],
        {name: experiments[name].deepest for name in MATERIALS},
    )
    title = "Fig. 10: parameters estimated on sponge, foam and hand"
    return Section("fig10", title, text, figure, data, tuple(claims))


def _shown(claims: list[Claim]) -> Choice:
    """The choice beside the printed one in the figure: the one that most claims hold under, as their settings name."""
    named = [claim.setting.partition(";")[0] for claim in claims if claim.verdict == "holds under stated choice"]
    count = [named.count(choice.name) for choice in CHOICES]
    return CHOICES[int(np.argmax(count))] if any(count[1:]) else CHOICES[1]


def _table(history: History) -> dict[str, Array]:
    """Fifty rows a second at most."""
    due = np.unique(np.floor(50.0 * history["time"]), return_index=True)[1]
    names = {
        "time": "time_s",
        "iteration": "iteration",
        "depth": "depth_m",
        "velocity": "velocity_m_s",
        "force": "force_N",
        "ln_k": "ln_k",
        "s": "s",
        "b1": "b1_s_m",
        "b2": "b2_s",
        "damping": "damping",
        "exponent": "exponent",
        "switching": "switching",
    }
    return {column: history[name][due] for name, column in names.items()}


def _least_force(experiment: Experiment) -> float:
    """Least force [N] after the first compression."""
    follower = experiment.log.follower
    return float(follower["exact_force"][follower["time_ns"] * 1e-9 > experiment.deepest[0] + 0.5].min())


def slow_stiffness(model: ContactModel, force: float, *, speed: float = 0.01) -> float:
    """dF/dx [N/m] of a material pressed at an even speed [m/s] from rest, where its force first is `force` [N]."""
    state, period, depth, before = model.initial_state(), 1e-3, 0.0, 0.0
    while before < force and depth < 0.1:
        depth += speed * period
        state, now, _ = model.advance(state, depth, speed, period)
        if now >= force:
            return (now - before) / (speed * period)
        before = now
    return math.nan


def _text(experiments: Mapping[str, Experiment], courses: Mapping[str, Courses], shown: Choice) -> str:
    sponge, hand = experiments["sponge"], experiments["hand"]
    felt = sponge.log.follower[sponge.log.follower["command_sequence"] > 0]
    clock = (felt["time_ns"] - felt["time_ns"][0]) * 1e-9
    at = sponge.material.surface + STATED_SHARE * max(depth for _, depth in sponge.script)
    slopes = material_stiffness(felt["position"], felt["exact_force"], turns(sponge), clock, at)
    further = courses[AS_PRINTED.name][FURTHER]
    own = slow_stiffness(hand.material.model, HIGHEST_FORCE)
    inside = "within" if CITED_STIFFNESS[0] <= own <= CITED_STIFFNESS[1] else "outside"
    shares = "; ".join(
        f"{name} "
        + ", ".join(
            f"{100.0 * float(np.isfinite(courses[choice.name][name]['switching']).mean()):.0f} % ({choice_name})"
            for choice_name, choice in (("printed", AS_PRINTED), ("robust", ROBUST), ("exact", EXACT))
        )
        for name in MATERIALS
    )
    return (
        "The real follower and leader press three simulated materials in simulated time. The materials are none of the "
        "laws that are identified. Sponge and foam are penetrated and then compressed and let go repeatedly, as the "
        f"paper says, in presses of {PRESS_PERIOD:g} s (it gives no times); the hand is pressed three times, the "
        "second time deepest. The paper's estimator learns again from the same session under 18 combinations of what "
        "the paper leaves open: 1000, 100 or 10 samples a second, rho of 100, 1000 or 10000 /m, a test on ln F or "
        f"on newtons. Shown are the printed defaults, {shown.name}, robust-fprls, and our own exact; the ranges "
        "drawn are limited, and grey lines are the greatest depths. The sponge itself is "
        f"stiffer in compression: {np.mean(slopes[0::2]):.0f} N/m at {1e3 * (at - sponge.material.surface):.2f} mm, "
        f"and {np.mean(slopes[1::2]):.0f} N/m in restitution. ln k and s move together: a change of s by 1 at about "
        "10 mm goes with a change of ln k by 4.6, so k alone is no stiffness. How far the sponge is let "
        "go decides much: to a half of the depth the force never falls below "
        f"{_least_force(sponge):.2f} N, to a third it falls to {_least_force(experiments[FURTHER]):.2f} N, and as "
        f"printed ln k then jumps by {jump(further, PRESS_PERIOD):.1f} within 0.1 s. The hand "
        f"has {own:.0f} N/m at 15 N when it is pressed at 10 mm/s, {inside} the cited {CITED_STIFFNESS[0]:g} to "
        f"{CITED_STIFFNESS[1]:g} N/m. On the simulated hand k is largest not at the greatest depth but later or "
        "earlier, as printed mostly on the way out. lambda, n and alpha are what the "
        f"estimator itself calls determined in this share of its samples: {shares}."
    )
