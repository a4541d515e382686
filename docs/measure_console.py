"""Does a browser change the timing of the loops? The same session without one, with one, and with two that misbehave.

Four runs of `foretouch teleop`, each with a console: nobody looks; a browser draws and a mouse presses; the browser is
stopped (SIGSTOP) while it is sent pictures; its tab is closed while the handle is held. Printed is what leader and
follower measured of themselves, from the recording. The browser draws in software on the machine of the session, and
its processes are of the lowest priority (nice 19), so that what is compared is not who gets the processor.

Usage: `.venv/bin/python docs/measure_console.py [SECONDS]`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "console"))  # the mouse and the browser are the tests' own

from console_driver import held_handle, open_page, take_handle  # noqa: E402

from foretouch.link import free_endpoint  # noqa: E402
from foretouch.recordings import read_session  # noqa: E402

LATE_NS = 1_500_000
"""A tick is late that comes so long after the one before [ns]."""
BEGIN = 3.0
"""Seconds at the beginning that are not counted: the browser starts."""

Row = tuple[str, str, float, float, float, float, float]


def main(seconds: float) -> None:
    """Print the table."""
    print(f"{seconds:g} s of each run; period between ticks and computing of a step, ms")
    print(f"{'run':28}{'side':10}{'period 50 %':>12}{'99 %':>8}{'late':>8}{'compute 50 %':>14}{'99 %':>8}")
    for name, behave in RUNS.items():
        for row in run(name, behave, seconds):
            print(f"{row[0]:28}{row[1]:10}{row[2]:12.3f}{row[3]:8.2f}{row[4]:7.2f}%{row[5]:14.3f}{row[6]:8.3f}")


def run(name: str, behave: Callable[[str, float], None], seconds: float) -> list[Row]:
    """One session with a browser that behaves so; its loops in figures."""
    port = int(free_endpoint().rpartition(":")[2])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mcap"
        command = [sys.executable, "-m", "foretouch", "teleop", "--port", str(port), "--recording", str(path)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with subprocess.Popen([*command, "--material", "hunt-crossley"], **quiet) as session:  # type: ignore[call-overload]
            try:
                url = f"http://127.0.0.1:{port}"
                wait_for(url)
                behave(url, seconds)
            finally:
                session.send_signal(signal.SIGINT)
        log = read_session(path)
    return [(name, side, *figures(rows)) for side, rows in (("leader", log.leader), ("follower", log.follower))]


def figures(rows: np.ndarray) -> tuple[float, float, float, float, float]:
    """Median and 99 % of the period [ms], share of late ticks [%], median and 99 % of the computing [ms]."""
    counted = rows[rows["time_ns"] - rows["time_ns"][0] > BEGIN * 1e9]
    period, compute = counted["period_ns"] * 1e-6, counted["compute_ns"] * 1e-6
    late = 100.0 * float(np.mean(counted["period_ns"] > LATE_NS))
    (p50, p99), (c50, c99) = np.percentile(period, (50, 99)), np.percentile(compute, (50, 99))
    return float(p50), float(p99), late, float(c50), float(c99)


def nobody(url: str, seconds: float) -> None:
    """No browser."""
    time.sleep(BEGIN + seconds)


def one_that_presses(url: str, seconds: float) -> None:
    """A browser that draws, and a mouse on the handle."""
    begun = time.monotonic()
    with open_page(url) as (page, _):
        print(f"browser started and page up after {time.monotonic() - begun:.1f} s")
        give_way(page)
        with held_handle(page, 8.0):
            page.wait_for_timeout(1000 * seconds)


def one_that_stands_still(url: str, seconds: float) -> None:
    """A browser whose processes are stopped: it reads nothing any more."""
    with open_page(url) as (page, _):
        give_way(page)
        stopped = processes_of(page)
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            for pid in stopped:
                os.kill(pid, signal.SIGCONT)


def one_that_is_closed(url: str, seconds: float) -> None:
    """A tab that is closed while it holds the handle."""
    with open_page(url) as (page, _):
        give_way(page)
        take_handle(page, 8.0)
    time.sleep(seconds)


RUNS: dict[str, Callable[[str, float], None]] = {
    "no browser": nobody,
    "browser, mouse presses": one_that_presses,
    "browser stopped (SIGSTOP)": one_that_stands_still,
    "tab closed while it presses": one_that_is_closed,
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


def wait_for(url: str) -> None:
    """Wait until a console answers."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        try:
            urllib.request.urlopen(url, timeout=1.0).close()
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.2)
    raise SystemExit(f"the console did not come up at {url}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 15.0)
