"""One section of the reproduction: a figure of the paper made again, its data, and the claims that it decides.

A claim is what the paper says beside what was measured, under each choice that the paper leaves open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Verdict: TypeAlias = Literal["holds", "holds under stated choice", "does not hold"]


def verdict_of(printed: bool = False, *, choice: bool = False) -> Verdict:
    """The verdict on a claim that holds as printed, or under a stated choice, or neither."""
    return "holds" if printed else "holds under stated choice" if choice else "does not hold"


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper, tried.

    Attributes:
        claim: What the paper says, in short.
        paper: The paper's number or words.
        measured: What was measured here, with unit.
        verdict: Whether it holds as printed, only under a choice that the paper leaves open, or not.
        setting: Under which setting it was measured; for a verdict under a choice, the choice.
    """

    claim: str
    paper: str
    measured: str
    verdict: Verdict
    setting: str

    def as_row(self) -> dict[str, Any]:
        """The claim as plain values, for JSON."""
        return asdict(self)


Table = Mapping[str, NDArray[np.generic]]
"""Columns by name, units in the names (``depth_m``, ``force_N``), all of one length."""


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Attributes:
        name: Short and unique, for `--only` and file names, for example ``"fig7a"``.
        title: What is shown.
        text: A few sentences: what was done, what is seen, what differs from the paper.
        figure: A Matplotlib figure, None where there is only a table.
        data: Everything that the figure draws, by name of the table.
        claims: The claims of the paper that it decides.
    """

    name: str
    title: str
    text: str
    figure: Any = None
    data: Mapping[str, Table] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()


class Outcome(NamedTuple):
    """One choice by name, whether the claim holds under it, and what was measured, with unit."""

    choice: str
    holds: bool
    measured: str


def judge(
    claim: str,
    paper: str,
    outcomes: Sequence[Outcome],
    setting: str,
    *,
    beside: Sequence[Outcome] = (),
    given: bool = False,
) -> Claim:
    """A claim from its outcomes, the printed one first, then in the order in which they are preferred.

    It holds where it holds under the first choice, which is the printed one; under a stated choice where another one
    gives it, and then the first that does is stated, and how many do. Outcomes `beside` are reported and do not decide.
    Where the setting itself is `given` by a choice that the paper leaves open, it holds under a stated choice at best.
    """
    printed = outcomes[0]
    giving = [outcome for outcome in outcomes if outcome.holds]
    measured = [f"as printed {printed.measured}"]
    verdict: Verdict = "does not hold"
    under = printed.choice
    if printed.holds:
        verdict = "holds under stated choice" if given else "holds"
    elif giving:
        verdict, under = "holds under stated choice", giving[0].choice
        measured.append(f"under the choice {giving[0].measured}")
    shown = {printed.choice, under}
    measured += [f"{outcome.choice} {outcome.measured}" for outcome in beside if outcome.choice not in shown]
    count = f"holds under {len(giving)} of {len(outcomes)} choices"
    return Claim(claim, paper, "; ".join(measured), verdict, f"{under}; {setting}; {count}")
