"""From what was measured under each choice to one claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from foretouch.reproduction.claims import Claim, Verdict

__all__ = ["Outcome", "judge"]


@dataclass(frozen=True)
class Outcome:
    """What came of one choice.

    Attributes:
        choice: Its name.
        holds: Whether the claim holds under it.
        measured: With unit.
    """

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
    """A claim from its outcomes.

    It holds where it holds under the first choice, which is the printed one; under a stated choice where another one
    gives it, and then the first that does is stated, and how many do.

    Args:
        claim: What the paper says.
        paper: Its words or numbers.
        outcomes: At least one, the printed one first, then in the order in which they are preferred.
        setting: How it was measured.
        beside: To be reported but not to decide.
        given: Whether the setting itself holds a choice that the paper leaves open and on which the verdict hangs; then
            the claim holds under a stated choice at best.
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
