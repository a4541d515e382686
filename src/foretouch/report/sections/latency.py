"""Where the time goes: the stages of the loop, their sum, and the loop as the motion shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from foretouch.quantities import new_figure
from foretouch.report.drawing import ERROR, PREDICTED, TRUE, finished, legend
from foretouch.report.numbers import Finding, figure, number
from foretouch.report.sections import Drawing, Section, View
from foretouch.session.latency import HALVES, IN_THE_LOOP, STAGES

APART = 0.1  # A sum that is further from the measured loop than this fraction of it, or 5 ms, does not explain it
APART_MS = 5.0


def _unexplained(report: Mapping[str, Any]) -> Iterator[Finding]:
    latency = report["latency"]
    summed, loop = latency["sum_ms"], latency["loop_ms"]
    if summed is not None and loop is not None and abs(summed - loop) > max(APART * loop, APART_MS):
        sums = f"{number(summed, 'ms')} where the motion shows {number(loop, 'ms')}"
        yield Finding(f"The stages of the loop add up to {sums}: some of its time is not explained.")


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    latency = report["latency"]
    medians, worst = latency["stages_ms"], latency["worst_ms"]
    if latency["sum_ms"] is None:
        return
    yield "Where the time goes (median / 99 %)"
    for name, what in STAGES.items():
        if medians[name] is not None:
            mark = " " if name in IN_THE_LOOP else "*"
            several = worst[name] != medians[name]
            times = f"{figure(medians[name])}{f' / {figure(worst[name])}' if several else ''} ms"
            yield f" {mark}{name.replace('_', ' '):<10} {times:<18} {what.partition(':')[0]}"
    yield f"  sum        {number(latency['sum_ms'], 'ms')}, by the motion {number(latency['loop_ms'], 'ms')}"
    if latency["clocks"] == HALVES:
        yield f"  {HALVES}"
    yield " *not in the sum: the motion that comes back does not wait for it"
    yield ""


def _drawings(view: View) -> Iterator[Drawing]:
    if view.report["latency"]["sum_ms"] is not None:
        yield Drawing(latency_figure(view.report["latency"]), "Where the time goes between a motion and its answer")


def latency_figure(latency: Mapping[str, Any]) -> Any:
    """The stages one after the other, each with its time, and the loop as the motion shows it."""
    drawing = new_figure(3.6)
    axes, begin = drawing.subplots(), 0.0
    names = [name for name in STAGES if latency["stages_ms"][name] is not None]
    for row, name in enumerate(names):
        taken, inside = latency["stages_ms"][name], name in IN_THE_LOOP
        style = {"color": PREDICTED} if inside else {"facecolor": "none", "edgecolor": PREDICTED, "hatch": "///"}
        axes.barh(row, taken, left=begin, height=0.6, **style)
        axes.annotate(f"{figure(taken)} ms", (begin + taken, row), (4, 0), textcoords="offset points", va="center")
        begin += taken if inside else 0.0
    axes.axvline(latency["sum_ms"], color=TRUE, linewidth=1.0, label="sum of the filled ones")
    if latency["loop_ms"] is not None:
        axes.axvline(latency["loop_ms"], color=ERROR, linewidth=1.6, linestyle="--", label="loop, by the motion alone")
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.invert_yaxis()
    axes.set(xlabel="time since the motion of the hand [ms]", title="Where the time goes")
    axes.set_xlim(0.0, 1.18 * max(latency["sum_ms"], latency["loop_ms"] or 0.0, 1.0))
    legend(axes, columns=2)
    finished(drawing, 1).subplots_adjust(left=0.11)
    return drawing


LATENCY = Section("latency", _unexplained, _lines, _drawings)
