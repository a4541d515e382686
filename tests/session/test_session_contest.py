"""Who else would command is told, and so is who speaks with the name of the one who does."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.link import Faults, FaultStage
from foretouch.messages import VERSION, Command, Hello
from foretouch.session.network.lease import MANY, TOLD_NS, Contest, ContestHeard, ControlLease
from foretouch.session.runners.news import leader_news
from foretouch.session.steps.follower_view import FollowerView

MS = 1_000_000


def command(holder: str, sequence: int, now_ns: int, epoch: int = 5) -> Command:
    return Command(VERSION, sequence, now_ns, 0.01, 0, False, holder, epoch)


class Follower:
    """What a follower does with commands as they arrive: the contest hears all, the lease those that are due."""

    def __init__(self, delay: float = 0.0) -> None:
        self.lease = ControlLease()
        self.contest = Contest(self.lease)
        self.stage: FaultStage[Command] = FaultStage(Faults(delay=delay))

    def tick(self, now_ns: int, *arrived: Command) -> None:
        for one in arrived:
            self.contest.hear(one, now_ns)
            self.stage.push(now_ns, one)
        for due in self.stage.pop_due(now_ns):
            self.lease.admit(due.holder, due.epoch, now_ns)


def test_one_leader_alone_is_no_contest_however_it_is_delayed_lost_and_begun_anew() -> None:
    follower, draw = Follower(0.08), random.Random(3)
    for tick in range(4000):
        now = tick * MS
        epoch, sequence = (5, tick) if tick < 1000 else (6, tick - 2500)
        if draw.random() < 0.8 and not 1000 <= tick < 2500:
            follower.tick(now, command("anna", sequence + 1, now, epoch))
        else:
            follower.tick(now)
        assert follower.contest.sentence(now) == ""


def test_another_who_would_command_is_named_while_it_asks_and_a_while_after() -> None:
    follower = Follower()
    for tick in range(1000):
        now = tick * MS
        both = [command("anna", tick + 1, now)]
        if 300 <= tick < 600:
            both.append(command("bert", tick + 1, now, 9))
        follower.tick(now, *both)
        said = follower.contest.sentence(now)
        assert bool(said) is (tick >= 300 + MANY - 1)
    assert said == "CONTROL CONTESTED: bert would command too, and is not obeyed: anna holds control"
    assert follower.contest.sentence(600 * MS + TOLD_NS + MS) == ""


def test_another_process_of_the_same_name_is_told_from_a_collision() -> None:
    follower = Follower()
    for tick in range(300):
        follower.tick(tick * MS, command("anna", tick + 1, tick * MS), command("anna", tick + 1, tick * MS, 7))
    said = "CONTROL CONTESTED: another process of that name would command too, and is not obeyed: anna holds control"
    assert follower.contest.sentence(300 * MS) == said


def test_a_few_of_another_are_no_contest() -> None:
    follower = Follower()
    for tick in range(300):
        late = [command("anna", 9000 + tick, tick * MS, 4)] if tick in range(100, 100 + MANY - 1) else []
        follower.tick(tick * MS, command("anna", tick + 1, tick * MS), *late)
        assert follower.contest.sentence(tick * MS) == ""


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    st.integers(-2000, 20_000),
    st.sampled_from([1, 2, 7, 1000]),
    st.sampled_from([1, 2, 3, 10, 400]),
    st.booleans(),
)
def test_whatever_numbers_an_impostor_takes_they_collide(ahead: int, step: int, every: int, first: bool) -> None:
    """Name, epoch and clock are copied; numbers run ahead or behind, evenly or in leaps, seldom or often."""
    follower, said = Follower(), ""
    for tick in range(1000):
        now = tick * MS
        arrived = [command("leader", tick + 1, now)]
        if tick >= 500 and tick % every == 0:
            forged = command("leader", max(1, tick + 1 + ahead + step * (tick - 500)), now)
            arrived.insert(0 if first else 1, forged)
        follower.tick(now, *arrived)
        said = said or follower.contest.sentence(now)
    assert said.startswith("CONTROL CONTESTED: two command as leader, ")


def test_control_that_another_has_taken_is_told() -> None:
    follower, now = Follower(), 0
    for tick in range(1000):
        follower.tick(now := tick * MS, command("anna", tick + 1, now))
    for tick in range(2100, 2200):
        follower.tick(now := tick * MS, command("bert", tick + 1, now, 9))
    assert follower.contest.sentence(now) == "CONTROL TAKEN: bert has it, since anna had been silent for 1 s"
    follower.tick(now + TOLD_NS + 200 * MS, command("bert", 2201, now, 9))
    assert follower.contest.sentence(now + TOLD_NS + 200 * MS) == ""


@pytest.mark.parametrize("trouble", ["", "the robot holds its place"])
def test_the_operator_is_told_what_the_follower_tells_of_a_contest(trouble: str) -> None:
    said = leader_news(FollowerView(5), {"contest": "CONTROL CONTESTED: bert would", "trouble": trouble})
    assert said == "CONTROL CONTESTED: bert would" + (f"; {trouble}" if trouble else "")


def test_who_listens_says_a_contest_once_each_time_it_changes() -> None:
    said: list[str] = []
    heard, child = ContestHeard("recorder", said.append), ContestHeard("recorder", said.append, parent=1)
    for role, contest in (("leader", "x"), ("follower", "A"), ("follower", "A"), ("follower", ""), ("follower", "A")):
        for one in (heard, child):
            one.hear(Hello.of(role, 1, 0, {"contest": contest}))
    assert said == ["recorder: A", "recorder: A"]
