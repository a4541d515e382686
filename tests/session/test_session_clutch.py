"""The clutch and the scales, in simulated sessions: nothing jumps, and what is commanded holds still."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from foretouch.devices import GRIPS, BrowserOperator, DeviceSpecification, Hand, ScriptedOperator
from foretouch.errors import SettingError
from foretouch.messages import SessionLog
from foretouch.rendering.mediation import LARGEST_STEP
from foretouch.session import SessionSettings, simulate


def run(duration: float, **changes: Any) -> SessionLog:
    return simulate(SessionSettings(material="hunt-crossley", grip="normal", **changes), duration=duration).log


def clutched(log: SessionLog) -> list[slice]:
    free = np.concatenate([[True], log.leader["engaged"], [True]])
    first = int(np.argmax(log.leader["engaged"]))  # before, hand and follower had not met
    starts, ends = np.flatnonzero(~free[1:] & free[:-1]), np.flatnonzero(free[1:] & ~free[:-1])
    return [slice(a, b) for a, b in zip(starts.tolist(), ends.tolist(), strict=True) if a > first]


@pytest.fixture(scope="module")
def pressed_in_contact() -> SessionLog:
    """The clutch is pressed and let go while the probe is inside, once briefly and once for a change of grasp."""
    return run(6.0, position_delay=0.02, force_delay=0.03, clutch="3.5:3.6,4.6:5.5")


def test_what_is_commanded_holds_still_and_does_not_jump_when_it_is_let_go_wherever_the_hand_went(
    pressed_in_contact: SessionLog,
) -> None:
    leader = pressed_in_contact.leader
    pauses = clutched(pressed_in_contact)
    assert len(pauses) == 2
    for pause in pauses:
        before = leader["position"][pause.start - 1]
        assert set(leader["position"][pause]) <= {before, leader["position"][pause.start]}
        assert np.ptp(leader["position"][pause]) == 0.0
        assert abs(leader["position"][pause.start] - before) < 1e-4  # as far as the hand goes in a tick
        assert np.ptp(leader["hand_position"][pause]) > 1e-4  # while the hand is free
    for pause in clutched(pressed_in_contact):
        moved = leader["hand_position"][pause.stop + 1] - leader["hand_position"][pause.stop]
        assert leader["position"][pause.stop] == pytest.approx(leader["position"][pause.stop - 1], abs=1e-12)
        assert leader["position"][pause.stop + 1] - leader["position"][pause.stop] == pytest.approx(moved, abs=1e-9)
    apart = leader["hand_position"] - leader["position"]
    _, long = clutched(pressed_in_contact)
    assert abs(apart[long.stop] - apart[long.start - 1]) > 1e-3


def test_the_force_goes_gently_and_comes_back_from_nothing(pressed_in_contact: SessionLog) -> None:
    leader = pressed_in_contact.leader
    assert (leader["energy"] >= -leader["energy_bound"] - 1e-12).all()
    force, brief, long = leader["rendered_force"], *clutched(pressed_in_contact)
    assert force[brief.start - 1] > 0.5, "the press did not come in time for the clutch"
    for pause in (brief, long):
        assert (np.abs(np.diff(force[pause.start - 1 : pause.stop])) <= LARGEST_STEP + 1e-9).all()
        assert force[pause.start + 60] < 0.01 * force[pause.start - 1]
    # Coupled again inside: the model is let in by the step limit, whatever it asks for.
    assert leader["predicted_force"][brief.stop] > 0.3
    assert force[brief.stop] <= force[brief.stop - 1] + LARGEST_STEP + 1e-9
    assert np.abs(leader["update_step"]).max() <= LARGEST_STEP + 1e-9
    assert force[brief.stop + 100] > 0.1  # as fast as the hand's own work pays for it


@pytest.mark.long
def test_the_scales_scale() -> None:
    log = run(6.0, position_delay=0.02, force_delay=0.03, position_scale=0.5, force_scale=2.0)
    leader = log.leader
    held = leader["engaged"] & (leader["rendered_share"] == 1.0)
    both = held[1:] & held[:-1]
    hand, proxy = np.diff(leader["hand_position"])[both], np.diff(leader["position"])[both]
    assert np.median(np.abs(proxy - 0.5 * hand)) < 1e-12
    felt = leader["rendered_force"] > 1.0
    assert felt.sum() > 100
    ratio = leader["rendered_force"][felt] / leader["predicted_force"][felt]
    assert np.median(ratio) == pytest.approx(2.0, abs=0.2)  # what energy holds back is missing
    assert log.follower["exact_force"].max() > 0.5


@pytest.mark.parametrize(("scale", "bound"), [(0.01, r"of 0\.15 to"), (50.0, "to 10$")])
def test_a_scale_by_which_the_operator_reaches_nothing_is_refused(scale: float, bound: str) -> None:
    with pytest.raises(SettingError, match=rf"^position_scale = {scale}: an operator of the package reaches .*{bound}"):
        run(0.01, position_scale=scale)


def test_a_clutch_at_the_mouse_is_let_go_by_silence() -> None:
    mouse = BrowserOperator(ScriptedOperator(0.01, 0.005))
    hand = Hand(mouse, GRIPS["normal"], DeviceSpecification(damping=2.0))
    hand.read(0)
    mouse.take(0.0, False, 1_000_000, clutched=True)
    hand.read(1_000_000)
    assert hand.clutched
    mouse.take(0.0, False, 900_000_000, clutched=True)
    hand.read(1_800_000_000)
    assert hand.clutched
    assert not mouse.held  # the clutch takes no handle
    hand.read(2_000_000_000)
    assert not hand.clutched
    mouse.take(0.0, False, 2_100_000_000, clutched=True)
    mouse.take(0.0, False, 2_200_000_000)
    hand.read(2_200_000_000)
    assert not hand.clutched
