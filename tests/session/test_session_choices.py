"""What a console chooses: what comes of it, what is refused, and who hears it."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from foretouch.errors import SettingError, UnknownNameError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Choice, EmergencyStop, Hello, Settings, Stop
from foretouch.session import SessionSettings, StopFlag
from foretouch.session.processes.children import (
    CHOICE_CHANNELS,
    LATCHING,
    SUPERVISOR,
    Child,
    Desk,
    choose,
    end_session,
    retire,
    with_faults,
)


def choice(**chosen: str) -> Choice:
    return Choice(VERSION, 1, 1, **chosen)


def test_what_is_chosen_is_in_the_settings_and_the_rest_stays() -> None:
    before = SessionSettings(seed=4, force_delay=0.2)
    after = choose(before, choice(material="bone", grip="soft"))
    assert (after.material, after.grip, after.operator) == ("bone", "soft", before.operator)
    assert (after.seed, after.force_delay) == (4, 0.2)
    assert choose(before, choice(record="start")) == before


@pytest.mark.parametrize("chosen", [{"material": "jelly"}, {"operator": "nobody"}, {"grip": "iron"}])
def test_a_name_that_there_is_not_is_refused(chosen: dict[str, str]) -> None:
    with pytest.raises(UnknownNameError):
        choose(SessionSettings(), choice(**chosen))


def test_a_choice_that_another_setting_forbids_is_refused() -> None:
    with pytest.raises(SettingError, match="choose a grip"):
        choose(SessionSettings(grip="soft", largest_stiffness=500.0), choice(grip="none"))


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


def until(condition: Callable[[], object], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)


def test_the_desk_hears_choices_and_says_what_runs(desk: tuple[Desk, ZenohLink]) -> None:
    there, console = desk
    console.publish(choice(material="bone"))
    console.publish(choice(record="stop"))
    heard: list[Choice] = []
    until(lambda: (heard.extend(there.hear()), len(heard) == 2)[1])
    assert [(one.material, one.record) for one in heard] == [("bone", ""), ("", "stop")]
    console.publish(Settings(VERSION, 1, 1, 0.0, 0.5))
    until(lambda: (there.hear(), there.faults is not None)[1])
    assert there.faults is not None
    assert there.faults.force_delay == 0.5
    there.recording, there.refused = "a.mcap", "no such thing"
    console.take("hello")
    there.say()  # not yet: it spoke just now
    there.say_now()
    said: list[Hello] = []
    until(lambda: (said.extend(hello for _, hello in console.take("hello")), said)[1])
    texts = dict(zip(said[-1].names, said[-1].values, strict=True))
    assert said[-1].role == SUPERVISOR
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
    monkeypatch.setattr("foretouch.session.processes.children.PATIENCE", 0.5)
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
