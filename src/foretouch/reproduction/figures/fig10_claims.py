"""The claims of the paper about the parameters of Fig. 10."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from foretouch.reproduction.experiment import (
    FIRST_PRESS,
    PRESS_PERIOD,
    Experiment,
    History,
    in_deep_half,
    jump,
    peak,
    settled_at,
    stiffness_at_force,
    stiffness_in_phases,
    swing,
)
from foretouch.reproduction.relearning import CHOICES, EXACT, ROBUST
from foretouch.reproduction.section import Claim, Outcome, judge

SETTLED_BAND = 0.25
"""s has settled when it stays within so much of its median over the last two presses."""

PAPERS_ITERATION = 50

FURTHER = "sponge let go further"
"""Name of the courses on the sponge that is let go to a third of its depth."""

SAWTOOTH = (
    "strongest sine in ln k after the first press, a quadratic drift taken off; holds within 5 % of the press with "
    "half of the variance"
)

STATED_SHARE = 0.75
"""Depth at which sponge's local stiffness is compared, as a share of the deepest: half-way of its presses."""

MUTATION = 1.0
"""A change of ln k by so much within 0.1 s is a mutation: k changes by a factor of e."""

SYNCHRONOUS = 0.25
"""A peak is at greatest depth when it is no further from it than this [s]."""

PAPERS_STIFFNESS = 150_000.0
SAME_ORDER = 5.0  # a k within this factor of the paper's counts as that k
"""k of the hand at its second peak; the paper writes N/m, its law has N/m^s."""

HIGHEST_FORCE = 15.0
"""At which the hand's stiffness is given [N]."""

Courses = Mapping[str, History]
Test = Callable[[Courses], tuple[bool, str]]


def parameter_claims(experiments: Mapping[str, Experiment], courses: Mapping[str, Courses]) -> list[Claim]:
    """Each claim judged over all choices.

    Args:
        experiments: By name, `FURTHER` and the materials.
        courses: By name of the choice, then by that of the experiment.
    """
    rate = "samples of 1 kHz, 80 ms out and 300 ms back, 0.02 N of force noise, 5 um encoder"
    sponge = f"simulated sponge, five presses of {PRESS_PERIOD:g} s between 7.5 and 15 mm"

    def claim(says: str, paper: str, test: Test, setting: str, *, given: bool = False) -> Claim:
        outcomes = {name: Outcome(name, *test(found)) for name, found in courses.items()}
        deciding = [outcomes[choice.name] for choice in (*CHOICES, ROBUST)]
        beside = [outcomes[ROBUST.name], outcomes[EXACT.name]]
        return judge(says, paper, deciding, f"{setting}; {rate}", beside=beside, given=given)

    return [
        claim(
            "Sponge: the parameters are stabilised at the 50th iteration",
            "50th iteration",
            _settled(SETTLED_BAND),
            f"{sponge}; settled: s stays within {SETTLED_BAND:g} of its median over the last two presses",
        ),
        claim(
            "Sponge: at the 50th iteration the parameters are already in the range of their later swings",
            "50th iteration",
            _settled(None),
            f"{sponge}; the stricter reading: s stays within its range over the last two presses, half as wide again "
            "on either side",
        ),
        claim(
            "Sponge: after that the parameters have the shape of a sawtooth wave, one tooth a press",
            "sawtooth",
            _sawtooth("sponge"),
            f"{sponge}, which is a choice: it hangs on how far the sponge is let go, see the next; {SAWTOOTH}",
            given=True,
        ),
        claim(
            "Sponge, let go to a third of the depth: the same sawtooth",
            "sawtooth",
            _sawtooth(FURTHER),
            f"simulated sponge, five presses of {PRESS_PERIOD:g} s between 5 and 15 mm, where the force falls "
            f"below 0.1 N; {SAWTOOTH}",
        ),
        claim(
            "Sponge: local stiffness is bigger in compression than in restitution",
            "bigger in compression, smaller in restitution",
            _stiffer(experiments["sponge"], slope=True),
            f"{sponge}; dF/dx = k s x^(s-1) at 11.25 mm, medians over the phases after the first compression",
        ),
        claim(
            "Sponge: the identified k is bigger in compression than in restitution",
            "bigger in compression, smaller in restitution",
            _stiffer(experiments["sponge"], slope=False),
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
            _peaks(experiments["hand"]),
            f"simulated hand, three presses of 7, 8.2 and 6.5 mm; largest k at more than half of the press's depth; "
            f"holds where all three are within {SYNCHRONOUS:g} s of the greatest depth and not at the end of that span",
        ),
        claim(
            "Hand: at the second peak k reaches 150,000 and the other two are smaller",
            "150,000 N/m at the second peak",
            _second_peak(experiments["hand"]),
            "simulated hand; largest k at more than half of each press's depth; k is in N/m^s, so what it means "
            "depends on s: s there, and dF/dx of that law pressed slowly to 15 N, are given; holds where the "
            f"second k is the largest and within a factor of {SAME_ORDER:g} of the paper's",
        ),
    ]


def _settled(band: float | None) -> Test:
    def test(found: Courses) -> tuple[bool, str]:
        history = found["sponge"]
        iteration = settled_at(history, PRESS_PERIOD, band)
        if iteration is None:
            return False, "not before the last two presses"
        first = float(history["time"][np.searchsorted(history["iteration"], iteration)])
        return iteration <= PAPERS_ITERATION, f"iteration {iteration}, {first - _touch(history):.1f} s after touching"

    return test


def _touch(history: History) -> float:
    """Time at which learning began [s], from the first notes: nothing is noted before the 20th sample."""
    spacing = float(np.median(np.diff(history["time"][:10])))
    return float(history["time"][0]) - spacing * float(history["iteration"][0])


def _sawtooth(name: str) -> Test:
    def test(found: Courses) -> tuple[bool, str]:
        period, share = swing(found[name], PRESS_PERIOD)
        holds = abs(period - PRESS_PERIOD) <= 0.05 * PRESS_PERIOD and share >= 0.5
        return holds, f"period {period:.2f} s, {100.0 * share:.0f} % of the variance"

    return test


def turns(experiment: Experiment) -> list[float]:
    """Times of the turning points after the first compression [s]; the first of them begins a compression."""
    return [time for time, _ in experiment.script][1:]


def _stiffer(experiment: Experiment, *, slope: bool) -> Test:
    depth = STATED_SHARE * max(depth for _, depth in experiment.script)

    def test(found: Courses) -> tuple[bool, str]:
        k, local = stiffness_in_phases(found["sponge"], turns(experiment), depth)
        into, out = local if slope else k
        return into > out, f"{_three(into)} and {_three(out)} {'N/m' if slope else 'N/m^s'}"

    return test


def _mutates(found: Courses) -> tuple[bool, str]:
    foam, sponge = (jump(found[name], PRESS_PERIOD) for name in ("foam", "sponge"))
    s = found["foam"]["s"][found["foam"]["time"] > FIRST_PRESS + PRESS_PERIOD]
    text = f"{foam:.2f} (sponge {sponge:.2f}), s from {s.min():.2f} to {s.max():.2f}"
    return foam > max(MUTATION, sponge), text


def _deep_halves(experiment: Experiment, history: History) -> list[NDArray[np.intp]]:
    depths = [depth for _, depth in experiment.script if depth > 0.0]
    return [in_deep_half(history, time, depth) for time, depth in zip(experiment.deepest, depths, strict=True)]


def _peaks(experiment: Experiment) -> Test:
    def test(found: Courses) -> tuple[bool, str]:
        history = found["hand"]
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

    return test


def _second_peak(experiment: Experiment) -> Test:
    def test(found: Courses) -> tuple[bool, str]:
        history = found["hand"]
        best = [peak(history["ln_k"], inside) for inside in _deep_halves(experiment, history)]
        tops = [-math.inf if at is None else float(history["ln_k"][at]) for at in best]
        k = " and ".join(_three(_exp(top)) for top in (tops[0], tops[2]))
        if best[1] is None:
            return False, "nothing was learnt there"
        s = float(history["s"][best[1]])
        local = stiffness_at_force(tops[1], s, HIGHEST_FORCE)
        near = abs(tops[1] - math.log(PAPERS_STIFFNESS)) <= math.log(SAME_ORDER)
        holds = near and tops[1] > max(tops[0], tops[2])
        return holds, f"{_three(_exp(tops[1]))} N/m^{s:.2f} ({_three(local)} N/m at 15 N), others {k}"

    return test


def _exp(value: float) -> float:
    return math.exp(min(value, 600.0)) if value > -math.inf else 0.0


def _three(value: float) -> str:
    """Three digits, thousands apart where they are read easily."""
    if not 1.0 <= abs(value) < 1e7:
        return f"{value:.2g}"
    digits = 10 ** max(0, math.floor(math.log10(abs(value))) - 2)
    return f"{round(value / digits) * digits:,d}" if abs(value) >= 100.0 else f"{value:.3g}"
