"""Two processes, a recorder and a network that are done harm to, in real time; the long form has a file of its own."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from faults import CONNECTS, KILL, STAY
from fire import Fire

from foretouch.messages import Status
from foretouch.recordings import is_whole, read_session

pytestmark = pytest.mark.live

OFTEN = ("garbage", "leader stands still")
"""What `make test` does too."""

RARELY = [pytest.param(name, marks=pytest.mark.long) for name in STAY if name not in OFTEN]


@pytest.fixture(scope="module")
def fire(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fire]:
    made = Fire(tmp_path_factory.mktemp("fire"), "--material", "hunt-crossley", "--grip", "normal")
    yield made
    made.close()


@pytest.mark.parametrize("name", [*OFTEN, *RARELY])
def test_a_session_goes_on(fire: Fire, name: str) -> None:
    fire.pressed()
    outcome = STAY[name](fire)
    assert outcome.broken() == []
    undisturbed = name in ("garbage", "wall clock", "connects")
    assert (Status.UNLOADING in outcome.statuses) is not undisturbed
    if name == "network cut":
        assert "leader: nothing is heard of the follower" in fire.said("leader")
    if name == "garbage":
        assert outcome.grown["undecodable"] > 500
    if name == "connects":
        assert max(outcome.grown[f"{role} files"] for role in ("follower", "leader")) <= 1


@pytest.mark.long
def test_no_process_has_grown(fire: Fire) -> None:
    # A process that kept what it has for a peer, some 0.5 MB, would have grown by 50 MB; an allocator keeps some 5.
    largest = {"memory_kB": 25_000, "threads": 0, "pooled threads": 32, "files": 2}
    grown = fire.grown()
    assert len(grown) == 2 * len(largest)
    for name, more in grown.items():
        assert more <= largest[name.partition(" ")[2]], f"{name} after {CONNECTS} peers"


@pytest.mark.parametrize("name", KILL)
def test_a_session_resumes_with_another_process(fire: Fire, name: str) -> None:
    fire.pressed()
    outcome = KILL[name](fire)
    assert outcome.broken() == []
    assert Status.RETURNING in outcome.statuses


def test_ctrl_c_ends_all_of_it_cleanly_and_the_recording_is_whole(fire: Fire) -> None:
    fire.signal("leader", signal.SIGINT)
    for role, process in fire.processes.items():
        assert process.wait(20) == 0, fire.said(role)
        assert "Traceback" not in fire.said(role)
    for role in ("follower", "leader"):
        lines = [line for line in fire.said(role).splitlines() if "did not decode and were dropped" in line]
        assert 1 <= len(lines) <= 8  # once a second, not once a message
    assert is_whole(fire.recording)
    log = read_session(fire.recording)
    assert log.counts["recorder_dropped"] == 0
    # Who stood still for longer than the network waits is connected anew; what is missing is counted.
    # The last of each side has no successor by which its absence would be noticed.
    assert fire.not_recorded(log) - 2 <= log.counts["recorder_missed"] < 1000
