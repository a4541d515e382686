"""Does a browser change the timing of the loops? One session; by turns without one, and with some that misbehave.

`foretouch teleop` with a console runs once. In each round, one after another: nobody looks; the browser is stopped
(SIGSTOP) while it is sent pictures; its tab has been closed while the handle was held; a browser draws and a mouse
presses. Printed, and written into `docs/console.md`, is what leader and follower measured of themselves in these
segments, from the recording: the median over the rounds and the largest. The browser that draws does so in
software on the machine of the session, with the lowest priority (nice 19), and once more with the priority that it has.

Beside it: in which share of its ticks the robot held its place for lack of a fresh command, and how wrong the predicted
force was while it followed, as the console shows it beside the curve.

Usage: `.venv/bin/python docs/measure_console.py [SECONDS of a segment] [ROUNDS]`; 10 and 5 without.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "console.md"
sys.path.insert(0, str(ROOT / "tests" / "console"))  # the mouse and the browser are the tests' own

from console_driver import held_handle, open_page, take_handle  # noqa: E402
from visitors import Printed  # noqa: E402

from foretouch.console.history import CONTACT_FLOOR  # noqa: E402
from foretouch.link import free_endpoint  # noqa: E402
from foretouch.messages import WITH_THE_COMMANDS, SessionLog, Status  # noqa: E402
from foretouch.recordings import read_session  # noqa: E402

LATE_NS = 1_500_000
"""A tick is late that comes so long after the one before [ns]."""

SETTLE = 2.0
"""Seconds that are not counted after something began or ended: a session that starts, a browser that goes."""

Segment = tuple[int, int]
"""From when to when [ns, monotonic clock, which is one for all processes of a machine]."""

Runs = dict[str, Callable[[Printed, float], Segment]]
"""What the browser does, by name."""

HELD = (Status.HOLDING, Status.UNLOADING, Status.RETREATING, Status.TOO_SLOW)
"""In these the robot has no fresh command."""

LAPTOP, LOADED = (1280, 720), 8.0
"""The page, and how long it has to load and to find its rate of pictures [s]."""

Key = tuple[str, str]
"""What the browser did, and the side of the session."""


def main(seconds: float, rounds: int) -> None:
    """Print the table and fill the page."""
    from measured_blocks import fill  # notes which code this is, and the tests that use this script need no notes

    log, segments = run_all(RUNS, seconds, rounds)
    measured = timing(log, segments)
    held = felt(log, segments)
    lines = [
        f"{rounds} rounds of {seconds:g} s each; the median over the rounds, the largest in parentheses:\n",
        "| Browser | Leader: period at 99 % [ms] | late [%] | Follower: period at 99 % [ms] | late [%] "
        "| Robot held [%] | Error [%] |",
        "| --- |" + " --: |" * 6,
    ]
    for name in segments:
        timed = [cell for side in ("leader", "follower") for cell in over_rounds(measured[name, side][:, 1:])]
        lines.append(f"| {' | '.join([name, *timed, *over_rounds(held[name])])} |")
    text = "\n".join(lines) + "\n"
    print(text)
    fill(PAGE, {"console": text})


def over_rounds(of_rounds: np.ndarray) -> list[str]:
    """The median over the rounds of each figure, the largest in parentheses."""
    middle, largest = np.median(of_rounds, axis=0), of_rounds.max(axis=0)
    return [f"{one:.2f} ({most:.2f})" for one, most in zip(middle, largest, strict=True)]


def run_all(runs: Runs, seconds: float, rounds: int) -> tuple[SessionLog, dict[str, list[Segment]]]:
    """One session in which the browser did all that, by turns; and when it did."""
    segments: dict[str, list[Segment]] = {name: [] for name in runs}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mcap"
        with session(path) as printed:
            for _ in range(rounds):
                for name, behave in runs.items():
                    segments[name].append(behave(printed, seconds))
        log = read_session(path)
    return log, segments


def timing(log: SessionLog, segments: dict[str, list[Segment]]) -> dict[Key, np.ndarray]:
    """By what the browser did and side of the session: `figures` of each round."""
    return {
        (name, side): np.array([figures(rows, segment) for segment in of_it])
        for name, of_it in segments.items()
        for side, rows in (("leader", log.leader), ("follower", log.follower))
    }


def felt(log: SessionLog, segments: dict[str, list[Segment]]) -> dict[str, np.ndarray]:
    """By what the browser did: how long the robot held [%], and the error of the predicted force [%], of each round."""
    return {name: np.array([_felt(log, segment) for segment in of_it]) for name, of_it in segments.items()}


def _felt(log: SessionLog, segment: Segment) -> tuple[float, float]:
    begin, end = segment
    follower = log.follower[(log.follower["time_ns"] > begin) & (log.follower["time_ns"] < end)]
    rows = log.rows()
    following = np.isin(rows.follower["status"], WITH_THE_COMMANDS)
    counted = (rows.leader["time_ns"] > begin) & (rows.leader["time_ns"] < end) & following
    true, predicted = rows.follower["force"][counted], rows.leader["predicted_force"][counted]
    contact = (true > CONTACT_FLOOR) & np.isfinite(predicted)
    error = np.sqrt(np.mean((predicted[contact] - true[contact]) ** 2) / np.mean(true[contact] ** 2))
    return 100.0 * float(np.isin(follower["status"], HELD).mean()), 100.0 * float(error)


@contextlib.contextmanager
def session(path: Path) -> Iterator[Printed]:
    """A session with a console, recorded at the path; what it prints, with the console's addresses."""
    port = int(free_endpoint().rpartition(":")[2])
    command = [sys.executable, "-m", "foretouch", "teleop", "--port", str(port), "--recording", str(path)]
    command += ["--material", "hunt-crossley"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        try:
            printed = Printed(running)
            printed.wait()
            yield printed
        finally:
            running.send_signal(signal.SIGINT)


def figures(rows: np.ndarray, segment: Segment) -> tuple[float, float, float]:
    """Median and 99 % of the period [ms], and the ratio of late ticks [%]."""
    begin, end = segment
    counted = rows[(rows["time_ns"] > begin) & (rows["time_ns"] < end)]
    late = 100.0 * float(np.mean(counted["period_ns"] > LATE_NS))
    p50, p99 = np.percentile(counted["period_ns"] * 1e-6, (50, 99))
    return float(p50), float(p99), late


def watch(seconds: float, wait: Callable[[float], None] = time.sleep) -> Segment:
    """Let it settle; then the segment."""
    wait(SETTLE)
    begin = time.monotonic_ns()
    wait(seconds)
    return begin, time.monotonic_ns()


def nobody(printed: Printed, seconds: float) -> Segment:
    """No browser."""
    return watch(seconds)


def one_that_presses(printed: Printed, seconds: float) -> Segment:
    """A browser that draws, and a mouse on the handle."""
    with open_page(printed.address()) as (page, _):
        print(f"page up {page.evaluate('performance.now()') / 1000:.1f} s after its address was opened")
        give_way(page)
        with held_handle(page, 8.0):
            return watch(seconds, lambda s: page.wait_for_timeout(1000 * s))


def one_that_draws(printed: Printed, seconds: float) -> Segment:
    """A browser that draws, with the priority that it has."""
    with open_page(printed.address(), *LAPTOP) as (page, _):
        page.wait_for_timeout(1000 * LOADED)
        return watch(seconds, lambda s: page.wait_for_timeout(1000 * s))


def one_that_stands_still(printed: Printed, seconds: float) -> Segment:
    """A browser whose processes are stopped: it reads nothing any more."""
    with open_page(printed.address()) as (page, _):
        stopped = processes_of(page)
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        try:
            return watch(seconds)
        finally:
            for pid in stopped:
                os.kill(pid, signal.SIGCONT)


def one_that_is_closed(printed: Printed, seconds: float) -> Segment:
    """A tab that is closed while it holds the handle."""
    with open_page(printed.address()) as (page, _):
        take_handle(page, 8.0)
        page.close()
        return watch(seconds)


RUNS: Runs = {
    "none": nobody,
    "stopped (SIGSTOP)": one_that_stands_still,
    "tab closed while it presses": one_that_is_closed,
    "mouse presses": one_that_presses,
    "as it comes": one_that_draws,
}


def give_way(page: Any) -> None:
    """All processes of the browser are of the lowest priority, each thread of them."""
    for pid in processes_of(page):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), 19)


def processes_of(page: Any) -> list[int]:
    """Those that draw the page and read its network, the browser's own not among them, which the tests talk to."""
    session = page.context.browser.new_browser_cdp_session()
    return [
        process["id"]
        for process in session.send("SystemInfo.getProcessInfo")["processInfo"]
        if process["type"] != "browser"
    ]


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(float(arguments[0]) if arguments else 10.0, int(arguments[1]) if len(arguments) > 1 else 5)
