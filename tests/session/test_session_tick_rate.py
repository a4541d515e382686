"""A driver that waits for its cycle, one that is too slow, and a loop that says so and holds."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from dataclasses import replace
from typing import Any

import pytest
from lap import Lap
from step_links import Spoken

from foretouch.messages import STATUS_SENTENCES, Status
from foretouch.robot import Robot, RobotSample, make_robot
from foretouch.session import Process, SessionSettings, StopFlag, run_follower, run_shadow
from foretouch.session.conformance.robot_checks import check_robot
from foretouch.session.runners import live, loop_timer
from foretouch.session.runners.loop_timer import LoopTimer, let_pass
from foretouch.session.runners.news import follower_news
from foretouch.session.steps.tick import LEAST_RATE, LONGEST_NS, WINDOW, Rate, is_too_slow

MS = 1_000_000


# --- how many exchanges -----------------------------------------------------------------------------------------------


def exchanges(monkeypatch: pytest.MonkeyPatch, periods: int, *, simulated: bool, lasts_ns: int = 10_000) -> int:
    clock, made = 0, 0

    def exchange() -> None:
        nonlocal clock, made
        clock, made = clock + lasts_ns, made + 1

    monkeypatch.setattr(loop_timer.time, "monotonic_ns", lambda: clock)
    let_pass(exchange, periods, simulated=simulated)
    return made


@pytest.mark.parametrize("periods", [0, 1, 2, 7, 400])
def test_a_real_robot_has_one_exchange_a_tick_whatever_was_missed(
    monkeypatch: pytest.MonkeyPatch, periods: int
) -> None:
    assert exchanges(monkeypatch, periods, simulated=False) == min(periods, 1)
    assert exchanges(monkeypatch, periods, simulated=False, lasts_ns=3 * MS) == min(periods, 1)
    assert exchanges(monkeypatch, periods, simulated=True) == min(periods, loop_timer.LONGEST_CATCH_UP)
    assert exchanges(monkeypatch, periods, simulated=True, lasts_ns=MS) == min(periods, 1)  # it would fall behind more


class Bus(Robot):
    """An arm behind a bus: an exchange returns at the next cycle of 1 kHz, by a clock of its own."""

    def __init__(self, *, simulated: bool = False) -> None:
        self.robot: Robot = make_robot("hunt-crossley", seed=0)
        self.specification = replace(self.robot.specification, simulated=simulated)
        self.now_ns = 0
        self.made = 0

    def read(self) -> RobotSample:
        return self.robot.read()

    def exchange(self, desired_position: float) -> RobotSample:
        self.now_ns = (self.now_ns // MS + 1) * MS
        self.made += 1
        return self.robot.exchange(desired_position)


@pytest.mark.parametrize("side", ["follower", "shadow"])
@pytest.mark.first
def test_a_loop_keeps_its_pace_with_a_driver_that_waits_for_its_cycle_also_after_a_delay(
    monkeypatch: pytest.MonkeyPatch, side: str
) -> None:
    robot = Bus()
    monkeypatch.setattr(loop_timer.time, "monotonic_ns", lambda: robot.now_ns)
    monkeypatch.setattr(loop_timer.time, "sleep", lambda seconds: None)
    monkeypatch.setattr(loop_timer, "wakes_late_ns", lambda: 0)

    class Timer(LoopTimer):
        """The loop's own, by the robot's clock; a step takes 0.3 ms, and one of them 40."""

        def __init__(self, period: float) -> None:
            super().__init__(period)
            self.ticks = 0

        def wait(self) -> tuple[int, int]:
            self.ticks += 1
            robot.now_ns += 40 * MS if self.ticks == 100 else 300_000
            robot.now_ns = max(robot.now_ns, self._deadline_ns + self._period_ns if self._deadline_ns else 1)
            return super().wait()

    run: Any = {"follower": run_follower, "shadow": run_shadow}[side]
    monkeypatch.setattr(live, "LoopTimer", Timer)
    monkeypatch.setattr(live, "link_counts", lambda *_: {})
    link: Any = Spoken(lambda now: 0.001)
    output: list[str] = []
    process = Process(link, StopFlag(), output.append)
    run(process, robot, SessionSettings(material="hunt-crossley"), description={}, duration=1.0)
    assert len(link.telemetry) >= 950  # of 1000; 40 are gone in one delay
    assert abs(len(link.telemetry) - robot.made) <= 1


# --- too few ticks ----------------------------------------------------------------------------------------------------


def test_a_rate_is_judged_over_five_hundred_ticks_and_a_collapse_within_half_a_second() -> None:
    rate = Rate.new()[0]
    assert not any(is_too_slow.entry(rate, MS) for _ in range(1000))
    slow = [is_too_slow.entry(rate, round(1e9 / 499)) for _ in range(2 * WINDOW)]
    assert WINDOW - 5 <= slow.index(True) <= WINDOW
    assert all(slow[WINDOW:])
    assert all(
        is_too_slow.entry(rate, round(1e9 / 590)) for _ in range(3 * WINDOW)
    )  # above the limit, and below the way back
    back = [is_too_slow.entry(rate, round(1e9 / 610)) for _ in range(2 * WINDOW)]
    assert not any(back[WINDOW:])
    assert not any(is_too_slow.entry(rate, round(1e9 / 510)) for _ in range(3 * WINDOW))
    rate = Rate.new()[0]
    period = MS * 1000 // 15
    ticks = next(count for count in range(1, 100) if is_too_slow.entry(rate, period))
    assert ticks * period <= 600 * MS
    rate = Rate.new()[0]
    assert not any(is_too_slow.entry(rate, LONGEST_NS * 20 if tick == 300 else MS) for tick in range(1000))


def test_a_follower_that_is_too_slow_holds_and_says_so_and_then_goes_slowly_back() -> None:
    lap = Lap.led(2.0, position_delay=0.0, force_delay=0.0)
    assert lap.telemetry[-1].status == Status.FOLLOWING
    slow = [is_too_slow.entry(lap.following.memory[0].rate, 3 * MS) for _ in range(WINDOW)]
    assert slow[-1]
    output = lap.run(0.05)
    assert {telemetry.status for telemetry in output[1:]} == {Status.TOO_SLOW}
    assert max(telemetry.desired_position for telemetry in output[10:]) <= output[9].desired_position + 1e-6
    assert follower_news(lap.following) == f"the robot {STATUS_SENTENCES[Status.TOO_SLOW]}"
    assert str(LEAST_RATE) in STATUS_SENTENCES[Status.TOO_SLOW]
    lap.run(0.6)
    assert lap.telemetry[-1].status in (Status.RETURNING, Status.FOLLOWING)
    lap.stop = "somebody shouted"
    for _ in range(WINDOW):
        is_too_slow.entry(lap.following.memory[0].rate, 3 * MS)
    assert lap.run(0.01)[-1].status == Status.STOPPED  # what is more urgent is said and done


# --- the check of a plug-in -------------------------------------------------------------------------------------------


class Late(Bus):
    def exchange(self, desired_position: float) -> RobotSample:
        sample = super().exchange(desired_position)
        self.now_ns += 20_000 * (self.made % 2)
        return sample


class Slow(Bus):
    def __init__(self, works_ns: int = 0, cycles: float = 0.0) -> None:
        super().__init__()
        self.works_ns, self.cycle_ns = works_ns, cycles * MS

    def exchange(self, desired_position: float) -> RobotSample:
        self.now_ns += self.works_ns
        if self.cycle_ns:
            self.now_ns = math.floor(self.now_ns / self.cycle_ns + 1) * round(self.cycle_ns)
        return self.robot.exchange(desired_position)


@pytest.mark.parametrize(
    ("robot", "fine"),
    [(Late(), True), (Slow(1_050_000), False), (Slow(1_500_000), False), (Slow(0, 2), False), (Slow(0, 2.5), False)],
    ids=["waits for its cycle", "works for 1.05 ms", "works for 1.5 ms", "waits for 2 cycles", "waits for 2.5 cycles"],
)
def test_a_driver_that_waits_for_its_cycle_is_fine_and_one_that_takes_longer_is_too_slow(
    monkeypatch: pytest.MonkeyPatch, robot: Bus, fine: bool
) -> None:
    def now() -> float:
        robot.now_ns += 1000  # looking at the clock takes a microsecond
        return robot.now_ns * 1e-9

    monkeypatch.setattr(time, "perf_counter", now)
    (finding,) = [one for one in check_robot(lambda: robot) if one.check == "exchange time"]
    assert finding.passed is fine


# --- what a process asks the kernel for, and what its threads have of it ----------------------------------------------


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


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone can be asked")
@pytest.mark.long
def test_a_prompt_process_has_short_slices_and_wakes_at_once_and_a_watcher_gives_way_with_all_their_threads() -> None:
    code = HERE_ONCE.format(codes=(PROMPT, SHORT, WATCHER))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines() == ["True True", "True True True", "[(True, True), (True, True)]"]
