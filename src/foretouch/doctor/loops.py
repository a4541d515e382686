"""Punctuality of loops at 1 kHz on this machine: one that computes as a session does, beside one that does nothing.

Both run at the same time, each in a process of its own, as leader and follower do. Where both are late it is the
machine; where only the first is, it is what is computed in it.

The kernel's slice of time, for which it lets a loop run at one go, is looked at too.
"""

from __future__ import annotations

import ctypes
import json
import math
import platform
import select
import struct
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from foretouch.doctor.finding import Finding, Verdict, percentile
from foretouch.files.children import children, last_line

GET_ATTRIBUTES = {"x86_64": 315, "aarch64": 275}
"""Number of the system call `sched_getattr`, for which the C library has no function."""

ATTRIBUTES = struct.Struct("<IIQiIQQQ")
"""Attributes in the answer: size, policy, flags, nice, priority, then runtime, deadline and period [ns]."""


def granted_slice_ns() -> int:
    """Slice of this thread as the kernel says [ns]; 0 where it does not, as before Linux 6.12 and elsewhere."""
    call = GET_ATTRIBUTES.get(platform.machine())
    if sys.platform != "linux" or call is None:
        return 0
    answer = ctypes.create_string_buffer(ATTRIBUTES.size)
    if ctypes.CDLL(None).syscall(call, 0, answer, ATTRIBUTES.size, 0) != 0:
        return 0
    return int(ATTRIBUTES.unpack(answer.raw)[5])


LoopReport = dict[str, float]
"""Figures of one loop: ``late_p50_s``, ``late_p99_s``, ``late_max_s``, ``compute_p50_s``, ``compute_p99_s``, ``ticks``,
``missed`` and ``slice_s``."""

KINDS = ("session", "bare")

READY_PATIENCE = 180.0  # Longest time that compiling a session's code takes [s], the first time

LATE, VERY_LATE, HOLD = 5e-4, 5e-3, 5e-2
"""Half a period [s]; what a hand can feel as unsteady; and what makes a follower hold (`hold_after`)."""

PRESS_FREQUENCY, PRESS_DEPTH, STIFFNESS, SURFACE = 1.0, 2e-3, 500.0, 0.01
"""Press on a virtual spring that the loop computes [1/s, m, N/m, m]."""


def run_loops(seconds: float) -> dict[str, LoopReport]:
    """Run both loops side by side for a time [s]; a RuntimeError says which did not end, and its last line."""
    pipe = subprocess.PIPE
    with children(grace=0.0) as started:
        running = {}
        for kind in KINDS:
            command = [sys.executable, "-m", "foretouch.doctor.loops", kind, str(seconds)]
            running[kind] = started.start(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        for kind, child in running.items():
            _line(kind, child, READY_PATIENCE)
        for child in running.values():
            assert child.stdin is not None
            child.stdin.write("go\n")
            child.stdin.flush()
        return {kind: json.loads(_line(kind, child, 3.0 * seconds + 30.0)) for kind, child in running.items()}


def _line(kind: str, child: subprocess.Popen[Any], patience: float) -> str:
    assert child.stdout is not None
    assert child.stderr is not None
    if not select.select([child.stdout], [], [], patience)[0]:
        raise RuntimeError(f"the {kind} loop reported nothing for {patience:g} s")
    if line := child.stdout.readline():
        return str(line)
    raise RuntimeError(f"the {kind} loop ended: {last_line(child.stderr.read(), 'without a word')}")


def check_loops(reports: dict[str, LoopReport] | str) -> Finding:
    """Judge how late ticks woke, and say what of a device's delay (`DeviceSpecification`) is this machine's.

    A position that is read in a tick is answered when that tick has computed: lateness and computing time are in the
    delay d of the condition b > K (T / 2 + d), and the device's own input and output come on top.

    Good is a 99th percentile below 0.5 ms, half a period. Bad is one above 5 ms, or a single tick that came 50 ms late:
    a follower then holds. The reports are those of both loops by name, or why there are none.
    """
    name = "loop at 1 kHz"
    if isinstance(reports, str):
        return Finding(name, Verdict.UNKNOWN, reports)
    session, bare = (reports[kind] for kind in KINDS)
    shown = []
    for kind in KINDS:
        p50, p99, largest = (1e3 * reports[kind][f"late_{which}_s"] for which in ("p50", "p99", "max"))
        shown.append(f"{kind}: p50 {p50:.3f}, p99 {p99:.3f}, most {largest:.2f} ms")
    text = f"woken late by {'; '.join(shown)}"
    late = session["late_p99_s"] + session["compute_p99_s"]
    text += f"; a tick computes {1e6 * session['compute_p50_s']:.0f} us"
    text += f"; of a device's delay {1e3 * late:.2f} ms are this machine's (p99): give --device-delay no less"
    worst_p99, worst = (max(session[key], bare[key]) for key in ("late_p99_s", "late_max_s"))
    figures = {"session": session, "bare": bare}
    if worst_p99 < LATE and worst < HOLD:
        return Finding(name, Verdict.GOOD, text, figures=figures)
    verdict = Verdict.BAD if worst_p99 >= VERY_LATE or worst >= HOLD else Verdict.WARNING
    ours = bare["late_p99_s"] < LATE <= session["late_p99_s"]
    text += "; the machine is punctual, what is computed is too slow" if ours else "; the machine itself is late"
    mend = "foretouch bench --only loops" if ours else "ps -eo pid,pcpu,args --sort=-pcpu | head"
    return Finding(name, verdict, text, mend, figures)


def main(kind: str, seconds: str) -> None:
    """Say that all is ready, wait for a line, run a ``session`` or ``bare`` loop, and print its report."""
    from foretouch.session import SAMPLE_PERIOD, be_prompt
    from foretouch.session.runners.loop_timer import measure_loop

    be_prompt()
    work = _press() if kind == "session" else lambda time: None
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    if not sys.stdin.readline():  # the parent has gone
        return
    loop = measure_loop(SAMPLE_PERIOD, max(10, round(float(seconds) / SAMPLE_PERIOD)), work)
    report: LoopReport = {
        **_percentiles("late", loop.late_ns),
        **_percentiles("compute", loop.compute_ns),
        "ticks": float(len(loop.late_ns)),
        "missed": float(loop.missed),
        "slice_s": 1e-9 * granted_slice_ns(),
    }
    sys.stdout.write(json.dumps(report) + "\n")


def _percentiles(name: str, values_ns: list[int]) -> dict[str, float]:
    positions = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    return {f"{name}_{which}_s": 1e-9 * percentile(values_ns, part) for which, part in positions.items()}


def _press() -> Callable[[float], None]:
    """What leader and follower compute in a tick, for a press: to learn a sample, and to render a force."""
    from foretouch.identification import Learner
    from foretouch.session import SAMPLE_PERIOD, SessionSettings
    from foretouch.session.runners.warm_up import warm_up

    settings = SessionSettings()
    warm_up(settings)
    learner = Learner(settings.make_estimator(), surface=SURFACE, force_offset=0.0)

    def work(time: float) -> None:
        depth = PRESS_DEPTH * math.sin(2.0 * math.pi * PRESS_FREQUENCY * time)
        learner.update(time, SURFACE + depth, STIFFNESS * max(depth, 0.0))
        if round(time / SAMPLE_PERIOD) % 20 == 0:
            learner.learnt()

    return work


if __name__ == "__main__":
    main(*sys.argv[1:])
