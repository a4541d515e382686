"""How a session over a network would feel: one is simulated over it, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from foretouch.doctor.finding import Finding, Verdict
from foretouch.errors import InputError, plural
from foretouch.files.children import last_line

LASTS = 40.0  # Longest session that is simulated [s]
BEFORE = 15.0  # Time before the longest stall at which it begins, where the network lasts longer [s]
PATIENCE = 900.0  # Time after which the simulation is given up [s]

STALE = 1.0  # Stale commands from which a network is bad [%]
FELT = 50.0  # Time in contact in which the error of the predicted force can be felt, from which it is bad [%]


def check_network(network: str) -> Finding:
    """Simulate a session with a hand over a network, by name or from a file, around its longest stall.

    Bad is one over which a hundredth of the commands comes too late to be obeyed, or the force is wrong by more than
    can be felt for half of the contact. A warning is one in whose stalls the robot holds.
    """
    from foretouch.link import network_trace
    from foretouch.report.networks import network_figures

    name = f"network {network}"
    try:
        trace = network_trace(network)
    except InputError as error:
        return Finding(name, Verdict.BAD, str(error), "foretouch network list")
    begin = 0.0
    if trace.length > LASTS and trace.stalls.size:
        begin = max(0.0, float(trace.stalls[trace.stalls[:, 1].argmax(), 0]) - BEFORE)
    words = ["simulate", "--network", network, "--network-start", f"{begin:.3f}", "--grip", "normal"]
    words += ["--duration", f"{min(trace.length, LASTS):.3f}", "--json"]
    command = [sys.executable, "-m", "foretouch", *words]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
        report = json.loads(child.stdout)
    except subprocess.TimeoutExpired:
        return Finding(name, Verdict.UNKNOWN, f"no session was simulated within {PATIENCE:g} s", "foretouch warm-up")
    except ValueError:
        why = last_line(child.stderr, "without a word")
        return Finding(name, Verdict.UNKNOWN, f"no session could be simulated: {why}", "foretouch doctor")
    return judge_felt(name, network_figures(trace), report, f"foretouch network show {network}")


def judge_felt(name: str, network: dict[str, Any], report: dict[str, Any], mend: str) -> Finding:
    """What the figures of a network, and of a session over it, say."""
    from foretouch.report.networks import in_ms

    figures = {"stable": report["stable"]}
    figures |= {each: report[each] for each in ("duration_s", "prediction_error_percent", "within_jnd_percent")}
    figures |= {each: network[each] for each in ("longest_stall_s", "stalls_that_hold", "stale_percent")}
    inside = report["within_jnd_percent"]
    if inside is None:
        text = f"in {report['duration_s']:.0f} s simulated over it nothing was felt that could be scored"
        return Finding(name, Verdict.BAD, text, mend, figures)
    figures["beyond_jnd_percent"] = beyond = 100.0 - inside
    figures["away_percent"] = away = 100.0 * report["away_samples"] / max(report["samples"], 1)
    text = (
        f"{report['duration_s']:.0f} s simulated over it: the predicted force is wrong by "
        f"{report['prediction_error_percent']:.3g} %, in {beyond:.3g} % of the scored contact by more than can be "
        f"felt; the robot did not follow for {away:.2g} % of the time. In the whole of the network "
        f"{network['stale_percent']:.2g} % of commands are too late to be obeyed, and in "
        f"{plural(network['stalls_that_hold'], 'stall')} of up to {in_ms(network['longest_stall_s'])} the robot holds"
    )
    if not report["stable"] or beyond >= FELT or network["stale_percent"] >= STALE:
        return Finding(name, Verdict.BAD, text, mend, figures)
    if network["stalls_that_hold"]:
        return Finding(name, Verdict.WARNING, text, mend, figures)
    return Finding(name, Verdict.GOOD, text, figures=figures)
