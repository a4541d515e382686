"""A recorded session beside its replay under other settings: figures, errors of each contact, and their page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.identification.force_calibration import lowest_mean
from foretouch.messages import SessionLog
from foretouch.quantities import Array, Flags, Rows, new_figure
from foretouch.report.drawing import DELAYED, ERROR, PREDICTED, TRUE, curve, finished, last_contact, legend, peak
from foretouch.report.numbers import number, sentence, value_of
from foretouch.report.rows import Pairs, not_scored, pair
from foretouch.report.sections.session import scored
from foretouch.report.session import CONTACT_FLOOR, session_figures
from foretouch.report.writing.pages import embedded, table, write_html
from foretouch.session import SessionSettings

APART = 0.05  # Touches that are nearer to each other than this [s] are one contact
SHORTEST = 0.05  # Shortest contact [s] for which an error is given

_ROWS = (
    ("force in contact", "contact_force_rms_N", "N"),
    ("error of the predicted force", "prediction_error_percent", "%"),
    ("error of the felt force", "rendered_error_percent", "%"),
    ("error of the delayed force", "delayed_force_error_percent", "%"),
    ("predicted within what is noticed", "within_jnd_percent", "%"),
    ("felt within what is noticed", "rendered_within_jnd_percent", "%"),
    ("missed contact", "missed_contact_percent", "%"),
    ("predicted in free air", "phantom_force_rms_N", "N"),
    ("from first scored contact to within 10 %", "time_to_ten_percent_s", "s"),
    ("largest rendered force", "max_rendered_force_N", "N"),
    ("largest force at the robot", "max_follower_force_N", "N"),
    ("largest jump by a new model", "largest_update_jump_N", "N"),
    ("robot from its commands, RMS", "tracking_error.rms_mm", "mm"),
    ("samples scored", "scored_samples", ""),
)
"""Figures of both sessions: in words, by name in the report, and the unit."""

RECORDED_PREDICTION = "#56B4E9"
"""Beside the colours of a session: the lighter of two blues, of Okabe and Ito too."""

ZOOM = 4.0  # Length of the close-up [s]
LEAST = 0.3  # The force axes reach at least to this [N]
LEAST_ERROR = 0.3  # Smallest error that the axis shows [%]
ERROR_TICKS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)  # [%]
ROOM = 1.25  # The force axes reach to this multiple of the largest true or delayed force


@dataclass(frozen=True)
class Contact:
    """One contact of a session, and the errors of its forces.

    Attributes:
        begin: Time of its first command by the hand's time (`hand_begins_ns`) [s].
        end: Time of its last command [s].
        force_rms: RMS of the true force in it [N].
        predicted: RMS error of the predicted force, in percent of that.
        delayed: RMS error of the delayed force, in percent of that.
    """

    begin: float
    end: float
    force_rms: float
    predicted: float
    delayed: float


def compare_replay(recorded: SessionLog, replayed: SessionLog, notes: Sequence[str]) -> dict[str, Any]:
    """Both reports, and what differs, from `foretouch.session.replay.under` and `foretouch.session.replay_notes`.

    Returns:
        ``motion`` and ``notes``, the sentences; ``loop``, "open loop" or "closed loop"; ``settings``, those that
        differ, as text, each with ``recorded`` (None where the recording does not say it) and ``replayed``;
        ``recorded`` and ``replayed``, the reports; ``contacts`` of each, as lists of the fields of `Contact`.
    """
    before, after = recorded.longest().settings, replayed.settings
    defaults = SessionSettings().as_text()  # what the recording does not say is none of the changes if it has these
    differ = {
        name: {"recorded": before.get(name), "replayed": text}
        for name, text in after.items()
        if before.get(name, defaults.get(name)) != text and name != "replay"  # which is none of them
    }
    return {
        "motion": notes[0],
        "notes": list(notes[1:]),
        "loop": after.get("replay", "open loop"),
        "settings": differ,
        "recorded": session_figures(recorded),
        "replayed": session_figures(replayed),
        "contacts": {
            name: [vars(contact) for contact in contacts(log)]
            for name, log in (("recorded", recorded), ("replayed", replayed))
        },
    }


def contacts(log: SessionLog) -> list[Contact]:
    """Contacts of the longest segment at equal command, as `score_prediction` finds them; only what is scored."""
    pairs = pair(log)
    if not pairs.time.size:
        return []
    scores = scored(pairs, pairs.leader["predicted_force"], contact_floor=CONTACT_FLOOR, score_from=0.0)
    time = (pairs.leader["time_ns"] - hand_begins_ns(log.longest().leader)) * 1e-9
    touched = np.asarray(scores.in_contact & ~not_scored(pairs))
    return [
        _contact(time[inside], scores.measured_force[inside], pairs, inside)
        for inside in _runs(time, touched)
        if time[inside][-1] - time[inside][0] >= SHORTEST
    ]


def hand_begins_ns(leader: Rows) -> int:
    """Begin of the hand's time, by the leader's clock [ns]: one that feels something waits for the follower."""
    waits = bool(np.isfinite(leader["exact_hand_position"]).any() and leader["engaged"].any())
    return int(leader["time_ns"][int(np.argmax(leader["engaged"])) if waits else 0])


def render_replay(content: Mapping[str, Any]) -> str:
    """Both sessions (`compare_replay`) side by side: lines of about 100 characters, without a last line break."""
    article = "a" if content["loop"].startswith("closed") else "an"
    texts = (f"replay in {article} {content['loop']}", content["motion"], *content["notes"])
    lines = [sentence(text) for text in texts]
    lines += ["", f"{'':<34}{'recorded':>22}{'replayed':>22}{'ratio':>10}"]
    for name, before, after, ratio in table_rows(content):
        lines.append(f"  {name:<32}{before:>22}{after:>22}{ratio:>10}".rstrip())
    return "\n".join(lines)


def table_rows(content: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of `render_replay` and the page: name, recorded, replayed, and their ratio, as text."""
    before, after = content["recorded"], content["replayed"]
    always = ("position_delay", "force_delay", "model", "estimator")
    names = [*always, *(name for name in content["settings"] if name not in always)]
    rows = [
        (name.replace("_", " "), _text(before["settings"].get(name)), _text(after["settings"].get(name)), "")
        for name in names
    ]
    for words, name, unit in _ROWS:
        old, new = value_of(before, name), value_of(after, name)
        rows.append((words, _number(old, unit), _number(new, unit), _ratio(old, new)))
    if content["loop"] == "closed loop":
        word = {True: "yes", False: "no", None: "-"}
        rows.append(("stable", word[before["stable"]], word[after["stable"]], ""))
    return rows


def _contact(time: Array, force: Array, pairs: Pairs, inside: slice) -> Contact:
    size = float(np.sqrt(np.mean(force**2)))

    def error(kind: str) -> float:
        return 100.0 * float(np.sqrt(np.mean((pairs.leader[f"{kind}_force"][inside] - force) ** 2))) / size

    return Contact(float(time[0]), float(time[-1]), size, error("predicted"), error("delayed"))


def _runs(time: Array, touched: Flags) -> list[slice]:
    """The segments of rows in contact; short gaps are in them."""
    rows = np.flatnonzero(touched)
    if not rows.size:
        return []
    cuts = np.flatnonzero(np.diff(time[rows]) > APART)
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(rows, cuts + 1)]


def _number(value: float | None, unit: str) -> str:
    if not unit and value is not None:
        return f"{value:,.0f}"
    return number(value, unit)


def _ratio(before: float | None, after: float | None) -> str:
    return f"x {after / before:.2f}" if before and after is not None else ""


def _text(value: str | None) -> str:
    return "-" if value is None else value or "none"


def write_replay_page(
    directory: str | PathLike[str],
    name: str,
    recorded: SessionLog,
    replayed: SessionLog,
    content: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
) -> Path:
    """Write a recorded session of this name and its replay, over one another, as `foretouch.report.write_page`.

    The content is that of `compare_replay`.
    """
    before, after = (content[of]["settings"] for of in ("recorded", "replayed"))
    body = [
        f"<h1>Replay of {escape(name)}</h1>",
        f'<p class="quiet">{escape(sentence(content["loop"]))} Status: {escape(content["replayed"]["status"])}.</p>',
        f'<p class="bad">{escape(sentence(content["motion"]))}</p>',
        *(f"<p>{escape(sentence(note))}</p>" for note in content["notes"]),
        embedded(
            replay_figure(recorded, replayed, content["contacts"]),
            "Forces of both sessions over the time in which the hand moved, and the errors of each contact",
        ),
        "<h2>Side by side</h2>",
        table(("", "recorded", "replayed", "ratio"), table_rows(content)),
        "<h2>Settings of the replay</h2>",
        table(("", "recorded", "replayed"), [(name, before.get(name), text) for name, text in after.items()]),
    ]
    return write_html(directory, f"Replay of {name}", body, made)


def replay_figure(recorded: SessionLog, replayed: SessionLog, contacts: Mapping[str, Any]) -> Any:
    """Forces of both sessions at the time of the hand, a close-up, and the errors of each contact.

    The contacts are by ``recorded`` and ``replayed``, as `compare_replay` gives them.
    """
    figure = new_figure(9.5)
    whole, near, errors = figure.subplots(3, 1)
    before, after = _forces(recorded), _forces(replayed)
    begin, end = last_contact(before["time"], before["true"], ZOOM) if before["time"].size else (0.0, ZOOM)
    for axes, inside in ((whole, (-math.inf, math.inf)), (near, (begin, end))):
        near_by = [_within(columns, *inside) for columns in (before, after)]
        _draw_forces(axes, *near_by)
        top = ROOM * max(LEAST, *(peak(columns[kind]) for columns in near_by for kind in ("true", "delayed")))
        axes.set_ylim(-0.08 * top, top)
        axes.set(ylabel="force [N]", xlabel="time of the hand [s]")
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
            curve(axes, columns["time"], columns[kind], colour, width, linestyle=style, label=label)


def _draw_errors(axes: Any, contacts: Mapping[str, Any]) -> None:
    for label, session, kind, colour, sign in (
        ("delayed, recorded", "recorded", "delayed", DELAYED, "s"),
        ("delayed, replayed", "replayed", "delayed", ERROR, "D"),
        ("predicted, recorded", "recorded", "predicted", RECORDED_PREDICTION, "o"),
        ("predicted, replayed", "replayed", "predicted", PREDICTED, "^"),
    ):
        wrong = contacts[session]
        middle = [0.5 * (one["begin"] + one["end"]) for one in wrong]
        sizes = np.maximum([one[kind] for one in wrong], LEAST_ERROR)
        axes.plot(middle, sizes, sign, color=colour, markersize=6.0, label=label)
    axes.set_yscale("log")
    axes.set(
        title="Error of each contact, in percent of the force in it", ylabel="error [%]", xlabel="time of the hand [s]"
    )
    drawn = axes.get_ylim()
    axes.set_yticks([tick for tick in ERROR_TICKS if drawn[0] <= tick <= drawn[1]])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    legend(axes, columns=4)
