"""Sessions whose sides ended and began again: what belongs together, and what was said of it all."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.messages import (
    COUNT_PREFIX,
    NEWS,
    PROCESS,
    VERSION,
    Hello,
    Hellos,
    LeaderState,
    ModelUpdate,
    SessionLog,
    Telemetry,
    split_texts,
)

MS = 1_000_000


def led(tick: int, sequence: int, epoch: int, run: int) -> LeaderState:
    return LeaderState(
        VERSION, sequence, tick * MS, 1.0 * epoch, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, False, 0, 0, epoch=epoch, run=run
    )


def followed(tick: int, sequence: int, command: int, epoch: int, run: int) -> Telemetry:
    place = (0.0, 1.0 * epoch, 0.0, 0.0, 0.0, 0.0)
    return Telemetry(VERSION, sequence, tick * MS, command, *place, False, False, 0, 0, 0, epoch=epoch, run=run)


def model(sequence: int, epoch: int, run: int) -> ModelUpdate:
    return ModelUpdate(VERSION, sequence, 0, 0, "", (), (), 0.0, False, "", "", b"", epoch, run)


def session() -> SessionLog:
    leader = [led(tick, tick, 5, 1 if tick > 10 else 0) for tick in range(1, 101)]
    for tick in range(101, 401):
        run = 0 if tick <= 110 else 1 if tick < 290 else 2
        leader.append(led(tick, tick - 100, 7, run))
    follower = []
    for tick in (*range(1, 251), *range(280, 401)):
        run = 1 if tick <= 250 else 2
        late = tick - 10
        epoch = 0 if late < 1 or (run == 2 and tick < 285) else 5 if late <= 100 else 7
        command = 0 if epoch == 0 else late if epoch == 5 else late - 100
        follower.append(followed(tick, tick if run == 1 else tick - 279, command, epoch, run))
    models = [model(1, 0, 1), model(2, 5, 1), model(3, 7, 1), model(1, 0, 2), model(2, 7, 2)]
    return SessionLog.from_messages([*leader, *follower, *models], {"material": "foam"}, {"late": 1})


def test_each_segment_has_one_process_of_either_side() -> None:
    log = session()
    parts = log.segments()
    assert [(part.leader["epoch"][0], part.follower["run"][0]) for part in parts] == [(5, 1), (7, 1), (7, 2)]
    for part in parts:
        assert np.unique(part.leader["epoch"]).size == np.unique(part.follower["run"]).size == 1
    assert sum(part.leader.size for part in parts) == log.leader.size
    assert sum(part.follower.size for part in parts) == log.follower.size
    assert [[one.sequence for one in part.models] for part in parts] == [[1, 2], [3], [1, 2]]
    assert all(part.settings == log.settings and part.counts == log.counts for part in parts)


def test_what_is_said_before_the_other_side_is_heard_belongs_to_what_follows() -> None:
    first, second, third = session().segments()
    assert first.leader["run"][0] == 0 == first.follower["epoch"][0]
    assert second.leader["sequence"][0] == 1
    assert third.follower["sequence"][0] == 1
    assert third.follower["epoch"][0] == 0


def test_numbers_of_different_processes_are_not_paired() -> None:
    log = session()
    rows = log.rows()
    assert (rows.leader["epoch"] == rows.follower["epoch"]).all()
    assert (rows.leader["position"] == rows.follower["position"]).all()
    assert rows.leader.size > 300
    assert rows.never_applied == log.leader.size - rows.leader.size


def test_the_longest_is_where_both_were_there() -> None:
    log = session()
    longest = log.longest()
    assert (longest.leader["epoch"][0], longest.follower["run"][0]) == (7, 1)
    alone = np.concatenate([log.leader, np.zeros(5000, log.leader.dtype)])
    alone["epoch"][log.leader.size :] = 9  # a leader that nobody obeys, for longer than all others
    alone["sequence"][log.leader.size :] = np.arange(1, 5001)
    alone["time_ns"][log.leader.size :] = np.arange(5000) * MS
    alone["run"][log.leader.size :] = 1
    other = SessionLog(alone, log.follower, log.models)
    assert other.longest().leader["epoch"][0] == 7
    assert other.rows().leader.size == log.rows().leader.size


@pytest.mark.parametrize("epoch", [0, 3])
@pytest.mark.parametrize("run", [0, 4])
def test_a_session_without_a_restart_is_its_own_segment(epoch: int, run: int) -> None:
    leader = [led(tick, tick, epoch, run if tick > 5 else 0) for tick in range(1, 50)]
    follower = [followed(tick, tick, tick, epoch if tick > 5 else 0, run) for tick in range(1, 50)]
    log = SessionLog.from_messages([*leader, *follower, model(1, epoch, run)])
    assert log.segments() == (log,)
    assert log.longest() is log
    assert log.rows().leader.size == 49


def test_a_side_that_never_heard_the_other_is_where_it_was_heard() -> None:
    leader = [led(tick, tick, 3, 0) for tick in range(1, 50)]  # nothing comes back
    follower = [followed(tick, tick, tick, 3, 4) for tick in range(1, 50)]
    log = SessionLog.from_messages([*leader, *follower])
    assert log.segments() == (log,)
    strangers = [followed(tick, tick, 0, 0, 4) for tick in range(1, 50)]
    apart = SessionLog.from_messages([*leader, *strangers])
    assert apart.segments() == (apart,)
    empty = SessionLog.from_messages([])
    assert empty.longest() is empty
    assert empty.rows().leader.size == 0


def hello(role: str, process: str, **texts: str) -> Hello:
    texts = {PROCESS: process, **texts} if process else texts
    return Hello(VERSION, 1, 0, role, tuple(texts), tuple(texts.values()))


def test_counters_of_all_processes_are_summed() -> None:
    hellos = Hellos()
    lost = COUNT_PREFIX + "commands_lost"
    for process, count in (("1", 3), ("1", 10), ("2", 0), ("2", 4)):
        hellos.take(hello("follower", process, **{lost: str(count)}))
    hellos.take(hello("leader", "9", **{COUNT_PREFIX + "models_lost": "2", "material": "foam"}))
    assert hellos.counts == {"commands_lost": 14, "models_lost": 2}
    assert hellos.settings == {"material": "foam"}


def test_news_are_kept_once_each_and_are_no_settings() -> None:
    hellos = Hellos()
    for holder in ("", "anna", "anna", "bert", "anna"):
        hellos.take(hello("follower", "1", control=holder, trouble="", stopped=""))
    assert hellos.news == {"control": ("anna", "bert")}
    assert hellos.settings == {}
    assert split_texts({**dict.fromkeys(NEWS, "said"), PROCESS: "1", "seed": "2"}) == ({"seed": "2"}, {})


@pytest.mark.parametrize("role", ["recorder", "leader", "supervisor"])
def test_who_says_hello_without_end_takes_nobody_the_place(role: str) -> None:
    hellos, received = Hellos(), COUNT_PREFIX + "commands_received"
    for number in range(1000):
        hellos.take(hello(role, str(number), **{"contest": f"invented {number}", COUNT_PREFIX + "sent": "1"}))
    hellos.take(hello("follower", "7", **{"contest": "CONTROL TAKEN: bert has it", received: "55"}))
    assert hellos.news == {"contest": ("CONTROL TAKEN: bert has it",)}
    assert hellos.counts["commands_received"] == 55
    assert hellos.counts["sent"] < 100


def test_who_says_hello_without_end_fills_nothing() -> None:
    hellos = Hellos()
    for number in range(1000):
        hellos.take(hello("follower", str(number), **{COUNT_PREFIX + "sent": "1", "control": f"name {number}"}))
    assert hellos.counts["sent"] < 100
    assert len(hellos.news["control"]) < 100
    for number in range(1000):
        told = {f"name {number}": "x", COUNT_PREFIX + f"count {number}": "1"}
        hellos.take(hello("leader", "", **told))
        hellos.take(hello(f"role {number}", "", **told))
    assert len(hellos.settings) < 100
    assert len(hellos.counts) < 100
