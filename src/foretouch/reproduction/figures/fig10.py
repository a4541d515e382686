"""Fig. 10: parameters estimated over time on sponge, foam and hand, the claims about them, and the drawing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.models import ContactModel
from foretouch.quantities import Array
from foretouch.report import COLOURS, finished, new_figure
from foretouch.reproduction.experiment import (
    FIRST_PRESS,
    FURTHER_BACK,
    MATERIALS,
    PRESS_PERIOD,
    Experiment,
    History,
    in_deep_half,
    jump,
    material_stiffness,
    peak,
    run_experiment,
    settled_at,
    stiffness_at_force,
    stiffness_in_phases,
    swing,
)
from foretouch.reproduction.relearning import (
    AS_PRINTED,
    CHOICES,
    EVERY,
    EXACT,
    ROBUST,
    Choice,
    drawn,
    learn_again,
    legend_of,
    outcomes,
)
from foretouch.reproduction.section import Claim, Section, judge

SETTLED_BAND = 0.25  # band around its median over the last two presses within which s counts as settled

PAPERS_ITERATION = 50  # at which the paper has the sponge's parameters stabilised
FURTHER = "sponge let go further"  # name of the courses on the sponge that is let go to a third of its depth

SAWTOOTH = (
    "strongest sine in ln k after the first press, a quadratic drift taken off; holds within 5 % of the press with "
    "half of the variance"
)

STATED_SHARE = 0.75
"""Depth at which sponge's local stiffness is compared, as a ratio to the deepest: half-way of its presses."""

MUTATION = 1.0  # change of ln k within 0.1 s that counts as a mutation: k changes by a factor of e
SYNCHRONOUS = 0.25  # a peak is at greatest depth when it is no further from it than this [s]

PAPERS_STIFFNESS = 150_000.0  # k of the hand at its second peak; the paper writes N/m, its law has N/m^s
SAME_ORDER = 5.0  # a k within this factor of the paper's counts as that k
HIGHEST_FORCE = 15.0  # force at which the hand's stiffness is given [N]

Courses = Mapping[str, History]
Test = Callable[[Courses], tuple[bool, str]]


def parameter_claims(experiments: Mapping[str, Experiment], courses: Mapping[str, Courses]) -> list[Claim]:
    """Each claim judged over all choices; courses are by name of the choice, then by that of the experiment."""
    rate = "samples of 1 kHz, 80 ms out and 300 ms back, 0.02 N of force noise, 5 um encoder"
    sponge = f"simulated sponge, five presses of {PRESS_PERIOD:g} s between 7.5 and 15 mm"

    def claim(says: str, paper: str, test: Test, setting: str, *, given: bool = False) -> Claim:
        deciding, beside = outcomes(courses, test)
        return judge(says, paper, deciding, f"{setting}; {rate}", beside=beside, given=given)

    return [
        claim(
            "Sponge: the parameters are stabilised at the 50th iteration",
            "50th iteration",
            partial(_settled, SETTLED_BAND),
            f"{sponge}; settled: s stays within {SETTLED_BAND:g} of its median over the last two presses",
        ),
        claim(
            "Sponge: at the 50th iteration the parameters are already in the range of their later swings",
            "50th iteration",
            partial(_settled, None),
            f"{sponge}; the stricter reading: s stays within its range over the last two presses, half as wide again "
            "on either side",
        ),
        claim(
            "Sponge: after that the parameters have the shape of a sawtooth wave, one tooth a press",
            "sawtooth",
            partial(_sawtooth, "sponge"),
            f"{sponge}, which is a choice: it hangs on how far the sponge is let go, see the next; {SAWTOOTH}",
            given=True,
        ),
        claim(
            "Sponge, let go to a third of the depth: the same sawtooth",
            "sawtooth",
            partial(_sawtooth, FURTHER),
            f"simulated sponge, five presses of {PRESS_PERIOD:g} s between 5 and 15 mm, where the force falls "
            f"below 0.1 N; {SAWTOOTH}",
        ),
        claim(
            "Sponge: local stiffness is bigger in compression than in restitution",
            "bigger in compression, smaller in restitution",
            partial(_stiffer, experiments["sponge"], True),
            f"{sponge}; dF/dx = k s x^(s-1) at 11.25 mm, medians over the phases after the first compression",
        ),
        claim(
            "Sponge: the identified k is bigger in compression than in restitution",
            "bigger in compression, smaller in restitution",
            partial(_stiffer, experiments["sponge"], False),
            f"{sponge}; medians of k over the phases after the first compression, whatever s is then",
        ),
        claim(
            "Foam: the parameters change dramatically and can easily mutate",
            "change dramatically, easily mutate",
            _mutates,
            f"simulated foam, five presses of {PRESS_PERIOD:g} s between 9.5 and 19 mm; largest change of ln k within "
            "0.1 s after the first press; holds above 1 (a factor of e) and above the sponge's",
        ),
        claim(
            "Hand: the parameters have three convex peaks, each at the greatest depth of its press",
            "three peaks in each subfigure",
            partial(_peaks, experiments["hand"]),
            f"simulated hand, three presses of 7, 8.2 and 6.5 mm; largest k at more than half of the press's depth; "
            f"holds where all three are within {SYNCHRONOUS:g} s of the greatest depth and not at the end of that span",
        ),
        claim(
            "Hand: at the second peak k reaches 150,000 and the other two are smaller",
            "150,000 N/m at the second peak",
            partial(_second_peak, experiments["hand"]),
            "simulated hand; largest k at more than half of each press's depth; k is in N/m^s, so what it means "
            "depends on s: s there, and dF/dx of that law pressed slowly to 15 N, are given; holds where the "
            f"second k is the largest and within a factor of {SAME_ORDER:g} of the paper's",
        ),
    ]


def _settled(band: float | None, result: Courses) -> tuple[bool, str]:
    history = result["sponge"]
    iteration = settled_at(history, PRESS_PERIOD, band)
    if iteration is None:
        return False, "not before the last two presses"
    first = float(history["time"][np.searchsorted(history["iteration"], iteration)])
    # Learning began before the first notes: nothing is noted before the 20th sample.
    spacing = float(np.median(np.diff(history["time"][:10])))
    touch = float(history["time"][0]) - spacing * float(history["iteration"][0])
    return iteration <= PAPERS_ITERATION, f"iteration {iteration}, {first - touch:.1f} s after touching"


def _sawtooth(name: str, result: Courses) -> tuple[bool, str]:
    period, fraction = swing(result[name], PRESS_PERIOD)
    holds = abs(period - PRESS_PERIOD) <= 0.05 * PRESS_PERIOD and fraction >= 0.5
    return holds, f"period {period:.2f} s, {100.0 * fraction:.0f} % of the variance"


def turns(experiment: Experiment) -> list[float]:
    """Times of the turning points after the first compression [s]; the first of them begins a compression."""
    return [time for time, _ in experiment.script][1:]


def _stiffer(experiment: Experiment, slope: bool, result: Courses) -> tuple[bool, str]:
    depth = STATED_SHARE * max(depth for _, depth in experiment.script)
    k, local = stiffness_in_phases(result["sponge"], turns(experiment), depth)
    into, out = local if slope else k
    return into > out, f"{_three(into)} and {_three(out)} {'N/m' if slope else 'N/m^s'}"


def _mutates(result: Courses) -> tuple[bool, str]:
    foam, sponge = (jump(result[name], PRESS_PERIOD) for name in ("foam", "sponge"))
    s = result["foam"]["s"][result["foam"]["time"] > FIRST_PRESS + PRESS_PERIOD]
    text = f"{foam:.2f} (sponge {sponge:.2f}), s from {s.min():.2f} to {s.max():.2f}"
    return foam > max(MUTATION, sponge), text


def _deep_halves(experiment: Experiment, history: History) -> list[NDArray[np.intp]]:
    depths = [depth for _, depth in experiment.script if depth > 0.0]
    return [in_deep_half(history, time, depth) for time, depth in zip(experiment.deepest, depths, strict=True)]


def _peaks(experiment: Experiment, result: Courses) -> tuple[bool, str]:
    history = result["hand"]
    late, good = [], 0
    for time, inside in zip(experiment.deepest, _deep_halves(experiment, history), strict=True):
        best = peak(history["ln_k"], inside)
        if best is None:
            late.append("none")
            continue
        apart = float(history["time"][best]) - time
        ends = best in (inside[0], inside[-1])
        good += abs(apart) <= SYNCHRONOUS and not ends
        late.append(f"{apart:+.2f}{' (end)' if ends else ''}")
    return good == len(late), f"largest k {', '.join(late)} s from the greatest depth"


def _second_peak(experiment: Experiment, result: Courses) -> tuple[bool, str]:
    history = result["hand"]
    best = [peak(history["ln_k"], inside) for inside in _deep_halves(experiment, history)]
    tops = [-math.inf if at is None else float(history["ln_k"][at]) for at in best]
    first, second, third = (_three(math.exp(min(top, 600.0))) for top in tops)
    if best[1] is None:
        return False, "nothing was learnt there"
    s = float(history["s"][best[1]])
    local = stiffness_at_force(tops[1], s, HIGHEST_FORCE)
    near = abs(tops[1] - math.log(PAPERS_STIFFNESS)) <= math.log(SAME_ORDER)
    holds = near and tops[1] > max(tops[0], tops[2])
    return holds, f"{second} N/m^{s:.2f} ({_three(local)} N/m at 15 N), others {first} and {third}"


def _three(value: float) -> str:
    """Three digits, thousands apart where they are read easily."""
    if not 1.0 <= abs(value) < 1e7:
        return f"{value:.2g}"
    digits = 10 ** max(0, math.floor(math.log10(abs(value))) - 2)
    return f"{round(value / digits) * digits:,d}" if abs(value) >= 100.0 else f"{value:.3g}"


ESTIMATOR_COLOURS = {"printed": COLOURS[4], "choice": COLOURS[3], "robust": COLOURS[0], "exact": COLOURS[2]}
"""Colours of the estimators, in Fig. 10 and Fig. 11 alike; black and vermillion are left for true and delayed force."""

ROWS = {
    "k": ("k [N/m$^s$]", "log", (1e1, 1e8)),
    "s": ("s [-]", "linear", (-1.0, 5.0)),
    "b1": ("$b_1$ [s/m]", "linear", (-40.0, 40.0)),
    "b2": ("$b_2$ [s]", "linear", (-0.5, 0.5)),
    "damping": ("$\\lambda$ [N s/m$^{n+1}$]", "log", (1e1, 1e7)),
    "exponent": ("n [-]", "linear", (-0.5, 2.5)),
    "switching": ("$\\alpha$ [-]", "linear", (-0.05, 1.05)),
}
"""Label, scale, and the range that is drawn of each parameter: the same for all materials, to compare them."""

LONGEST_LINE = 0.1  # notes further apart than this are not joined [s]: nothing was learnt between


def parameters_figure(
    courses: Mapping[str, Courses], shown: Mapping[str, Choice], deepest: Mapping[str, Sequence[float]]
) -> Any:
    """Materials side by side, parameters one below the other, over time; grey lines where the probe is deepest [s]."""
    figure = new_figure(13.5)
    grid = figure.subplots(len(ROWS), len(deepest), sharex=True, sharey="row")
    for column, (material, times) in enumerate(deepest.items()):
        for axes, (name, (label, scale, limits)) in zip(grid[:, column], ROWS.items(), strict=True):
            for time in times:
                axes.axvline(time, color="0.75", linewidth=0.8)
            for short, choice in shown.items():
                line = _line(courses[choice.name][material], name)
                axes.plot(*line, label=legend_of(choice), color=ESTIMATOR_COLOURS[short], linewidth=1.2)
            axes.set(yscale=scale, ylim=limits)
            if column == 0:
                axes.set_ylabel(label)
        grid[0][column].set_title(f"({'abc'[column]}) {material.capitalize()}")
        grid[-1][column].set_xlabel("time [s]")
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
        choice.name: {name: learn_again(one.log, choice) for name, one in experiments.items()} for choice in EVERY
    }
    claims = parameter_claims(experiments, courses)
    # Beside the printed one stands the choice that most claims hold under, as their settings name it.
    named = [claim.setting.partition(";")[0] for claim in claims if claim.verdict == "holds under stated choice"]
    count = [named.count(choice.name) for choice in CHOICES]
    beside = CHOICES[int(np.argmax(count))] if any(count[1:]) else CHOICES[1]
    shown = drawn(beside)
    data = {
        f"{name}-{label}": _table(courses[choice.name][name]) for name in MATERIALS for label, choice in shown.items()
    }
    figure = parameters_figure(courses, shown, {name: experiments[name].deepest for name in MATERIALS})
    title = "Fig. 10: parameters estimated on sponge, foam and hand"
    return Section("fig10", title, _text(experiments, courses, beside), figure, data, tuple(claims))


def _table(history: History) -> dict[str, Array]:
    due = np.unique(np.floor(50.0 * history["time"]), return_index=True)[1]  # fifty rows a second at most
    units = {"time": "_s", "depth": "_m", "velocity": "_m_s", "force": "_N", "b1": "_s_m", "b2": "_s"}
    names = ("time", "iteration", "depth", "velocity", "force", "ln_k", *list(ROWS)[1:])
    return {name + units.get(name, ""): history[name][due] for name in names}


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
    fractions = "; ".join(
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
        "earlier, as printed mostly in the release. lambda, n and alpha are what the "
        f"estimator itself calls determined in this share of its samples: {fractions}."
    )
