"""A section of a session's report: its sentences, its block of text, and what a page draws of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from foretouch.report.numbers import Finding
from foretouch.session.workspace import LINE, SPACE, WORKSPACES
from foretouch.settings import NO_BASELINE

if TYPE_CHECKING:
    from foretouch.messages import SessionLog
    from foretouch.report.rows import Pairs, Segment
    from foretouch.session.workspace import Line


@dataclass(frozen=True, eq=False)
class View:
    """A session as the drawings of its sections look at it."""

    log: SessionLog  # its longest part in which nothing changed
    pairs: Pairs  # the rows of that part at equal command
    report: Mapping[str, Any]  # result of `session_figures`
    start_ns: int  # time zero of the drawings by the follower's clock [ns]
    away: list[Segment]  # segments in which the robot was not at its commanded position, since then
    found: Any  # `foretouch.report.scene.LineFindings` or `SceneFindings`

    @property
    def wanted(self) -> str:
        """Name of the force before the limits: that of a baseline is no prediction."""
        return "predicted" if self.report["baseline"] == NO_BASELINE else "asked for"


class Drawing(NamedTuple):
    """A Matplotlib figure, and the sentence below it."""

    figure: Any
    caption: str


def nothing(*_: Any) -> tuple[()]:
    """Default of a section without text or drawings."""
    return ()


class Section(NamedTuple):
    """One section of a report; each function gives nothing where the session has nothing of that to show.

    It is `of` sessions along a line, in a scene, or both.
    """

    name: str
    findings: Callable[[Mapping[str, Any]], Iterable[Finding]] = nothing
    lines: Callable[[Mapping[str, Any]], Iterable[str]] = nothing
    drawings: Callable[[View], Iterable[Drawing]] = nothing
    of: tuple[Line, ...] = (LINE, SPACE)


def workspace_of(report: Mapping[str, Any]) -> Line:
    """What the session of a report was in."""
    return WORKSPACES["scene" in report]


def sections_of(report: Mapping[str, Any], order: Sequence[Section]) -> list[Section]:
    """Those of a report along a line or in a scene."""
    return [section for section in order if workspace_of(report) in section.of]
