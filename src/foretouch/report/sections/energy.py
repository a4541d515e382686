"""Whether a session was stable, and its account of energy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from foretouch.errors import plural
from foretouch.quantities import Rows, new_figure
from foretouch.report.drawing import ERROR, NARROW, PREDICTED, TRUE, curve, extremes, finished, legend, peak, shade
from foretouch.report.energy import ROUNDING, Account
from foretouch.report.numbers import Finding, number
from foretouch.report.rows import since_first
from foretouch.report.sections import Drawing, Section, View
from foretouch.settings import NO_GRIP

FELT = 0.05  # Rendered force from which on a tick counts as contact at the hand [N]


def _instability(report: Mapping[str, Any]) -> str:
    hand, margin = report["hand"], report["energy_margin_J"]
    swings, reasons = hand["oscillation"], []
    if not hand["certificate_holds"] and (hand["energy_agrees"] or margin is None or margin < 0.0):
        given = "" if margin is None else f"the hand was given {_joules(-margin)} more than the energy account allows"
        reasons.append(given or "its energy was not a finite number")
    if hand["energy_agrees"] is False:
        reasons.append("the leader's account of energy is not what its forces and positions add up to")
    if swings["oscillates"]:
        when, burst = swings["largest_burst_at_s"], swings["largest_burst"]
        most = f" ({burst} too many from {when:.1f} s on)" if when is not None and burst > 1 else ""
        reasons.append(f"the hand oscillates{most}: it swung {_swings(swings)}")
    if not hand["forces_finite"]:
        reasons.append("a force was not a finite number")
    return f"Unstable: {', and '.join(reasons)}."


def _stability(report: Mapping[str, Any]) -> str:
    if report["hand"]["guarded_contact_percent"] is None:
        coupled = "" if report["engaged_percent"] else "hand and robot were never coupled, and "
        return f"Stable, but {coupled}nothing was touched."
    late = report["late_energy_J"]
    beside = "" if not late else f"; late ticks and missing positions gave the hand {_joules(-late)} beside it"
    return f"Stable: the account of energy kept its bound in every tick, and the hand did not oscillate{beside}."


def stability_word(report: Mapping[str, Any]) -> str:
    """Whether the session was stable, in a word."""
    return {True: "yes", False: "no", None: "not known"}[report["stable"]]


def energy_lines(report: Mapping[str, Any]) -> Iterator[str]:
    """The beginning of the block about hand and energy."""
    yield "Hand and energy"
    yield f"  stable     {_stable(report)}"
    if report["net_energy_J"] is not None:
        yield f"  energy     {_energy(report)}"


def _swings(swings: Mapping[str, Any]) -> str:
    swung, free = (plural(swings[name], "time") for name in ("swings", "free_swings"))
    return f"{swung}, and would have swung {free} without force"


def _stable(report: Mapping[str, Any]) -> str:
    swings, word = report["hand"]["oscillation"], stability_word(report)
    if report["hand"]["certificate_holds"] is None:
        return f"{word}: no account of energy was kept"
    if report["stable"] is None:
        return f"{word}: no hand holds the device that the delayed force would move"
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
    small = energy is not None and abs(energy) < 1e-4
    return number(None if energy is None else energy * (1e6 if small else 1e3), "uJ" if small else "mJ")


def _findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    if report["stable"] is False:
        yield Finding(_instability(report))
    elif report["stable"] and report["hand"]["grip"] != NO_GRIP:
        yield Finding(_stability(report), good=True)


def _drawings(view: View) -> Iterator[Drawing]:
    if (view.log.leader["energy_bound"] > 0.0).any():
        yield Drawing(energy_figure(*view.found.booked()), "Energy account of the session, and its bound")


def energy_figure(leader: Rows, account: Account) -> Any:
    """The energy account of all contacts, and the same near its bound, which it may not cross."""
    figure = new_figure(6.4)
    whole, near = figure.subplots(2, 1, sharex=True)
    time = since_first(leader)
    energy, bound = 1e3 * account.energy, 1e3 * account.bound
    shade(whole, time, leader["rendered_force"] > FELT, "0.5", "in contact")
    for axes in (whole, near):
        curve(axes, time, energy, PREDICTED, 1.0, label="energy that the hand has put in")
        axes.set_ylabel("energy [mJ]")
    whole.set_title("Energy account: debts are kept, surplus is forgiven after each contact")
    legend(whole, columns=2)
    curve(near, time, -bound, ERROR, 1.0, label="its bound: a tick, the delay, an encoder count")
    deepest = peak(bound) or max(peak(-energy), 1e-6)
    near.set_ylim(-1.4 * deepest, 1.4 * deepest)
    kept = extremes(bound, NARROW)
    near.fill_between(
        time[kept], -bound[kept], -1.4 * deepest, color=ERROR, alpha=0.15, linewidth=0.0, label="not allowed"
    )
    broken = np.where(energy + bound < -1e3 * ROUNDING, energy, np.nan)
    if np.isfinite(broken).any():
        kept = extremes(broken, NARROW)  # with dots, for a single tick makes no line
        near.plot(time[kept], broken[kept], ".-", color=TRUE, linewidth=2.2, markersize=4.4, label="bound broken")
    near.set_title("The same, close to the bound")
    near.locator_params(axis="y", nbins=5)
    near.set_xlabel("time [s]")
    legend(near, columns=5)
    return finished(figure, 2)


ENERGY = Section("energy", _findings, energy_lines, _drawings)
