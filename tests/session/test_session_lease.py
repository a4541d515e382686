"""One leader at a time, and no old one comes back."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.link import Faults, FaultStage
from foretouch.messages import VERSION, Command, Hello
from foretouch.session.network.lease import (
    LEASE,
    MANY,
    MOST_ENDED,
    TOLD_NS,
    Contest,
    ContestPrinter,
    ControlLease,
    make_epoch,
)
from foretouch.session.runners.news import leader_news
from foretouch.session.steps.follower_view import FollowerView

S = 1_000_000_000
ANY_ROUND = {
    "the first to speak has control": [("a", 5, 0.0, True)],
    "it goes on as long as it speaks": [("a", 5, 0.0, True), ("a", 5, 0.9, True), ("a", 5, 1.8, True)],
    "a second is refused": [("a", 5, 0.0, True), ("b", 9, 0.1, False), ("a", 5, 0.2, True)],
    "just before the lease ends a second is refused": [("a", 5, 0.0, True), ("b", 9, 0.999, False)],
    "after silence a second has it": [("a", 5, 0.0, True), ("b", 3, 1.0, True), ("a", 5, 1.1, False)],
    "what is refused keeps nothing alive": [("a", 5, 0.0, True), ("b", 3, 0.5, False), ("b", 3, 1.0, True)],
    "after silence and nobody else it goes on": [("a", 5, 0.0, True), ("a", 5, 12.0, True), ("b", 3, 12.5, False)],
    "its next start waits for silence too": [("a", 5, 0.0, True), ("a", 6, 0.999, False), ("a", 6, 1.0, True)],
    "and ends the one before": [("a", 5, 0.0, True), ("a", 6, 1.1, True), ("a", 5, 1.2, False), ("a", 5, 9.0, False)],
    "an older start waits for silence": [("a", 5, 0.0, True), ("a", 4, 0.1, False), ("a", 4, 1.0, True)],
    "a clock set back keeps nobody out": [("a", 5, 0.0, True), ("a", 2, 2.5, True), ("a", 5, 2.6, False)],
    "who lost control never has it again": [("a", 5, 0.0, True), ("b", 1, 3.0, True), ("a", 5, 60.0, False)],
    "but its next start may": [("a", 5, 0.0, True), ("b", 1, 3.0, True), ("a", 6, 3.9, False), ("a", 6, 4.0, True)],
    "nobody is nobody": [
        ("", 0, 0.0, False),
        ("", 5, 0.0, False),
        ("a", 0, 0.0, False),
        ("a", 5, 0.1, True),
        ("", 5, 9.0, False),
    ],
    "time that goes back frees nothing": [("a", 5, 10.0, True), ("a", 5, 1.0, True), ("b", 5, 10.9, False)],
}


@pytest.mark.parametrize("rounds", ANY_ROUND.values(), ids=ANY_ROUND.keys())
def test_who_is_let_in(rounds: list[tuple[str, int, float, bool]]) -> None:
    lease = ControlLease()
    for holder, epoch, seconds, admitted in rounds:
        now = round(seconds * S)
        assert (lease.refusal(holder, epoch, now) == "") is admitted
        assert lease.admit(holder, epoch, now) is admitted
    assert lease.refused == sum(not admitted for *_, admitted in rounds)


calls = st.lists(
    st.tuples(st.sampled_from("abc"), st.integers(1, 4), st.sampled_from([1, S // 1000, S // 2, S - 1, S, 2 * S])),
    max_size=60,
)


@settings(derandomize=True, deadline=None, max_examples=150)
@given(calls)
def test_never_two_holders_and_no_tenure_comes_back(steps: list[tuple[str, int, int]]) -> None:
    lease, now = ControlLease(), 0
    tenures: list[tuple[str, int]] = []
    received: dict[tuple[str, int], int] = {}
    for holder, epoch, passed in steps:
        now += passed
        if not lease.admit(holder, epoch, now):
            assert lease.refusal(holder, epoch, now)
            continue
        others = [moment for tenure, moment in received.items() if tenure != (holder, epoch)]
        assert all(now - moment >= LEASE * S for moment in others), "two tenures within one lease"
        received[holder, epoch] = now
        if not tenures or tenures[-1] != (holder, epoch):
            assert (holder, epoch) not in tenures, "a tenure that was over came back"
            tenures.append((holder, epoch))
        assert (lease.holder, lease.epoch) == (holder, epoch)
        assert lease.is_held(now)
        assert not lease.is_held(now + round(LEASE * S))


@settings(derandomize=True, deadline=None, max_examples=100)
@given(calls, st.sampled_from("abcd"), st.integers(5, 9))
def test_control_is_free_after_silence_whatever_was_before(
    steps: list[tuple[str, int, int]], holder: str, epoch: int
) -> None:
    lease, now = ControlLease(), 0
    for name, number, passed in steps:
        now += passed
        lease.admit(name, number, now)
    assert lease.admit(holder, epoch, now + round(LEASE * S))


def test_the_refused_are_told_who_holds_control() -> None:
    lease = ControlLease()
    lease.admit("leader.alice", 5, 0)
    assert lease.refusal("leader.bob", 6, S // 2) == (
        "leader.alice holds control: leader.bob may have it after 1 s of silence"
    )
    lease.admit("leader.bob", 6, 3 * S)
    lost = "leader.alice lost control to leader.bob: start it again to have it back"
    assert lease.refusal("leader.alice", 5, 3 * S) == lost
    assert lease.refusal("", 5, 9 * S) == "a leader without a name or an epoch is given no control"


def test_it_forgets_no_tenure_and_takes_no_more_than_it_can_remember() -> None:
    lease = ControlLease()
    for epoch in range(1, MOST_ENDED + 2):
        assert lease.admit("a", epoch, epoch * S)
    later = 2 * MOST_ENDED * S
    assert not lease.admit("a", MOST_ENDED + 2, later)
    assert not lease.admit("a", 1, later)
    assert lease.refusal("b", 1, later) == "4096 leaders have held control in turn: start the follower again"
    assert lease.admit("a", MOST_ENDED + 1, later)


@given(st.integers(1_000_000, 4 * 10**18), st.integers(0, 2**21 - 1), st.integers(1_000_000, 10**15), st.integers(0, 9))
def test_a_later_start_has_a_higher_epoch_that_a_message_can_carry(now: int, one: int, later: int, two: int) -> None:
    assert 0 < make_epoch(now, one) < make_epoch(now + later, two) < 2**63


@pytest.mark.parametrize(("wall", "bits"), [(-1, 0), (0, 0), (5 * 10**18, 0), (10**18, 2**21), (10**18, -1)])
def test_no_epoch_of_what_is_no_time(wall: int, bits: int) -> None:
    with pytest.raises(SettingError):
        make_epoch(wall, bits)


@pytest.mark.parametrize("lease", [0.0, -1.0, float("nan"), float("inf")])
def test_a_lease_lasts_for_some_time(lease: float) -> None:
    with pytest.raises(SettingError, match="must be above 0"):
        ControlLease(lease)


# --- who else would command is told, and who speaks with the name of the one who does ---------------------------------


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


def test_another_who_would_command_or_a_process_of_the_same_name_is_named_while_it_asks() -> None:
    follower = Follower()
    for tick in range(1000):
        now = tick * MS
        both = [command("anna", tick + 1, now)]
        if 300 <= tick < 600:
            both.append(command("bert", tick + 1, now, 9))
        follower.tick(now, *both)
        output = follower.contest.sentence(now)
        assert bool(output) is (tick >= 300 + MANY - 1)
    assert output == "CONTROL CONTESTED: bert would command too, and is not obeyed: anna holds control"
    assert follower.contest.sentence(600 * MS + TOLD_NS + MS) == ""
    follower = Follower()
    for tick in range(300):
        follower.tick(tick * MS, command("anna", tick + 1, tick * MS), command("anna", tick + 1, tick * MS, 7))
    output = "CONTROL CONTESTED: another process of that name would command too, and is not obeyed: anna holds control"
    assert follower.contest.sentence(300 * MS) == output


def test_a_few_of_another_are_no_contest() -> None:
    follower = Follower()
    for tick in range(300):
        late = [command("anna", 9000 + tick, tick * MS, 4)] if tick in range(100, 100 + MANY - 1) else []
        follower.tick(tick * MS, command("anna", tick + 1, tick * MS), *late)
        assert follower.contest.sentence(tick * MS) == ""


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(-2000, 20_000), st.sampled_from([1, 2, 7, 1000]), st.sampled_from([1, 2, 3, 10, 400]), st.booleans())
def test_whatever_numbers_an_impostor_takes_they_collide(ahead: int, step: int, every: int, first: bool) -> None:
    """Name, epoch and clock are copied; numbers run ahead or behind, evenly or in leaps, seldom or often."""
    follower, output = Follower(), ""
    for tick in range(1000):
        now = tick * MS
        arrived = [command("leader", tick + 1, now)]
        if tick >= 500 and tick % every == 0:
            forged = command("leader", max(1, tick + 1 + ahead + step * (tick - 500)), now)
            arrived.insert(0 if first else 1, forged)
        follower.tick(now, *arrived)
        output = output or follower.contest.sentence(now)
    assert output.startswith("CONTROL CONTESTED: two command as leader, ")


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
    output = leader_news(FollowerView(5), {"contest": "CONTROL CONTESTED: bert would", "trouble": trouble})
    assert output == "CONTROL CONTESTED: bert would" + (f"; {trouble}" if trouble else "")


def test_who_listens_says_a_contest_once_each_time_it_changes() -> None:
    output: list[str] = []
    received, child = ContestPrinter("recorder", output.append), ContestPrinter("recorder", output.append, parent=1)
    for role, contest in (("leader", "x"), ("follower", "A"), ("follower", "A"), ("follower", ""), ("follower", "A")):
        for one in (received, child):
            one.take(Hello.of(role, 1, 0, {"contest": contest}))
    assert output == ["recorder: A", "recorder: A"]
