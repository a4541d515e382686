"""What a process asks the kernel for, and what its threads have of it; each in a process of its own, for it stays."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone can be asked")

SLICES = """
import ctypes, platform, struct
def asked():  # sched_getattr: size, policy, flags, nice, priority, runtime, deadline, period
    buffer = ctypes.create_string_buffer(48)
    ctypes.CDLL(None).syscall({"x86_64": 315, "aarch64": 275}[platform.machine()], 0, buffer, 48, 0)
    return struct.unpack("<IIQiIQQQ", buffer.raw)
"""


HERE_ONCE = """
import os
from foretouch.session.runners import loop_timer as scheduling  # imported once for all of them
for code in {codes!r}:
    if (child := os.fork()) == 0:
        exec(code, {{}})
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""

PROMPT = (
    "import ctypes, threading\n"
    "from foretouch.session.runners.loop_timer import PROMPT_NS, SET_TIMER_SLACK, USUAL_NS, be_prompt, wakes_late_ns\n"
    "ctypes.CDLL(None).prctl(SET_TIMER_SLACK, ctypes.c_ulong(50_000), 0, 0, 0)\n"  # the parent may have been prompt
    "assert wakes_late_ns() == USUAL_NS\n"
    "be_prompt()\n"
    "seen = []\n"
    "thread = threading.Thread(target=lambda: seen.append(wakes_late_ns()))\n"
    "thread.start(); thread.join()\n"
    "print(wakes_late_ns() == PROMPT_NS, seen == [PROMPT_NS], flush=True)"
)
SHORT = (
    "import os, threading\n" + SLICES + "from foretouch.session.runners.loop_timer import SLICE_NS, be_prompt\n"
    "os.nice(3)\n"
    "before = asked()\n"
    "be_prompt()\n"
    "seen = []\n"
    "thread = threading.Thread(target=lambda: seen.append(asked()))\n"
    "thread.start(); thread.join()\n"
    "after = asked()\n"
    "knows = tuple(map(int, os.uname().release.split('.')[:2])) >= (6, 12)\n"
    "print(after[3] == before[3], seen[0] == after, not knows or after[5] == SLICE_NS, flush=True)"
)
WATCHER = (
    "import os, threading\n"
    "from foretouch.session.runners.loop_timer import WATCHERS_NICE, give_way\n"
    "wanted = min(19, os.getpriority(os.PRIO_PROCESS, 0) + WATCHERS_NICE)\n"
    "give_way()\n"
    "seen = []\n"
    "nice = lambda: os.getpriority(os.PRIO_PROCESS, 0)\n"
    "def look(): seen.append((os.sched_getscheduler(0) == os.SCHED_BATCH, nice() == wanted))\n"
    "thread = threading.Thread(target=look)\n"
    "thread.start(); thread.join(); look()\n"
    "print(seen, flush=True)"
)


@pytest.fixture(scope="module")
def said() -> list[str]:
    """The line that each of the three prints, in a process of its own: children of one that has imported it all."""
    code = HERE_ONCE.format(codes=(PROMPT, SHORT, WATCHER))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.splitlines()


def test_a_prompt_process_wakes_within_a_microsecond_of_what_it_asked_for_and_so_do_its_threads(
    said: list[str],
) -> None:
    assert said[0].split() == ["True", "True"]


def test_a_prompt_process_asks_for_short_slices_where_the_kernel_knows_them_and_keeps_its_priority(
    said: list[str],
) -> None:
    assert said[1].split() == ["True", "True", "True"]


def test_a_watcher_gives_way_with_all_its_threads(said: list[str]) -> None:
    assert said[2] == "[(True, True), (True, True)]"
