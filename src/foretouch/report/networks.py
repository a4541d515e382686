"""What a network does to a session, from the trace of its delays: figures, lines and a drawing."""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.errors import plural
from foretouch.link import NetworkTrace
from foretouch.quantities import new_figure
from foretouch.report.drawing import COLOURS, finished, legend
from foretouch.session import SessionSettings

HOLDS, UNLOADS, STALE = (
    SessionSettings.hold_after,
    SessionSettings.unload_after,
    SessionSettings.queueing_allowance,
)
"""Time without commands after which a follower holds, and unloads, and that a command may wait on its way [s]."""

STEEP = 20.0  # Ratio of the largest delay to the smallest from which a drawing has a logarithmic axis
STREAM = 1e-3  # Time between two commands [s]


def network_figures(trace: NetworkTrace) -> dict[str, Any]:
    """Figures of a trace, by name with the unit, ready for JSON.

    The delays ``each_way_*`` are those of a session; ``measured_*`` are those of the rows, round trips or one way, as
    ``measured`` says. A command counts as stale where its delay exceeds the shortest of the trace by more than the
    default allowance; a session compares with the shortest of the last minute.
    """
    sent = np.arange(0.0, trace.time[-1], STREAM)
    delay = trace.arrivals(sent) - sent
    lengths = trace.stalls[:, 1]
    median, p95, p99, largest = (float(each) for each in np.percentile(delay, [50.0, 95.0, 99.0, 100.0]))
    rows = [float(each) for each in np.percentile(trace.measured, [50.0, 95.0, 100.0])]
    return {
        "name": trace.name,
        "length_s": trace.length,
        "rows": int(trace.time.size),
        "measured": "one way" if trace.one_way else "round trip",
        **dict(zip(("measured_median_s", "measured_p95_s", "measured_max_s"), rows, strict=True)),
        "each_way_median_s": median,
        "each_way_p95_s": p95,
        "each_way_p99_s": p99,
        "each_way_max_s": largest,
        "longest_stall_s": trace.longest_stall,
        "stalls_that_hold": int((lengths > HOLDS).sum()),
        "stalls_that_unload": int((lengths > UNLOADS).sum()),
        "stale_percent": 100.0 * float((delay > delay.min() + STALE).mean()),
        "spacing_s": trace.spacing,
        "source": trace.source,
        "licence": trace.licence,
    }


def network_lines(trace: NetworkTrace) -> list[str]:
    """The same for people."""
    figures = network_figures(trace)
    lines = [
        f"{trace.name}: {trace.length:.1f} s, {plural(trace.time.size, 'row')}; after its end it begins again",
        f"  {figures['measured']:<15} {_three(figures, 'measured', 'p95')}",
        f"  each way        {_three(figures, 'each_way', 'p99')}",
        f"  longest stall   {in_ms(trace.longest_stall)}",
        f"  holds           {plural(figures['stalls_that_hold'], 'stall')} longer than {in_ms(HOLDS)}, in which a "
        f"follower holds, {figures['stalls_that_unload']} longer than {in_ms(UNLOADS)}, in which it unloads",
        f"  stale           {figures['stale_percent']:.1f} % of commands come more than {in_ms(STALE)} later than the "
        "first can, and are not obeyed",
    ]
    if trace.spacing:
        lines.append(f"  spacing         one message of each kind each {in_ms(trace.spacing)}; the others are lost")
    lines.append(f"  source          {trace.source}")
    return lines + [f"  licence         {trace.licence}"] * bool(trace.licence)


def network_row(trace: NetworkTrace) -> str:
    """One line of a list."""
    figures = network_figures(trace)
    delays = "".join(f"{in_ms(figures[f'measured_{name}_s']):>10}" for name in ("median", "p95", "max"))
    stall = in_ms(trace.longest_stall)
    return f"{trace.name:<20}{trace.length:>7.1f} s  {figures['measured']:<10}{delays}{stall:>12}"


LIST_HEAD = f"{'name':<20}{'length':>9}  {'measured':<10}{'median':>10}{'95 %':>10}{'largest':>10}{'stall':>12}"
"""Head of a list of `network_row`."""


def _three(figures: dict[str, Any], name: str, upper: str) -> str:
    median, most_of, largest = (in_ms(figures[f"{name}_{which}_s"]) for which in ("median", upper, "max"))
    return f"median {median}, {upper[1:]} % {most_of}, largest {largest}"


def in_ms(seconds: float) -> str:
    """A time as people read it, in milliseconds below a second."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.2f} s"


def network_figure(trace: NetworkTrace) -> Any:
    """Delay over time, as measured and each way in a session, with the stalls in which a follower holds shaded."""
    drawing = new_figure(4.0)
    axes = drawing.subplots()
    sent = np.arange(0.0, trace.time[-1], max(STREAM, trace.time[-1] / 200_000.0))
    delay = 1e3 * (trace.arrivals(sent) - sent)
    measured = 1e3 * trace.measured
    kind = "one way" if trace.one_way else "round trip"
    axes.plot(trace.time, measured, ".", markersize=2.5, color="0.6", label=f"{kind}, by the trace")
    axes.plot(sent, delay, color=COLOURS[0], linewidth=0.9, label="each way, in a session")
    held = trace.stalls[trace.stalls[:, 1] > HOLDS]
    for number, (begin, length) in enumerate(held.tolist()):
        label = f"nothing comes for more than {1e3 * HOLDS:g} ms" if number == 0 else None
        axes.axvspan(begin, begin + length, color=COLOURS[1], alpha=0.25, linewidth=0.0, label=label)
    if measured.max() > STEEP * delay[delay > 0.0].min(initial=np.inf):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(bottom=0.0)
    axes.set(title=trace.name, xlabel="time of sending [s]", ylabel="delay [ms]", xlim=(0.0, trace.time[-1]))
    legend(axes, 3)
    return finished(drawing, 1)
