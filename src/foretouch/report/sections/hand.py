"""The hand in the loop: what it was given and spared, where it was and wanted to be, as figures, text and drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from foretouch.messages import SessionLog
from foretouch.quantities import Array, Flags, Rows, new_figure
from foretouch.rendering.limits import LARGEST_FORCE, LEAST_FORCE, LEAST_SHARE, LEAST_TICKS, OWED, UNPAID
from foretouch.report.drawing import DELAYED, ERROR, PREDICTED, RENDERED, TRUE, curve, finished, legend, peak, shade
from foretouch.report.energy import booked_device, energy_figures
from foretouch.report.numbers import Finding, figure, filled, largest, number_of, renders_models, runs, setting
from foretouch.report.perception import free_hand, oscillation
from foretouch.report.rows import Pairs, away, not_scored, pair, since_first
from foretouch.report.sections import Drawing, Section, View
from foretouch.report.sections.energy import FELT
from foretouch.report.sections.safety import contact_force, guarded_figures
from foretouch.settings import NO_BASELINE, NO_GRIP

PHANTOM, PHANTOM_TICKS = 0.3, 50
"""A hand felt what the robot did not touch where the rendered force was above this [N] for more than this many commands
in a row: the edge of a contact is never quite where it was."""

MUCH = 5.0  # Part of the contact from which the report says that the device could not carry the model [%]
GUARDED_LONG = 5.0  # Part of the contact above which the report says at its top that the guard held the robot back [%]
CLOSE_UP = 4.0  # Length of the close-up [s]
WIDE = 4.0  # Width of a curve that is under another one


def hand_figures(log: SessionLog, pairs: Pairs | None = None) -> dict[str, Any]:
    """Stability, energy and the hand, as `session_report` puts them among its own.

    A session is stable if

    1. the certificate of energy holds in every tick (`energy_figures`),
    2. every rendered and every contact force is a finite number, and
    3. the hand does not oscillate (`oscillation`), compared with what it would do without any force (`free_hand`);
       where it is not known what the hand means to do, as in an open loop, this is not asked.

    A baseline renders no model: the force that a device could not carry and that the energy ceiling cut are None there.
    The log is one segment of a session (`SessionLog.segments`); without its rows at equal command they are paired here.

    Returns:
        ``stable`` (None where no account of energy was kept, as in old recordings, and for a baseline in an open
        loop, where no hand can be unstable), the figures of the energy, ``guarded_contacts``,
        ``guarded_s``, ``engaged_percent`` and the object ``hand``.
    """
    leader, models = log.leader, renders_models(log.settings)
    grip = setting(log.settings, "grip", NO_GRIP)
    energy = energy_figures(leader, booked_device(log.settings))
    guarded, swings = guarded_figures(log), oscillation(leader, free_hand(log))
    finite, holds = _finite(log), energy.pop("certificate_holds")
    own = {name: energy.pop(name) for name in ("energy_agrees", "largest_energy_cut_N")}
    if not models:
        own["largest_energy_cut_N"] = None
    unasked = holds is None or (grip == NO_GRIP and not models)
    return {
        "stable": None if unasked else bool(holds and finite and not swings["oscillates"]),
        **energy,
        "guarded_contacts": guarded.pop("guarded_contacts"),
        "guarded_s": guarded.pop("guarded_s"),
        "engaged_percent": 100.0 * float(leader["engaged"].mean()) if leader.size else None,
        "hand": {
            "grip": grip,
            "certificate_holds": holds,
            **own,
            "forces_finite": finite,
            "peak_force_hand_N": largest(leader["rendered_force"]),
            "peak_force_robot_N": largest(contact_force(log)),
            "peak_force_guarded_N": largest(contact_force(log)[log.follower["guarded"]]),
            **guarded,
            "largest_index_mm": _in_mm(largest(np.abs(apart(log)))),
            "largest_phantom_N": _largest_phantom(pair(log) if pairs is None else pairs),
            **_device_bound(log),
            **_given_way(leader),
            **_withheld(log),
            "oscillation": swings,
        },
    }


def apart(log: SessionLog) -> Array:
    r"""Distance by which the proxy has been taken back from the hand, in the follower's lengths [m], shape (n,).

    .. math:: i_k - i_0, \quad i = p\,x - y

    with the position scale p, the hand x and the proxy y; the reference i_0 is where hand and proxy were coupled, anew
    each time that the clutch is let go. It holds what was indexed away at first touch, and what yielded because the
    device could not carry the model. NaN where they are not coupled.
    """
    leader = log.leader
    scale = number_of(log.settings, "position_scale", 1.0)
    between = scale * leader["hand_position"] - leader["position"]
    coupled = leader["engaged"] & np.isfinite(between)
    begins = coupled & ~np.concatenate((np.zeros(min(1, coupled.size), dtype=np.bool_), coupled[:-1]))
    newest = np.maximum.accumulate(np.where(begins, np.arange(coupled.size), 0))
    return np.where(coupled, between - between[newest], np.nan)


def _finite(log: SessionLog) -> bool:
    """Whether all forces are numbers: those for the hand and, where they are known, those at the probe."""
    exact = log.follower["exact_force"]
    wrong = np.isinf(exact) | (np.isnan(exact) & ~np.isnan(exact).all())  # on a robot it is known nowhere
    return bool(np.isfinite(log.leader["rendered_force"]).all() and not wrong.any())


def _largest_phantom(pairs: Pairs) -> float | None:
    """The largest force that the hand felt for a while where the robot touched nothing, at equal command [N]."""
    leader, follower = pairs.leader, pairs.follower
    felt = leader["rendered_force"]
    wrong = ~follower["in_contact"] & ~not_scored(pairs) & (felt > PHANTOM)
    long = (felt[begin:end].max() for begin, end in runs(wrong) if end - begin > PHANTOM_TICKS)
    return float(max(long, default=0.0)) if felt.size else None


def _device_bound(log: SessionLog) -> dict[str, float | None]:
    """Part of the contact by the model that the device could not carry in full, and the least fraction it carried."""
    leader, force_scale = log.leader, number_of(log.settings, "force_scale", 1.0)
    rendered = leader["rendered_share"][leader["engaged"] & (force_scale * leader["predicted_force"] > FELT)]
    if not rendered.size or not renders_models(log.settings):
        return {"device_bound_percent": None, "smallest_rendered_share": None}
    return {
        "device_bound_percent": 100.0 * float(np.mean(rendered < 1.0)),
        "smallest_rendered_share": float(rendered.min()),
    }


def _withheld(log: SessionLog) -> dict[str, Any]:
    """Time in which the hand was not given the model's force; nothing where no hand felt one."""
    felt = setting(log.settings, "grip", NO_GRIP) != NO_GRIP or log.settings.get("felt") == "yes"
    if not felt or not renders_models(log.settings):
        return dict.fromkeys(WITHHELD)
    return withheld_figures(log.leader, number_of(log.settings, "force_scale", 1.0))


def _given_way(leader: Rows) -> dict[str, float | None]:
    """Distance of the hand from its intended position, RMS: in contact by the force, in the air by its own lag."""
    away = leader["intended_position"] - leader["exact_hand_position"]
    known, felt = np.isfinite(away), leader["rendered_force"] > FELT
    return {"given_way_mm": _in_mm(_rms(away[known & felt])), "given_way_in_air_mm": _in_mm(_rms(away[known & ~felt]))}


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _in_mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length


WITHHELD = ("withheld_percent", "longest_withheld_s", "longest_withheld_at_s", "withheld_because")


def withheld_figures(leader: Rows, force_scale: float) -> dict[str, Any]:
    """The ticks in which force was withheld: see `foretouch.rendering.limits.Withheld`.

    Only ticks count in which hand and robot are coupled, the hand is seen and the model gives 0.5 N or more. Of these,
    segments of 500 and more in a row with less than half of the model's force are withheld; a segment may go over
    several presses. The force scale is the hand's force for the model's.

    Returns:
        ``withheld_percent``: their fraction of the ticks that count. ``longest_withheld_s``: from the first to the last
        tick of the longest segment, and ``longest_withheld_at_s``: when it began after the first tick; None where there
        is none. ``withheld_because``: why, in most of that segment. All None where no tick counts.
    """
    due = np.minimum(force_scale * leader["predicted_force"], LARGEST_FORCE)
    counted = leader["engaged"] & np.isfinite(leader["hand_position"]) & (due >= LEAST_FORCE)
    rows = leader[counted]
    if not rows.size:
        return dict.fromkeys(WITHHELD)
    withheld = runs(rows["rendered_force"] < LEAST_SHARE * due[counted])
    segments = [(begin, end) for begin, end in withheld if end - begin >= LEAST_TICKS]
    if not segments:
        return dict(zip(WITHHELD, (0.0, None, None, None), strict=True))
    time = rows["time_ns"] * 1e-9
    begin, end = max(segments, key=lambda segment: float(time[segment[1] - 1] - time[segment[0]]))
    percent = 100.0 * sum(end - begin for begin, end in segments) / rows.size
    owed = float(np.mean(rows["energy"][begin:end] < 0.0)) > 0.5
    return {
        "withheld_percent": percent,
        "longest_withheld_s": float(time[end - 1] - time[begin]),
        "longest_withheld_at_s": float(time[begin]) - float(leader["time_ns"][0]) * 1e-9,
        "withheld_because": OWED if owed else UNPAID,
    }


def _findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    """What was withheld, that the guard held the robot back, what was not there, and what the device could not carry.

    Only what was so for more than a moment.
    """
    hand = report["hand"]
    if hand["withheld_percent"]:
        yield Finding(filled(_WITHHELD, hand))
    if (hand["guarded_contact_percent"] or 0.0) > GUARDED_LONG:
        yield Finding(filled(_GUARDED, hand))
    if hand["grip"] == NO_GRIP:
        return
    if hand["largest_phantom_N"]:
        yield Finding(filled("The hand felt up to {largest_phantom_N:N} where the robot touched nothing.", hand))
    if (hand["device_bound_percent"] or 0.0) >= MUCH:
        yield Finding(f"{filled(_SOFTER, hand)}{_least_share(hand)}.")


_SOFTER = "In {device_bound_percent:%} of contact the device could not carry the model: it felt softer"
_WITHHELD = (
    "In {withheld_percent:%} of contact the force was withheld: the hand was given less than half of the model's. At "
    "longest that lasted {longest_withheld_s:s}, from {longest_withheld_at_s:.1f} s on: {withheld_because}."
)
_GUARDED = (
    "The guard held the robot back in {guarded_contact_percent:%} of the contact time: the hand felt nothing then, and "
    "none of it is scored."
)


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    """The block on the forces rendered to the hand, then on its energy."""
    hand, models = report["hand"], report["baseline"] == NO_BASELINE
    yield filled("  forces     at most {peak_force_hand_N:N} at the hand, {peak_force_robot_N:N} at the robot", hand)
    if models:
        jump = "{largest_update_jump_N:N} ({largest_update_jump_N_per_s:N/s})"
        jump += "" if report["largest_update_jump_at_s"] is None else " at {largest_update_jump_at_s:s}"
        yield filled(f"  updates    a new model moved the force by at most {jump}", report)
        yield filled(_BEHIND, report)
        if hand["largest_energy_cut_N"] is not None:
            yield filled("  ceiling    of energy, cut the force by at most {largest_energy_cut_N:N} in one tick", hand)
    if report["guarded_s"] > 0.0:
        yield filled(_GUARD, report)
    if hand["grip"] != NO_GRIP:
        if models and hand["withheld_percent"] is not None:
            longest = "" if hand["longest_withheld_s"] is None else ", {longest_withheld_s:s} at longest"
            yield filled(f"  withheld   in {{withheld_percent:%}} of contact{longest}", hand)
        if models:
            ratio = hand["smallest_rendered_share"]
            least = "" if ratio is None or ratio >= 1.0 else _least_share(hand)
            yield filled("  device     could not carry the model in {device_bound_percent:%} of contact", hand) + least
        yield from (filled(line, report) for line in _HELD)
    yield ""


_HELD = (
    "  hand       {hand.given_way_mm:mm} RMS from where it meant to be in contact, "
    "{hand.given_way_in_air_mm:mm} in the air",
    "  proxy      at most {hand.largest_index_mm:mm} from the hand; coupled for {engaged_percent:%} of the time",
)
_BEHIND = (
    "             behind the limits {largest_rendered_update_jump_N:N} ({largest_rendered_update_jump_N_per_s:N/s}), "
    "before mediation {largest_model_jump_N:N}"
)
_GUARD = (
    "  guard      {guarded_contacts:#contact} guarded, {guarded_s:s} in all, at most {hand.peak_force_guarded_N:N}; "
    "lost at most {hand.depth_lost_mm:mm} of depth and {hand.time_lost_s:s}"
)


def _least_share(hand: Mapping[str, Any]) -> str:
    return f", down to {figure(100.0 * hand['smallest_rendered_share'])} % of its stiffness"


def _drawings(view: View) -> Iterator[Drawing]:
    hand = view.report["hand"]
    if hand["grip"] != NO_GRIP and view.log.leader.size:
        swings = hand["oscillation"]
        drawn = hand_figure(view.log, view.pairs, swings["largest_burst_at_s"] if swings["oscillates"] else None)
        yield Drawing(drawn, "The hand: what it meant, what it did, and what it was given")


def hand_figure(log: SessionLog, pairs: Pairs, burst_at: float | None = None) -> Any:
    """Intended and actual position of the hand, the proxy, and the force; the close-up shows an oscillation."""
    leader = log.leader
    time = since_first(leader)
    figure = new_figure(9.5)
    whole, near, force = figure.subplots(3, 1)
    hand = leader["exact_hand_position"]
    hand = np.where(np.isfinite(hand), hand, leader["hand_position"])
    proxy = hand - apart(log) / number_of(log.settings, "position_scale", 1.0)
    held = np.isin(leader["sequence"], pairs.leader["sequence"][pairs.follower["guarded"]])
    elsewhere = _heard_away(log)
    curves = (
        ("meant", leader["intended_position"], ERROR, 1.4),
        ("hand", hand, TRUE, WIDE),  # under the proxy, which is mostly where the hand is
        ("proxy: commanded position of the robot", proxy, PREDICTED, 1.2),
    )
    inside = _close_up(time, leader["rendered_force"], burst_at)
    for axes, chosen in ((whole, np.ones(time.size, dtype=np.bool_)), (near, inside), (force, inside)):
        shade(axes, time[chosen], held[chosen], DELAYED, "robot held back by the guard")
        shade(axes, time[chosen], ~leader["engaged"][chosen], "0.5", "not coupled")
        shade(axes, time[chosen], elsewhere[chosen], "#CC79A7", "robot reported as not following")
        if axes is not force:
            for label, values, colour, width in curves:
                alpha = 0.45 if width == WIDE else 1.0
                curve(axes, time[chosen], 1e3 * values[chosen], colour, width, alpha=alpha, label=label)
            axes.set(ylabel="position [mm]", xlabel="time [s]")
    whole.axvspan(time[inside][0], time[inside][-1], color="#56B4E9", alpha=0.15, linewidth=0.0, label="close-up below")
    whole.set_title("The hand")
    legend(whole, columns=6 if not elsewhere.any() else 4)
    near.set_title("Close-up")
    given = leader["rendered_force"][inside]
    rendered = "rendered: what the hand was given"
    curve(force, time[inside], given, RENDERED, WIDE, alpha=0.45, label=rendered)
    asked = leader["mediated_force"][inside]
    curve(force, time[inside], asked, PREDICTED, 1.1, label="asked for, before the limits")
    top = 1.1 * max(peak(given), peak(asked), 0.1)
    force.set_ylim(-0.05 * top, top)
    force.set(title="Force in the close-up", ylabel="force [N]", xlabel="time [s]")
    legend(force, columns=4)
    for axes in (near, force):
        axes.set_xlim(time[inside][0], time[inside][-1])
    return finished(figure, 3, above=0.8 if elsewhere.any() else 0.6, gap=1.1)


def _heard_away(log: SessionLog) -> Flags:
    """Ticks of the leader at which its newest state of the robot was that it does not follow commands."""
    leader, follower = log.leader, log.follower
    if not follower.size:
        return np.zeros(leader.size, dtype=np.bool_)
    newest = np.searchsorted(follower["sequence"], leader["telemetry_sequence"], side="right") - 1
    return np.asarray((newest >= 0) & (away(follower) & (follower["command_sequence"] > 0))[newest])


def _close_up(time: Array, force: Array, burst_at: float | None) -> Flags:
    """From shortly before an oscillation on, or else before the first contact: there models and hand meet."""
    felt = time[force > FELT]
    first = felt[0] if felt.size else time[0]
    begin = max((first if burst_at is None else burst_at) - 0.2 * CLOSE_UP, time[0])
    return np.asarray((time >= begin) & (time <= begin + CLOSE_UP))


HAND = Section("hand", _findings, _lines, _drawings)
