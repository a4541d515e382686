"""The long form of what is done to two processes: every fault many times, at random moments, and the table of them."""

from __future__ import annotations

import os
import random
import signal
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest
from faults import KILL, STAY, follower_killed_behind_a_cut, leader_killed, leader_killed_as_it_starts, nothing
from fire import Fire, Outcome

from foretouch.recordings import read_session

MINUTES = float(os.environ.get("FIRE_MINUTES", "60"))
"""The faults go on for so long."""

LONGEST_WAIT = 2.5
"""A fault comes at most so long after all is well again [s]: a press and a rest."""


@pytest.mark.soak
def test_every_fault_at_random_moments(tmp_path: Path) -> None:
    chance = random.Random(20)
    outcomes: dict[str, list[Outcome]] = defaultdict(list)
    unrecorded: list[int] = []
    killed: list[float] = []
    failed: list[str] = []
    number = 0
    end = time.monotonic() + 60.0 * MINUTES
    while time.monotonic() < end:
        number += 1
        folder = tmp_path / str(number)
        folder.mkdir()
        options = ("--material", "hunt-crossley", *(("--grip", "normal") if number % 2 == 0 else ()))
        fire = Fire(folder, *options)
        try:
            for fault in faults(fire, chance):
                fire.until(fire.together, "all is well", 60.0)
                time.sleep(chance.uniform(0.0, LONGEST_WAIT))
                outcome = fault(fire)
                outcomes[outcome.fault].append(outcome)
                print(f"{outcome.fault}: {outcome.broken()}", flush=True)  # noqa: T201
            if chance.random() < 0.5:
                killed.append(recorder_killed(fire))
            else:
                unrecorded.append(ended(fire))
            fire.recording.unlink()
        except AssertionError as error:  # the next session is another one
            failed.append(str(error))
        finally:
            fire.close()
    print_table(outcomes)
    print(f"{len(unrecorded)} sessions ended: {max(unrecorded, default=0)} messages not recorded at most")  # noqa: T201
    print(f"{len(killed)} recorders killed: {max(killed, default=0.0):.2f} s lost at most")  # noqa: T201
    assert failed == []
    broken = [f"{one.fault}: {sentence}" for many in outcomes.values() for one in many for sentence in one.broken()]
    assert broken == []
    assert max(killed, default=0.0) < 1.0


def faults(fire: Fire, chance: random.Random) -> list[Callable[[Fire], Outcome]]:
    """All faults in a random order; those after which a scripted hand may not come to press again at the end."""
    last = chance.choice((KILL["follower killed"], follower_killed_behind_a_cut))
    many = [*STAY.values(), leader_killed, leader_killed_as_it_starts, nothing]
    if not fire.closed_loop:
        many += [KILL["follower killed"], follower_killed_behind_a_cut]
    chance.shuffle(many)
    return [*many, last, leader_killed]


def ended(fire: Fire) -> int:
    fire.signal("leader", signal.SIGINT)
    for role, process in fire.processes.items():
        assert process.wait(30) == 0, fire.said(role)
        assert "Traceback" not in fire.said(role)
    log = read_session(fire.recording)
    lacks = fire.not_recorded(log)
    assert lacks <= log.counts["recorder_missed"]
    return lacks


def recorder_killed(fire: Fire) -> float:
    killed_ns = time.monotonic_ns()
    fire.kill("record")
    log = read_session(fire.recording)
    assert log.counts["truncated"] == 1
    return float(killed_ns - min(log.leader["time_ns"][-1], log.follower["time_ns"][-1])) * 1e-9


def print_table(outcomes: dict[str, list[Outcome]]) -> None:
    columns = ("fault", "times", "resumed [s]", "lost", "robot [N]", "unloaded [N]", "change [N]", "error [%]")
    print("\n| " + " | ".join(columns) + " |\n" + "| --- " * len(columns) + "|")  # noqa: T201
    for fault, many in sorted(outcomes.items()):
        resumed = [one.resumed for one in many]
        errors = [one.felt_error for one in many if one.felt_error == one.felt_error]
        cells = (
            fault,
            len(many),
            f"{statistics.median(resumed):.2f}, {max(resumed):.2f}",
            sum(one.lost for one in many),
            f"{max(one.force for one in many):.1f}",
            f"{max(one.unloaded for one in many):.2f}",
            f"{max(one.change for one in many):.3f}",
            f"{statistics.median(errors):.0f}, {max(errors):.0f}" if errors else "",
        )
        print("| " + " | ".join(map(str, cells)) + " |")  # noqa: T201
