"""Processes of a session as their supervisor hears them: real ones, that beat, fall silent, and do not end."""

from __future__ import annotations

import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
from running import until

from foretouch.errors import SettingError, UnknownNameError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Choice, EmergencyStop, Hello, Settings, Stop
from foretouch.session import SessionSettings, StopFlag
from foretouch.session.runners import children
from foretouch.session.runners.children import CHOICE_CHANNELS, LATCHING, SUPERVISOR, Child, Desk, end_session, retire
from foretouch.session.runners.housekeeping import BEAT, COMPILING
from foretouch.session.runners.live import LEAVING
from foretouch.session.runners.news import HANGS_AFTER
from foretouch.session.settings import choose, with_faults

BEATS = f"""
import os, time
for _ in range(COUNT):
    os.write(1, b"and" + {BEAT!r})
    time.sleep(0.1)
time.sleep(60)
"""
STAYS = "import signal, os, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nos.write(1, b'x')\ntime.sleep(60)\n"


@pytest.fixture
def begin() -> Iterator[Callable[..., Child]]:
    made: list[Child] = []

    def start(source: str, role: str = "leader") -> Child:
        process = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE)
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        made.append(Child(role, process))
        return made[-1]

    yield start
    for child in made:
        child.process.kill()
        child.process.communicate()


def listen(child: Child, until: Callable[[], object], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end
        child.listen()
        time.sleep(0.02)


def test_a_side_that_beats_goes_on_and_one_that_falls_silent_hangs(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "PATIENCE", 1.0)
    child = begin(BEATS.replace("COUNT", "15"))
    assert child.begun is None
    listen(child, lambda: child.begun is not None)
    begun = time.monotonic()
    listen(child, lambda: child.silence > 0.5)
    assert time.monotonic() - begun > 1.2  # it beat for so long
    assert child.hangs() == ""
    listen(child, child.hangs)
    assert child.hangs() == "hangs: nothing has come of it for 1 s"
    child.process.kill()
    child.process.wait()
    assert child.hangs() == ""  # one that has ended is judged by its exit code


def test_one_that_was_stopped_by_a_signal_is_not_silent_nor_counts_a_supervisor_its_own_stop(
    begin: Callable[..., Child],
) -> None:
    child = begin(BEATS.replace("COUNT", "3"))
    listen(child, lambda: child.begun is not None)
    child.process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    for _ in range(50):
        child.listen()
        assert child.silence == 0.0
        time.sleep(0.02)
    child.process.send_signal(signal.SIGCONT)
    listen(child, lambda: child.silence > 0.2)
    child = begin(BEATS.replace("COUNT", "1"))
    listen(child, lambda: child.begun is not None)
    child.listened -= 100.0
    child.listen()
    assert child.silence <= children.LONGEST_LOOK


def test_one_that_never_begins_and_one_that_does_not_end_are_told(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    child = begin(STAYS)
    listen(child, lambda: child.listened - child.started > 0.3)
    assert child.silence == 0.0  # a side that begins may be silent
    assert child.hangs() == ""
    monkeypatch.setattr(children, "BEGINNING", 0.2)
    assert child.hangs() == "has not begun within 0.2 s"
    beating = begin(BEATS.replace("COUNT", "600"))
    listen(beating, lambda: beating.begun is not None)
    monkeypatch.setattr(children, "PATIENCE", 0.5)
    beating.lasts = 0.1
    assert beating.hangs() == ""
    listen(beating, beating.hangs)
    assert beating.hangs() == "hangs: it has not ended 0.5 s after its duration"


def test_one_that_compiles_is_not_killed_for_it(begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "BEGINNING", 0.5)
    child = begin(BEATS.replace("COUNT", "20").replace(repr(BEAT), repr(COMPILING)))
    end = time.monotonic() + 20.0
    listen(child, lambda: child.compiles)
    while child.compiled - child.started < 1.5:  # three times as long as a side may take that does not compile
        assert time.monotonic() < end
        child.listen()
        assert child.hangs() == ""
        time.sleep(0.02)
    assert child.begun is None
    listen(child, child.hangs)
    assert child.hangs() == "has not begun within 0.5 s"


def test_who_does_not_end_is_killed_and_nobody_waits_longer(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "PATIENCE", 1.0)
    leader, follower = begin(STAYS), begin(BEATS.replace("COUNT", "3"), "follower")
    assert leader.process.stdout is not None
    assert select.select([leader.process.stdout], [], [], 20.0)[0]  # it ignores the signal by now
    begun = time.monotonic()
    assert end_session([follower, leader]) == [leader]
    assert time.monotonic() - begun < 4.0
    assert leader.process.returncode == -signal.SIGKILL
    assert follower.process.returncode == -signal.SIGTERM


def test_a_follower_that_did_not_hear_the_leader_s_last_word_is_told_and_may_unload(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hears none of a leader that never had control. Told by signal, it has the time that its end may take."""
    monkeypatch.setattr(children, "GOING", 0.5)
    unloads = "signal.signal(signal.SIGTERM, lambda *_: (time.sleep(1.0), sys.exit()))\n"
    follower = begin(f"import signal, sys, time\n{unloads}{BEATS.replace('COUNT', '600')}", "follower")
    leader = begin("import sys, time\ntime.sleep(0.2)\nsys.exit()")
    listen(follower, lambda: follower.begun is not None)
    begun = time.monotonic()
    assert end_session([follower, leader]) == []
    assert follower.process.returncode == 0
    assert time.monotonic() - begun < children.PATIENCE
    assert children.PATIENCE > LEAVING + HANGS_AFTER  # its robot unloads, then the driver of that hangs


def test_a_leader_that_is_ending_keeps_its_exit_code(begin: Callable[..., Child]) -> None:
    leader, follower = begin("import sys, time\ntime.sleep(1.0)\nsys.exit(1)"), begin("", "follower")
    listen(follower, lambda: not follower.running)
    assert end_session([follower, leader]) == []
    assert leader.process.returncode == 1


# --- what a console chooses: what comes of it, what is refused, and who hears it --------------------------------------


def choice(**chosen: str) -> Choice:
    return Choice(VERSION, 1, 1, **chosen)


def test_what_is_chosen_is_in_the_settings_the_rest_stays_and_what_another_setting_forbids_is_refused() -> None:
    before = SessionSettings(seed=4, force_delay=0.2)
    after = choose(before, choice(material="bone", grip="soft"))
    assert (after.material, after.grip, after.operator) == ("bone", "soft", before.operator)
    assert (after.seed, after.force_delay) == (4, 0.2)
    assert choose(before, choice(record="start")) == before
    with pytest.raises(SettingError, match="choose a grip"):
        choose(SessionSettings(grip="soft", largest_stiffness=500.0), choice(grip="none"))


@pytest.mark.parametrize("chosen", [{"material": "jelly"}, {"operator": "nobody"}, {"grip": "iron"}])
def test_a_name_that_there_is_not_is_refused(chosen: dict[str, str]) -> None:
    with pytest.raises(UnknownNameError):
        choose(SessionSettings(), choice(**chosen))


def test_faults_that_were_set_stay_for_processes_that_begin_anew() -> None:
    faults = Settings(VERSION, 1, 1, 0.05, 0.6, 0.01, 0.2, 0.5)
    after = with_faults(SessionSettings(material="bone"), faults)
    delays = (after.position_delay, after.force_delay)
    assert (*delays, after.jitter, after.loss, after.outage) == (0.05, 0.6, 0.01, 0.2, 0.5)
    bursts = SessionSettings(burst=2.0)  # at most two thirds of the messages can be lost in such bursts
    assert with_faults(bursts, Settings(VERSION, 1, 1, 0.0, 0.0, 0.0, 0.9, 0.0)) == bursts


@pytest.fixture
def desk() -> Iterator[tuple[Desk, ZenohLink]]:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=["hello"]) as console:
        there = Desk(ZenohLink(connect=[endpoint], subscribe=CHOICE_CHANNELS))
        until(lambda: (there.say_now(), console.take("hello"))[1])
        yield there, console
        there.close()


def test_the_desk_hears_choices_and_says_what_runs(desk: tuple[Desk, ZenohLink]) -> None:
    there, console = desk
    console.publish(choice(material="bone"))
    console.publish(choice(record="stop"))
    received: list[Choice] = []
    until(lambda: (received.extend(there.hear()), len(received) == 2)[1])
    assert [(one.material, one.record) for one in received] == [("bone", ""), ("", "stop")]
    console.publish(Settings(VERSION, 1, 1, 0.0, 0.5))
    until(lambda: (there.hear(), there.faults is not None)[1])
    assert there.faults is not None
    assert there.faults.force_delay == 0.5
    there.recording, there.refused = "a.mcap", "no such thing"
    console.take("hello")
    there.say()  # not yet: it spoke just now
    there.say_now()
    output: list[Hello] = []
    until(lambda: (output.extend(hello for _, hello in console.take("hello")), output)[1])
    texts = dict(zip(output[-1].names, output[-1].values, strict=True))
    assert output[-1].role == SUPERVISOR
    assert (texts["recording"], texts["refused"], texts["supervised"]) == ("a.mcap", "no such thing", "yes")


def test_the_desk_hears_of_the_end_while_no_leader_does(desk: tuple[Desk, ZenohLink]) -> None:
    there, console = desk
    there.hear()
    assert there.ended == math.inf
    console.publish(Stop(VERSION, 1, 1, "ended in the console"))
    until(lambda: (there.hear(), there.ended < math.inf)[1])
    first = there.ended
    console.publish(Stop(VERSION, 2, 1, "again"))
    time.sleep(0.2)
    there.hear()
    assert there.ended == first


def test_an_emergency_stop_latches_at_once_and_until_the_follower_says_otherwise(desk: tuple[Desk, ZenohLink]) -> None:
    there, console = desk
    assert not there.latched
    console.publish(EmergencyStop(VERSION, 1, 1, "pressed", 7))
    until(lambda: (there.hear(), there.latched)[1])
    console.publish(Hello(VERSION, 1, 1, "follower", ("stopped",), ("pressed",)))
    time.sleep(LATCHING + 0.2)
    there.hear()
    assert there.latched
    console.publish(Hello(VERSION, 2, 1, "follower", ("stopped",), ("",)))
    until(lambda: (there.hear(), not there.latched)[1])


LOOP = "import signal, sys, time; signal.signal(signal.SIGHUP, {}); print('ready', flush=True); time.sleep(60)"
STUBBORN, GOOD = LOOP.format("signal.SIG_IGN"), LOOP.format("lambda *_: sys.exit(0)")


def child(program: str, role: str = "leader") -> Child:
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    return Child(role, process)


def test_who_is_retired_ends_by_himself_or_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foretouch.session.runners.children.PATIENCE", 0.5)
    rounds: list[int] = []
    good, stubborn = child(GOOD), child(STUBBORN, "follower")
    retire([good, stubborn], meanwhile=lambda: rounds.append(1))
    assert good.process.returncode == 0
    assert stubborn.process.returncode == -signal.SIGKILL
    assert len(rounds) > 3  # what does not wait goes on meanwhile
    last = child(STUBBORN)
    end_session([last])
    assert last.process.returncode == -signal.SIGTERM


def test_who_is_told_to_begin_anew_is_to_say_no_stop() -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2)
    handlers = {number: signal.getsignal(number) for number in numbers}
    try:
        stop = StopFlag().on_signals()
        signal.raise_signal(signal.SIGHUP)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert stop.quiet
    assert stop.reason
