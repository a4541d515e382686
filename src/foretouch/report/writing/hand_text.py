"""Hand and energy as plain text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from foretouch.errors import plural
from foretouch.report.hand import AS_IT_COMES, NO_BASELINE, NO_GRIP
from foretouch.report.numbers import figure, number

MUCH = 5.0
"""From this share of contact on it is said that the device could not carry the model [%]."""

MOST = 50.0
"""Above this share of contact it is said that the guard held the robot back [%]."""


def instability(report: Mapping[str, Any]) -> str:
    """Why a session was not stable, in a sentence; empty where it was, or where nobody knows.

    Args:
        report: What `session_report` gave.
    """
    if report["stable"] is not False:
        return ""
    hand = report["hand"]
    swings, reasons = hand["oscillation"], []
    if not hand["certificate_holds"] and (hand["energy_agrees"] or _is_broken(report)):
        reasons.append(_broken(report["energy_margin_J"]))
    if hand["energy_agrees"] is False:
        reasons.append("the leader's account of energy is not what its forces and positions add up to")
    if swings["oscillates"]:
        reasons.append(f"the hand oscillates{_most(swings)}: it swung {_swings(swings)}")
    if not hand["forces_finite"]:
        reasons.append("a force was not a finite number")
    return f"Unstable: {', and '.join(reasons)}."


def stability(report: Mapping[str, Any]) -> str:
    """That a session with a hand was stable, or that there was nothing to be stable about; else empty."""
    if not report["stable"] or report["hand"]["grip"] == NO_GRIP:
        return ""
    if report["hand"]["guarded_contact_percent"] is None:
        coupled = "" if report["engaged_percent"] else "hand and robot were never coupled, and "
        return f"Stable, but {coupled}nothing was touched."
    late = report["late_energy_J"]
    beside = "" if not late else f"; late ticks and missing positions gave the hand {_joules(-late)} beside it"
    return f"Stable: the account of energy kept its bound in every tick, and the hand did not oscillate{beside}."


def guard_sentence(report: Mapping[str, Any]) -> str:
    """That the guard held the robot back in most of the contact; else empty."""
    share = report["hand"]["guarded_contact_percent"]
    if share is None or not share > MOST:
        return ""
    return f"The guard held the robot back in {figure(share)} % of the contact time; none of that is scored."


def phantom_sentence(report: Mapping[str, Any]) -> str:
    """That a hand felt what was not there; else empty."""
    phantom = report["hand"]["largest_phantom_N"]
    if report["hand"]["grip"] == NO_GRIP or not phantom:
        return ""
    return f"The hand felt up to {number(phantom, 'N')} where the robot touched nothing."


def device_sentence(report: Mapping[str, Any]) -> str:
    """That the device could not carry the model, where that was so for more than a moment; else empty."""
    hand = report["hand"]
    bound = hand["device_bound_percent"]
    if hand["grip"] == NO_GRIP or bound is None or bound < MUCH:
        return ""
    least = figure(100.0 * hand["smallest_rendered_share"])
    said = f"In {figure(bound)} % of contact the device could not carry the model: "
    return f"{said}it felt softer, down to {least} % of its stiffness."


def withheld_sentence(report: Mapping[str, Any]) -> str:
    """That a hand pressed and was not given the model's force, for how long and why; else empty."""
    hand = report["hand"]
    if not hand["withheld_percent"]:
        return ""
    share, longest, begins = figure(hand["withheld_percent"]), hand["longest_withheld_s"], hand["longest_withheld_at_s"]
    return (
        f"In {share} % of contact the force was withheld: the hand was given less than half of the model's. At longest "
        f"that lasted {figure(longest)} s, from {begins:.1f} s on: {hand['withheld_because']}."
    )


def stability_word(report: Mapping[str, Any]) -> str:
    """Whether the session was stable, in a word."""
    return {True: "yes", False: "no", None: "not known"}[report["stable"]]


def baseline_sentence(report: Mapping[str, Any]) -> str:
    """What was rendered where no model was; empty where models were."""
    if report["baseline"] == NO_BASELINE:
        return ""
    part = "" if report["baseline"] == AS_IT_COMES else ", as far as a passivity controller let it"
    return f"Baseline {report['baseline']}: the delayed force was rendered{part}, for comparison."


def hand_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report that says what the hand was given.

    Args:
        report: What `session_report` gave.
    """
    hand = report["hand"]
    lines = ["Hand and energy", f"  stable     {_stable(report)}"]
    if report["net_energy_J"] is not None:
        lines.append(f"  energy     {_energy(report)}")
    peak, robot = number(hand["peak_force_hand_N"], "N"), number(hand["peak_force_robot_N"], "N")
    lines += [f"  forces     at most {peak} at the hand, {robot} at the robot", *_jumps(report)]
    if report["guarded_s"] > 0.0:
        lines.append(f"  guard      {_guard(report)}")
    if hand["grip"] != NO_GRIP:
        lines += _hand(report)
    return lines


def _swings(swings: Mapping[str, Any]) -> str:
    swung, free = (plural(swings[name], "time") for name in ("swings", "free_swings"))
    return f"{swung}, and would have swung {free} without force"


def _most(swings: Mapping[str, Any]) -> str:
    """Where the hand swung most."""
    when, burst = swings["largest_burst_at_s"], swings["largest_burst"]
    return f" ({burst} too many from {when:.1f} s on)" if when is not None and burst > 1 else ""


def _broken(margin: float | None) -> str:
    if margin is None:
        return "its energy was not a finite number"
    return f"the hand was given {_joules(-margin)} more than the energy account allows"


def _is_broken(report: Mapping[str, Any]) -> bool:
    margin = report["energy_margin_J"]
    return margin is None or margin < 0.0


def _stable(report: Mapping[str, Any]) -> str:
    swings, word = report["hand"]["oscillation"], stability_word(report)
    if report["hand"]["certificate_holds"] is None:
        return f"{word}: nobody kept an account of energy"
    if report["stable"] is None:
        return f"{word}: nobody holds what the delayed force would move"
    if report["hand"]["guarded_contact_percent"] is None and report["stable"]:
        return f"{word}; nothing was touched"
    if report["hand"]["grip"] == NO_GRIP:
        return f"{word}; in an open loop no force moves the hand"
    if swings["swings"] is None:
        return f"{word}; the session does not say what the hand intended"
    return f"{word}; the hand swung {_swings(swings)}"


def _energy(report: Mapping[str, Any]) -> str:
    if report["energy_bound_J"] == 0.0 == report["net_energy_J"]:
        return "no contact at the hand: nothing to account for"
    net, bound, exact = (report[f"{name}_J"] for name in ("net_energy", "energy_bound", "net_energy_exact"))
    without = "" if exact is None else f"; {_joules(exact)} without the encoder's rounding"
    late = report["late_energy_J"]
    beside = "" if not late else f"; late ticks and missing positions gave {_joules(-late)} beside it"
    return f"net {_joules(net)}, allowed {_joules(None if bound is None else -bound)}{without}{beside}"


def _joules(energy: float | None) -> str:
    """An energy in the unit that suits it."""
    small = energy is not None and abs(energy) < 1e-4
    return number(None if energy is None else energy * (1e6 if small else 1e3), "uJ" if small else "mJ")


def _jumps(report: Mapping[str, Any]) -> list[str]:
    """What new models did to the force at once; nothing where none were rendered."""
    if report["baseline"] != NO_BASELINE:
        return []
    jumps = []
    for name in ("largest_update_jump", "largest_rendered_update_jump"):
        size, rate = number(report[f"{name}_N"], "N"), number(report[f"{name}_N_per_s"], "N/s")
        jumps.append(f"{size} ({rate})")
    when, cut = report["largest_update_jump_at_s"], report["hand"]["largest_energy_cut_N"]
    at = "" if when is None else f" at {number(when, 's')}"
    return [
        f"  updates    a new model moved the force by at most {jumps[0]}{at}",
        f"             behind the limits {jumps[1]}, before mediation {number(report['largest_model_jump_N'], 'N')}",
        *([] if cut is None else [f"  ceiling    of energy, cut the force by at most {number(cut, 'N')} in one tick"]),
    ]


def _guard(report: Mapping[str, Any]) -> str:
    hand, count = report["hand"], report["guarded_contacts"]
    many = plural(count, "contact")
    depth, time = number(hand["depth_lost_mm"], "mm"), number(hand["time_lost_s"], "s")
    peak, all_ = number(hand["peak_force_guarded_N"], "N"), number(report["guarded_s"], "s")
    return f"{many} guarded, {all_} in all, at most {peak}; lost at most {depth} of depth and {time}"


def _hand(report: Mapping[str, Any]) -> list[str]:
    hand = report["hand"]
    away, in_air = number(hand["given_way_mm"], "mm"), number(hand["given_way_in_air_mm"], "mm")
    return [
        *_device(report),
        f"  hand       {away} RMS from where it meant to be in contact, {in_air} in the air",
        f"  proxy      at most {number(hand['largest_index_mm'], 'mm')} from the hand; coupled for "
        f"{number(report['engaged_percent'], '%')} of the time",
    ]


def _device(report: Mapping[str, Any]) -> list[str]:
    """What of the model was withheld, and what the device could not carry; nothing where none was rendered."""
    if report["baseline"] != NO_BASELINE:
        return []
    share, bound = report["hand"]["smallest_rendered_share"], number(report["hand"]["device_bound_percent"], "%")
    least = "" if share is None or share >= 1.0 else f", down to {figure(100.0 * share)} % of its stiffness"
    withheld = report["hand"]["withheld_percent"]
    longest = report["hand"]["longest_withheld_s"]
    told = "" if longest is None else f", {number(longest, 's')} at longest"
    kept = [] if withheld is None else [f"  withheld   in {number(withheld, '%')} of contact{told}"]
    return [*kept, f"  device     could not carry the model in {bound} of contact{least}"]
