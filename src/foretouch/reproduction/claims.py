"""What the paper says beside what was measured."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

__all__ = ["Claim", "Verdict"]

Verdict: TypeAlias = Literal["holds", "holds under stated choice", "does not hold"]


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper, tried.

    Attributes:
        claim: What the paper says, in short.
        paper: Its number or words.
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
