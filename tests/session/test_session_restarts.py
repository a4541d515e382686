"""Sides that end and begin again, leaders that want the same robot, and the emergency stop: by steps alone."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from lap import Lap

from foretouch.messages import Status, Telemetry

RARER = [
    pytest.param(kind, marks=pytest.mark.long) for kind in ("dropout", "stuck", "saturated", "spikes", "encoder-jump")
]
"""Faults of a sensor that `make test` leaves to the tests of the watch."""

GRIP_OR_NONE = pytest.mark.parametrize("grip", [pytest.param("none", marks=pytest.mark.long), "normal"])


def statuses(said: list[Telemetry]) -> list[Status]:
    return [Status(status) for status, _ in itertools.groupby(one.status for one in said)]


def pressing(lap: Lap, name: str = "anna", epoch: int = 11, *, seconds: float = 3.0) -> None:
    lap.start_leader(name, epoch)
    lap.run(seconds)
    for _ in range(400):
        if lap.run(0.01)[-1].force > 1.0:
            return
    raise AssertionError("nothing was pressed")


@pytest.mark.long
@GRIP_OR_NONE
def test_a_leader_that_dies_leaves_a_robot_that_holds_and_unloads_and_comes_back_slowly(grip: str) -> None:
    """To its end also where the playout leads the way: nothing is followed quickly before it was kept up with."""
    lap = Lap(grip=grip)
    pressing(lap)
    one = lap.leaders.pop()
    output = lap.run(3.0)
    assert [one for one in statuses(output) if one is not Status.GUARDED] == [
        Status.FOLLOWING,
        Status.HOLDING,
        Status.UNLOADING,
    ]
    silent = [one.status for one in output].index(Status.HOLDING)
    assert 50 <= silent <= 80  # what was on its way counts
    assert max(lap.forces[-1000:]) < 1.0
    begun = len(lap.telemetry)
    lap.leaders.append(one)
    output = lap.run(1.5)
    inwards = np.diff([telemetry.desired_position for telemetry in lap.telemetry[begun - 1 : begun + 300]])
    assert inwards.max() <= 0.05e-3 + 1e-9
    assert Status.FOLLOWING in statuses(output)


@GRIP_OR_NONE
@pytest.mark.long
def test_its_next_start_has_control_and_a_model_within_a_second(grip: str) -> None:
    lap = Lap(grip=grip)
    pressing(lap)
    lap.leaders.clear()
    lap.run(1.5)
    again = lap.start_leader("anna", 12)
    lap.run(1.0)
    assert lap.following.lease.epoch == 12
    assert again.state.follower_view.in_control
    assert again.state.renderer.predictor.model is not None
    assert again.records[-1].engaged
    before = len(lap.forces)
    lap.run(3.5)
    rendered = np.array([one.predicted_force for one in again.records[1000:]])
    assert rendered.max() == pytest.approx(max(lap.forces[before:]), rel=0.25)
    assert max(lap.forces) < 15.0


@GRIP_OR_NONE
def test_a_follower_that_begins_again_comes_slowly_and_the_leader_keeps_the_model(grip: str) -> None:
    lap = Lap(grip=grip)
    pressing(lap)
    one = lap.leaders[0]
    lap.run(0.1, follows=False)  # what is on its way still comes
    model = one.state.renderer.predictor.model
    lap.run(1.4, follows=False)
    assert one.state.renderer.predictor.model is model  # nobody said that it is wrong
    lap.start_follower(2, robot=True)
    begun = len(lap.telemetry)
    lap.run(0.05)
    assert one.state.follower_view.run == 2
    assert one.state.renderer.predictor.model is model
    assert one.state.renderer.predictor.message == 0  # the new process must not believe that its models are known
    lap.run(9.0)
    positions = np.array([message.desired_position for message in lap.telemetry[begun:]])
    returning = np.array([message.status == Status.RETURNING for message in lap.telemetry[begun:]])
    assert np.diff(positions)[returning[1:]].max(initial=0.0) <= 0.05e-3 + 1e-9
    assert one.state.renderer.predictor.message > 0
    assert one.state.inherits is not one.state.follower_view.has_relearnt
    assert one.state.follower_view.models.received > 50
    assert max(lap.forces) < 15.0
    felt = [record.rendered_force for record in one.records]
    assert np.abs(np.diff(felt)).max() <= 0.2 + 1e-9


@pytest.mark.long
def test_a_hand_that_presses_as_another_process_answers_feels_no_jump() -> None:
    lap = Lap(grip="normal")
    pressing(lap)
    one = lap.leaders[0]
    while one.records[-1].rendered_force < 1.5:
        lap.run(0.01)
    lap.start_follower(2, robot=True)
    begun = len(one.records)
    lap.run(0.2)
    felt = [record.rendered_force for record in one.records[begun - 1 :]]
    assert one.state.follower_view.run == 2
    assert felt[0] > 1.0
    assert min(felt) < 0.05  # it is elsewhere, in free air, where a map may give some millinewtons
    assert np.abs(np.diff(felt)).max() <= 0.1


def test_what_a_process_said_that_is_gone_is_left_out_however_late_it_comes() -> None:
    lap = Lap()
    pressing(lap)
    one = lap.leaders[0]
    old = lap.telemetry[-1]
    lap.start_follower(2)
    lap.run(0.2)
    count = one.state.follower_view.telemetry.received
    one.state.follower_view.take_telemetry(old)
    assert one.state.follower_view.run == 2
    assert one.state.follower_view.telemetry.received == count
    assert not one.state.follower_view.take_renewed() or lap.now < 0


@GRIP_OR_NONE
def test_a_second_leader_is_not_obeyed_and_feels_nothing_until_the_first_is_silent(grip: str) -> None:
    lap = Lap(grip=grip)
    pressing(lap)
    first, second = lap.leaders[0], lap.start_leader("bert", 7)
    lap.run(2.0)
    assert lap.following.lease.holder == "anna"
    assert first.state.follower_view.in_control
    assert not second.state.follower_view.in_control
    assert not second.state.follower_view.had_control
    assert max(one.rendered_force for one in second.records) == 0.0
    assert lap.following.lease.refused > 1500
    lap.leaders.remove(first)
    lap.run(2.0)
    assert lap.following.lease.holder == "bert"
    assert second.state.follower_view.in_control
    lap.leaders.append(first)  # it comes back as what it was
    lap.run(0.5)
    assert lap.following.lease.holder == "bert"
    assert not first.state.follower_view.in_control
    assert first.state.follower_view.had_control
    lap.run(1.0)
    assert first.records[-1].rendered_force == 0.0


@GRIP_OR_NONE
@pytest.mark.parametrize("at", ["leader", pytest.param("follower", marks=pytest.mark.long)])
def test_an_emergency_stop_latches_unloads_and_lets_the_hand_go(grip: str, at: str) -> None:
    lap = Lap(grip=grip)
    pressing(lap)
    one = lap.leaders[0]
    if at == "leader":
        one.stopping = True
        lap.run(0.02)
    lap.stop = "somebody shouted"
    output = lap.run(0.01)
    lap.release = True
    output += lap.run(0.01)
    assert lap.following.safety.stop_reason == "somebody shouted"  # a robot that moves is not released
    output += lap.run(1.98)
    one.stopping = False
    assert statuses(output)[-1] is Status.STOPPED
    assert lap.following.safety.stop_reason == "somebody shouted"
    assert max(lap.forces[-1000:]) < 1.0
    assert all(record.rendered_force == 0.0 for record in one.records[-1000:])
    assert not one.records[-1].engaged
    lap.run(0.5)
    assert lap.telemetry[-1].status == Status.STOPPED  # nobody released it
    lap.release = True
    output = lap.run(4.0)
    assert lap.following.safety.stop_reason == ""
    assert Status.FOLLOWING in statuses(output) or Status.GUARDED in statuses(output)
    assert one.records[-1].engaged
    inwards = np.diff([telemetry.desired_position for telemetry in output])
    returning = [telemetry.status == Status.RETURNING for telemetry in output[1:]]
    assert inwards[returning].max(initial=0.0) <= 0.05e-3 + 1e-9
    assert np.abs(np.diff([record.rendered_force for record in one.records])).max() <= 0.2 + 1e-9


@pytest.mark.parametrize("kind", ["nan", pytest.param("offset-step", marks=pytest.mark.long), *RARER])
def test_a_sensor_that_fails_freezes_learning_and_holds_the_robot(kind: str) -> None:
    from foretouch.robot import FaultySensor, SensorFault

    lap = Lap()
    arm = lap.robot
    # In contact a step is no other than what is pressed, and of a moving probe it shows on the way out alone.
    begins, lasts = (12.95, 3.0) if kind == "offset-step" else (8.0, 1.0)
    fault = FaultySensor(arm, SensorFault(kind, begins, begins + lasts), seed=1)
    lap.robot = fault
    lap.start_leader("anna", 3)
    lap.run(begins - 0.1)
    learnt = lap.following.learner.learnt().model
    output = lap.run(lasts + 0.1)
    bad = [one for one in output if one.validity]
    assert bad
    assert all(one.status == Status.SENSOR_FAULT for one in bad)
    assert learnt is not None
    assert max(lap.forces) < 15.0
    held = np.array([one.desired_position for one in bad])
    assert np.ptp(held[50:450]) < 1e-3  # it comes to rest and stays, and then goes out as it came
    assert np.diff(held[450:]).max() < 1e-5
    lap.run(1.0)
    lap.release = True
    output = lap.run(3.0)
    assert output[-1].validity == 0
    assert output[-1].status in (Status.FOLLOWING, Status.RETURNING)


def test_this_side_s_own_guard_is_no_leader_s_to_lift() -> None:
    lap = Lap(first_touch="guarded")
    assert lap.following.guards
    one = lap.start_leader("anna", 5)
    one.state.guarded = False  # it asks for none
    output = lap.run(3.0)
    assert any(telemetry.guarded for telemetry in output)


# --- nothing from before a release is obeyed after it -----------------------------------------------------------------


DELAYS = {"position_delay": 0.3, "force_delay": 0.2}


class Noted(Lap):
    def __init__(self, **changes: Any) -> None:
        super().__init__(**DELAYS | changes)
        self.played: list[tuple[float, int]] = []

    def _follow(self) -> Telemetry:
        newest = self.following.memory["playing"]["newest"]
        before = newest.item()
        telemetry = super()._follow()
        if newest.item() != before:  # a command has been taken to be played
            self.played.append((self.now * 1e-9, newest.item()))
        return telemetry


@pytest.mark.parametrize("baseline", ["none", pytest.param("delayed", marks=pytest.mark.long)])
def test_what_was_sent_before_a_release_was_known_is_not_obeyed_after_it(baseline: str) -> None:
    lap = Noted.led(4.0, baseline=baseline)
    lap.stop = "somebody shouted"
    lap.run(1.5)
    lap.release = True
    released = lap.now * 1e-9
    before = lap.leaders[0].state.sequence
    lap.played.clear()
    output = lap.run(3.0)
    assert output[0].status != Status.STOPPED
    # 0.2 s until the leader knows, and 0.3 s until its next command is here: not one before.
    first, sequence = lap.played[0]
    assert first - released == pytest.approx(0.5, abs=0.005)
    assert sequence - before == pytest.approx(200, abs=5)
    assert lap.following.before_release == pytest.approx(500, abs=5)
    assert output[400].status in (Status.HOLDING, Status.UNLOADING)
    told = {telemetry.desired_position for telemetry in output[1:480]}
    assert max(told) <= output[0].desired_position  # nothing led inwards meanwhile
    assert output[-1].status in (Status.FOLLOWING, Status.GUARDED, Status.RETURNING)


def test_a_leader_that_knows_another_process_of_the_follower_alone_does_not_know_of_the_release() -> None:
    lap = Noted.led(2.0)
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
    lap = Noted.led(2.0)
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
    lap = Noted.led(1.0)
    assert lap.played[0][0] < 0.31
    assert lap.following.before_release == 0
