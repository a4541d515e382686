"""Nothing from before a release is obeyed after it, also what was under way: an acknowledgement tells which that is."""

from __future__ import annotations

from typing import Any

import pytest
from lap import Lap

from foretouch.messages import Status

DELAYS = {"position_delay": 0.3, "force_delay": 0.2}


class Noted(Lap):
    def __init__(self, **changes: Any) -> None:
        super().__init__(**DELAYS | changes)
        self.played: list[tuple[float, int]] = []

    def start_follower(self, run: int, *, robot: bool = False) -> None:
        super().start_follower(run, robot=robot)
        playout = self.following.playout
        push = playout.push

        def noted(sequence: int, position: float, place: tuple[float, ...] = ()) -> None:
            self.played.append((self.now * 1e-9, sequence))
            push(sequence, position, place)

        self.following.playout = type("Noted", (), {})()
        self.following.playout = _Playout(playout, noted)  # type: ignore[assignment]


class _Playout:
    def __init__(self, playout: Any, push: Any) -> None:
        self._playout, self.push = playout, push

    def __getattr__(self, name: str) -> Any:
        return getattr(self._playout, name)


@pytest.mark.parametrize("baseline", ["none", "delayed"])
def test_what_was_sent_before_a_release_was_known_is_not_obeyed_after_it(baseline: str) -> None:
    lap = Noted(baseline=baseline)
    lap.start_leader("anna", 11)
    lap.run(4.0)
    lap.stop = "somebody shouted"
    lap.run(1.5)
    lap.release = True
    released = lap.now * 1e-9
    before = lap.leaders[0].state.sequence
    lap.played.clear()
    said = lap.run(3.0)
    assert said[0].status != Status.STOPPED
    # 0.2 s until the leader knows, and 0.3 s until its next command is here: not one before.
    first, sequence = lap.played[0]
    assert first - released == pytest.approx(0.5, abs=0.005)
    assert sequence - before == pytest.approx(200, abs=5)
    assert lap.following.before_release == pytest.approx(500, abs=5)
    assert said[400].status in (Status.HOLDING, Status.UNLOADING)
    told = {telemetry.desired_position for telemetry in said[1:480]}
    assert max(told) <= said[0].desired_position  # nothing led inwards meanwhile
    assert said[-1].status in (Status.FOLLOWING, Status.GUARDED, Status.RETURNING)


def test_a_leader_that_knows_another_process_of_the_follower_alone_does_not_know_of_the_release() -> None:
    lap = Noted()
    lap.start_leader("anna", 11)
    lap.run(2.0)
    lap.start_follower(2)  # its telemetry counts from 1, and commands that acknowledge thousands are under way
    lap.run(1.0)
    lap.stop = "somebody shouted"
    lap.run(0.05)
    lap.release = True
    lap.run(0.001)
    lap.played.clear()
    lap.run(0.1)
    assert lap.following.safety.stop_reason == ""
    assert lap.played == []


def test_a_release_of_sensors_that_were_mended_is_one_too() -> None:
    lap = Noted()
    lap.start_leader("anna", 11)
    lap.run(2.0)
    for _ in range(30):
        lap.sample = lap.sample._replace(position=lap.sample.position + 0.05)  # the encoder jumps, for good
        lap.run(0.001)
    assert lap.telemetry[-1].status == Status.SENSOR_FAULT
    lap.release = True
    released = lap.now * 1e-9
    lap.run(0.001)
    lap.played.clear()
    lap.run(1.0)
    assert lap.played[0][0] - released == pytest.approx(0.5, abs=0.005)


def test_without_a_release_nothing_has_to_be_known() -> None:
    lap = Noted()
    lap.start_leader("anna", 11)
    lap.run(1.0)
    assert lap.played[0][0] < 0.31
    assert lap.following.before_release == 0
