"""A simulated arm on this machine: whether it can be made, how long an exchange takes, and what its rate costs.

It is made in a process of its own, in free air, and moves as slowly as a hand that comes near.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

from foretouch.doctor.finding import Finding, Verdict, percentile
from foretouch.files.children import last_line

PERIOD = 1e-3  # Of a session's tick [s]

MOST = 0.8
"""Largest share of a tick's period that an exchange may take: what a follower computes beside it takes some 0.1 ms."""

EXCHANGES, FIRST = 3000, 200
"""Number of exchanges that are timed, and of those before, in which memory and caches become warm."""

PATIENCE = 300.0  # Longest time that this may take [s]: code is compiled first, where it was not


def check_arm(robot: str) -> Finding:
    """Make the arm of this name, or of this description's file, and time its exchanges.

    Bad is one that cannot be made, or whose exchange takes longer than a tick in the mean: a session in real time falls
    behind. A warning is one of which every hundredth takes more than 0.8 ms.
    """
    name = f"arm {robot}"
    command = [sys.executable, "-m", "foretouch.doctor.arms", robot]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return Finding(name, Verdict.UNKNOWN, f"it was not made within {PATIENCE:g} s", "foretouch warm-up")
    try:
        report = json.loads(child.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        why = last_line(child.stderr, "without a word")
        return Finding(name, Verdict.BAD, f"making it ended with exit code {child.returncode}: {why}")
    if "problem" in report:
        return Finding(name, Verdict.BAD, report["problem"], report["mend"])
    return judge(name, report)


def judge(name: str, report: dict[str, Any]) -> Finding:
    """What the figures of an arm mean for a session: ``rate`` [Hz], ``mean_s``, ``p50_s`` and ``p99_s``."""
    mean, p50, p99 = (1e6 * report[key] for key in ("mean_s", "p50_s", "p99_s"))
    text = f"an exchange takes {mean:.0f} us (p50 {p50:.0f}, p99 {p99:.0f}) of the {1e6 * PERIOD:.0f} us of a tick"
    wait = 1e3 / report["rate"]
    text += f"; its controller runs at {report['rate']} Hz"
    if wait > 1e3 * PERIOD:
        text += f": commands and samples are up to {wait - 1e3 * PERIOD:g} ms later than at 1 kHz"
    busiest = "ps -eo pid,pcpu,args --sort=-pcpu | head"
    if report["mean_s"] >= PERIOD:
        text += "; a session in real time falls behind, `foretouch simulate` does not mind"
        return Finding(name, Verdict.BAD, text, busiest, report)
    if report["p99_s"] > MOST * PERIOD:
        return Finding(name, Verdict.WARNING, f"{text}; some ticks will be late", busiest, report)
    return Finding(name, Verdict.GOOD, text, figures=report)


def main(robot: str) -> None:
    """Make the arm, let it move, and print as JSON what came of it."""
    from foretouch.errors import ForetouchError, MissingExtraError, install_command

    try:
        report = _timed(robot)
    except MissingExtraError as error:
        report = {"problem": str(error), "mend": install_command("arms")}
    except ForetouchError as error:
        report = {"problem": str(error), "mend": ""}
    sys.stdout.write(json.dumps(report) + "\n")


def _timed(robot: str) -> dict[str, Any]:
    from foretouch.robot import ArticulatedArm, read_arm

    description = read_arm(robot)
    arm = ArticulatedArm(description, lambda place, velocity, elapsed: (0.0, 0.0, 0.0), seed=0)
    took = []
    for tick in range(FIRST + EXCHANGES):
        begun = time.perf_counter()
        arm.exchange((0.0, 0.0, 0.05 - 1e-5 * tick))  # 10 mm/s down
        took.append(time.perf_counter() - begun)
    took = took[FIRST:]
    return {
        "rate": description.rate,
        "mean_s": sum(took) / len(took),
        "p50_s": percentile(took, 0.5),
        "p99_s": percentile(took, 0.99),
    }


if __name__ == "__main__":
    main(*sys.argv[1:])
