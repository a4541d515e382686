"""The page and the figure of a replay: both sessions over one another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.force_calibration import lowest_mean
from foretouch.messages import SessionLog
from foretouch.quantities import new_figure
from foretouch.report.pairs import pair
from foretouch.report.replay import hand_begins_ns, table_rows
from foretouch.report.writing.drawing import DELAYED, ERROR, PREDICTED, TRUE, finished, legend
from foretouch.report.writing.html import embedded, table, write_html
from foretouch.report.writing.thinning import thinned

Array = NDArray[np.float64]

RECORDED_PREDICTION = "#56B4E9"
"""Beside the colours of a session: the lighter of two blues, of Okabe and Ito too."""

ZOOM = 4.0
"""Length of the close-up [s]."""

LEAST = 0.3
"""The force axes show at least so much [N]."""

LEAST_ERROR = 0.3
"""Smallest error that the axis shows [%]."""

ERROR_TICKS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""[%]."""

ROOM = 1.25
"""The force axes reach to this multiple of the largest true or delayed force."""


def write_replay_page(
    directory: str | PathLike[str],
    name: str,
    recorded: SessionLog,
    replayed: SessionLog,
    content: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
) -> Path:
    """Write a recorded session and its replay, over one another, as ``index.html``.

    Args:
        directory: Made if it is not there.
        name: Of the recording, for the heading.
        recorded: The session.
        replayed: Its replay.
        content: What `compare_replay` gave of them.
        made: What made it, for the end of the page, as `write_html` takes it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    body = [
        f"<h1>Replay of {escape(name)}</h1>",
        f'<p class="quiet">{escape(_sentence(content["loop"]))} Status: {escape(content["replayed"]["status"])}.</p>',
        f'<p class="bad">{escape(_sentence(content["motion"]))}</p>',
        *(f"<p>{escape(_sentence(note))}</p>" for note in content["notes"]),
        embedded(
            replay_figure(recorded, replayed, content["contacts"]),
            "Forces of both sessions over the time in which the hand moved, and the errors of each contact",
        ),
        "<h2>Side by side</h2>",
        table(("", "recorded", "replayed", "ratio"), table_rows(content)),
        "<h2>Settings of the replay</h2>",
        table(("", "recorded", "replayed"), _settings(content)),
    ]
    return write_html(directory, f"Replay of {name}", body, made)


def replay_figure(recorded: SessionLog, replayed: SessionLog, contacts: Mapping[str, Any]) -> Any:
    """Forces of both sessions at the time of the hand, a close-up, and the errors of each contact.

    Args:
        recorded: The session.
        replayed: Its replay.
        contacts: Of each, by ``recorded`` and ``replayed``, as `compare_replay` gives them.
    """
    figure = new_figure(9.5)
    whole, near, errors = figure.subplots(3, 1)
    before, after = _forces(recorded), _forces(replayed)
    begin, end = _close_up(before["time"], before["true"])
    for axes, inside in ((whole, (-math.inf, math.inf)), (near, (begin, end))):
        near_by = [_within(columns, *inside) for columns in (before, after)]
        _draw_forces(axes, *near_by)
        top = ROOM * max(LEAST, *(_largest(columns[kind]) for columns in near_by for kind in ("true", "delayed")))
        axes.set_ylim(-0.08 * top, top)
        axes.set_ylabel("force [N]")
        axes.set_xlabel("time of the hand [s]")
    whole.set_title("Contact force at equal command, over the time in which the hand moved")
    whole.axvspan(begin, end, color="0.5", alpha=0.15, linewidth=0.0, label="close-up below")
    near.set_title("Close-up")
    legend(whole, columns=4)
    _draw_errors(errors, contacts)
    for axes in (whole, errors):
        last = max((float(one["time"][-1]) for one in (before, after) if one["time"].size), default=1.0)
        axes.set_xlim(0.0, last)
    return finished(figure, 3, above=0.8, gap=1.1)


def _forces(log: SessionLog) -> dict[str, Array]:
    """Columns at equal command: the time of the hand, and the forces."""
    pairs = pair(log)
    felt = pairs.follower["sensor_force"]
    return {
        "time": (pairs.leader["time_ns"] - hand_begins_ns(log.longest().leader)) * 1e-9,
        "true": felt - lowest_mean(pairs.time, felt) if felt.size else felt,
        "predicted": pairs.leader["predicted_force"],
        "delayed": pairs.leader["delayed_force"],
    }


def _within(columns: dict[str, Array], begin: float, end: float) -> dict[str, Array]:
    inside = (columns["time"] >= begin) & (columns["time"] <= end)
    return {kind: column[inside] for kind, column in columns.items()}


def _draw_forces(axes: Any, before: dict[str, Array], after: dict[str, Array]) -> None:
    for label, columns, kind, colour, width, style in (
        ("true, recorded", before, "true", TRUE, 1.8, "-"),
        ("true, replayed", after, "true", "0.55", 1.1, "--"),
        ("delayed, recorded", before, "delayed", DELAYED, 1.0, "-"),
        ("delayed, replayed", after, "delayed", ERROR, 1.0, "-"),
        ("predicted, recorded", before, "predicted", RECORDED_PREDICTION, 1.6, "-"),
        ("predicted, replayed", after, "predicted", PREDICTED, 1.0, "-"),
    ):
        if columns["time"].size:
            curve = thinned(columns["time"], columns[kind])
            axes.plot(*curve, color=colour, linewidth=width, linestyle=style, label=label)


def _draw_errors(axes: Any, contacts: Mapping[str, Any]) -> None:
    for label, session, kind, colour, sign in (
        ("delayed, recorded", "recorded", "delayed", DELAYED, "s"),
        ("delayed, replayed", "replayed", "delayed", ERROR, "D"),
        ("predicted, recorded", "recorded", "predicted", RECORDED_PREDICTION, "o"),
        ("predicted, replayed", "replayed", "predicted", PREDICTED, "^"),
    ):
        found = contacts[session]
        middle = [0.5 * (one["begin"] + one["end"]) for one in found]
        sizes = np.maximum([one[kind] for one in found], LEAST_ERROR)
        axes.plot(middle, sizes, sign, color=colour, markersize=6.0, label=label)
    axes.set_yscale("log")
    axes.set_title("Error of each contact, in percent of the force in it")
    axes.set_ylabel("error [%]")
    axes.set_xlabel("time of the hand [s]")
    drawn = axes.get_ylim()
    axes.set_yticks([tick for tick in ERROR_TICKS if drawn[0] <= tick <= drawn[1]])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    legend(axes, columns=4)


def _close_up(time: Array, force: Array) -> tuple[float, float]:
    """The last `ZOOM` seconds that end with some contact."""
    if not time.size:
        return 0.0, ZOOM
    touched = np.flatnonzero(force > 0.2 * _largest(force))
    end = float(time[touched[-1]] if touched.size else time[-1])
    begin = max(end - ZOOM, float(time[0]))
    return begin, begin + 1.1 * ZOOM


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def _settings(content: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    before = content["recorded"]["settings"]
    return [(name, before.get(name), text) for name, text in content["replayed"]["settings"].items()]


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
