"""A recorded session beside its replay under other settings: figures, and the errors of each contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import Rows
from foretouch.report.numbers import number
from foretouch.report.pairs import Pairs, not_scored, pair
from foretouch.report.scores import score
from foretouch.report.session import CONTACT_FLOOR, session_report
from foretouch.session import SessionSettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.05
"""Touches that are nearer to each other than this [s] are one contact."""

SHORTEST = 0.05
"""A shorter contact [s] has no error of its own."""

_ROWS = (
    ("force in contact", "contact_force_rms_N", "N"),
    ("error of the predicted force", "prediction_error_percent", "%"),
    ("error of the felt force", "rendered_error_percent", "%"),
    ("error of the delayed force", "delayed_force_error_percent", "%"),
    ("predicted within what is noticed", "within_jnd_percent", "%"),
    ("felt within what is noticed", "rendered_within_jnd_percent", "%"),
    ("missed contact", "missed_contact_percent", "%"),
    ("predicted in free air", "phantom_force_rms_N", "N"),
    ("from first touch to within 10 %", "time_to_ten_percent_s", "s"),
    ("largest rendered force", "max_rendered_force_N", "N"),
    ("largest force at the robot", "max_follower_force_N", "N"),
    ("largest jump by a new model", "largest_update_jump_N", "N"),
    ("robot from its commands, RMS", "tracking_error.rms_mm", "mm"),
    ("samples scored", "scored_samples", ""),
)
"""What is shown of both sessions: in words, by name in the report, and the unit."""

_LEFT_OUT = ("replay",)
"""Texts that say what a session is, and are none of its settings."""


@dataclass(frozen=True)
class Contact:
    """One contact of a session, and what was known of its force.

    Attributes:
        begin: When its first command was given, in the time of the hand (`hand_begins_ns`) [s].
        end: And of its last [s].
        force_rms: Of the true force in it [N].
        predicted: RMS error of the predicted force, in percent of that.
        delayed: Of the delayed force, the same.
    """

    begin: float
    end: float
    force_rms: float
    predicted: float
    delayed: float


def compare_replay(recorded: SessionLog, replayed: SessionLog, notes: Sequence[str]) -> dict[str, Any]:
    """Both reports, and what differs.

    Args:
        recorded: The session.
        replayed: What `foretouch.session.replay.under` made of it.
        notes: What `foretouch.session.replay_notes` says of it; the first is of the operator's motion.

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
        if before.get(name, defaults.get(name)) != text and name not in _LEFT_OUT
    }
    return {
        "motion": notes[0],
        "notes": list(notes[1:]),
        "loop": after.get("replay", "open loop"),
        "settings": differ,
        "recorded": session_report(recorded),
        "replayed": session_report(replayed),
        "contacts": {
            name: [vars(contact) for contact in contacts(log)]
            for name, log in (("recorded", recorded), ("replayed", replayed))
        },
    }


def contacts(log: SessionLog) -> list[Contact]:
    """The contacts of a session at equal command, as `score` says what is one, those that are not scored left out.

    Args:
        log: The session, whose longest stretch is taken.
    """
    pairs = pair(log)
    if not pairs.time.size:
        return []
    scores = score(
        pairs.time,
        pairs.follower["sensor_force"],
        pairs.leader["predicted_force"],
        pairs.leader["delayed_force"],
        contact_floor=CONTACT_FLOOR,
        delayed_offset=0.0,
        score_from=0.0,
        position=pairs.follower["position"],
        skipped=not_scored(pairs),
    )
    time = (pairs.leader["time_ns"] - hand_begins_ns(log.longest().leader)) * 1e-9
    touched = np.asarray(scores.in_contact & ~not_scored(pairs))
    return [
        _contact(time[inside], scores.measured_force[inside], pairs, inside)
        for inside in _runs(time, touched)
        if time[inside][-1] - time[inside][0] >= SHORTEST
    ]


def hand_begins_ns(leader: Rows) -> int:
    """When the time of the hand begins, by the leader's clock [ns]: one that feels something waits for the follower.

    Args:
        leader: Rows of `SessionLog.leader`, of one process, at least 1.
    """
    waits = bool(np.isfinite(leader["exact_hand_position"]).any() and leader["engaged"].any())
    return int(leader["time_ns"][int(np.argmax(leader["engaged"])) if waits else 0])


def render_replay(content: Mapping[str, Any]) -> str:
    """Both sessions side by side, for a terminal.

    Args:
        content: What `compare_replay` gave.

    Returns:
        Lines of at most about 100 characters, without a last line break.
    """
    said = (f"replay in {_with_article(content['loop'])}", content["motion"], *content["notes"])
    lines = [f"{sentence[0].upper()}{sentence[1:]}." for sentence in said]
    lines += ["", f"{'':<34}{'recorded':>22}{'replayed':>22}{'ratio':>10}"]
    for name, before, after, ratio in table_rows(content):
        lines.append(f"  {name:<32}{before:>22}{after:>22}{ratio:>10}".rstrip())
    return "\n".join(lines)


def table_rows(content: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """What `render_replay` and the page show: name, recorded, replayed, and their ratio, as text.

    Args:
        content: What `compare_replay` gave.
    """
    before, after = content["recorded"], content["replayed"]
    always = ("position_delay", "force_delay", "model", "estimator")
    names = [*always, *(name for name in content["settings"] if name not in always)]
    rows = [
        (name.replace("_", " "), _text(before["settings"].get(name)), _text(after["settings"].get(name)), "")
        for name in names
    ]
    for words, name, unit in _ROWS:
        old, new = _figure(before, name), _figure(after, name)
        rows.append((words, _number(old, unit), _number(new, unit), _ratio(old, new)))
    if content["loop"] == "closed loop":
        rows.append(("stable", _yes(before["stable"]), _yes(after["stable"]), ""))
    return rows


def _contact(time: Array, force: Array, pairs: Pairs, inside: slice) -> Contact:
    size = float(np.sqrt(np.mean(force**2)))

    def error(kind: str) -> float:
        return 100.0 * float(np.sqrt(np.mean((pairs.leader[f"{kind}_force"][inside] - force) ** 2))) / size

    return Contact(float(time[0]), float(time[-1]), size, error("predicted"), error("delayed"))


def _runs(time: Array, touched: Flags) -> list[slice]:
    """The stretches of rows in contact; short ways out of it are in them."""
    rows = np.flatnonzero(touched)
    if not rows.size:
        return []
    cuts = np.flatnonzero(np.diff(time[rows]) > APART)
    firsts, lasts = rows[np.concatenate(([0], cuts + 1))], rows[np.concatenate((cuts, [rows.size - 1]))]
    return [slice(int(first), int(last) + 1) for first, last in zip(firsts, lasts, strict=True)]


def _figure(report: Mapping[str, Any], name: str) -> float | None:
    """A figure of a report; a dot leads into one of its objects."""
    value: Any = report
    for part in name.split("."):
        value = value[part]
    return None if value is None else float(value)


def _number(value: float | None, unit: str) -> str:
    if not unit and value is not None:
        return f"{value:,.0f}"
    return number(value, unit)


def _ratio(before: float | None, after: float | None) -> str:
    return f"x {after / before:.2f}" if before and after is not None else ""


def _text(value: str | None) -> str:
    return "-" if value is None else value or "none"


def _yes(stable: bool | None) -> str:
    return "-" if stable is None else "yes" if stable else "no"


def _with_article(loop: str) -> str:
    return f"{'a' if loop.startswith('closed') else 'an'} {loop}"
