"""The gamepad's handle, over a pad whose stick the test holds; and pygame itself, where there is no pad."""

from __future__ import annotations

import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.devices import Reach
from foretouch.devices.gamepad import DEAD_ZONE, LARGEST_SPEED, STICK_SPEED, TRIGGER_REACH, Gamepad, PadState, PygamePad
from foretouch.errors import SettingError
from foretouch.session.conformance.device_checks import check_device
from foretouch.session.conformance.finding import failed

TICK_NS = 1_000_000


class HeldPad:
    """A pad in the test's hand."""

    def __init__(self, stick: float = 0.0, trigger: float = 0.0) -> None:
        self.shows: PadState | None = PadState(stick, trigger, False)
        self.rumbles: list[float] = []
        self.closed = 0

    def state(self) -> PadState | None:
        return self.shows

    def rumble(self, strength: float) -> None:
        self.rumbles.append(strength)

    def close(self) -> None:
        self.closed += 1


def run(device: Gamepad, seconds: float, begin: float = 0.0) -> np.ndarray:
    first = round(begin * 1000)
    return np.array([device.read((first + tick) * TICK_NS) for tick in range(round(seconds * 1000))])


def test_the_stick_moves_the_handle_by_rate() -> None:
    pad = HeldPad(stick=1.0)
    device = Gamepad(pad)
    position = run(device, 1.0)
    speed = np.diff(position)[-100:].mean() * 1000.0
    assert speed == pytest.approx(STICK_SPEED, rel=1e-3)
    # A critically damped second-order lag follows a ramp 2 / omega late.
    assert position[-1] == pytest.approx(STICK_SPEED * (0.999 - 2.0 / 60.0), rel=1e-3)
    half = DEAD_ZONE + 0.5 * (1.0 - DEAD_ZONE)
    pad.shows = PadState(-half, 0.0, False)
    back = run(device, 0.5, 1.0)
    assert np.diff(back)[-50:].mean() * 1000.0 == pytest.approx(-0.5 * STICK_SPEED, rel=1e-2)
    pad.shows = PadState(0.9 * DEAD_ZONE, 0.0, False)
    rest = run(device, 1.0, 1.5)
    assert np.ptp(rest[-200:]) < 1e-9


def test_the_trigger_presses_by_position_and_comes_back() -> None:
    pad = HeldPad(trigger=0.5)
    device = Gamepad(pad)
    assert run(device, 1.0)[-1] == pytest.approx(0.5 * TRIGGER_REACH, rel=1e-6)
    pad.shows = PadState(0.0, 0.0, False)
    assert run(device, 1.0, 1.0)[-1] == pytest.approx(0.0, abs=1e-9)
    known = Gamepad(HeldPad(stick=1.0, trigger=1.0), Reach(0.010, 0.009))
    assert run(known, 3.0).max() == pytest.approx(0.010 + 1.2 * 0.009, rel=1e-6)


def test_a_pad_that_is_gone_leaves_the_handle_where_it_is() -> None:
    pad = HeldPad(stick=1.0)
    device = Gamepad(pad)
    run(device, 0.5)
    device.render(5.0)
    assert pad.rumbles == [0.5]
    for shows in (None, PadState(math.nan, 0.0, True)):
        pad.shows = shows
        gone = run(device, 1.0, 0.5)
        assert np.ptp(gone[-300:]) < 1e-7
        assert device.gone
        assert not device.clutched
    device.render(5.0)
    assert pad.rumbles[-1] == 0.0


def test_a_gap_between_two_reads_counts_as_fifty_milliseconds_at_most() -> None:
    device = Gamepad(HeldPad(stick=1.0))
    before = run(device, 1.0)[-1]
    assert device.read(10**10) - before < 0.05 * LARGEST_SPEED
    assert run(device, 0.1, 10.0).max() - before < 0.05 * LARGEST_SPEED + 0.1 * STICK_SPEED


def test_the_clutch_is_a_button() -> None:
    pad = HeldPad()
    pad.shows = PadState(0.0, 0.0, True)
    device = Gamepad(pad)
    assert not device.clutched
    device.read(0)
    assert device.clutched


def test_rumble_is_a_cue_and_a_pad_is_told_seldom() -> None:
    pad = HeldPad()
    device = Gamepad(pad)
    assert not device.closed_loop
    assert device.specification is None
    for tick in range(1000):
        device.read(tick * TICK_NS)
        assert device.render(tick * 1e-2) == pytest.approx(tick * 1e-2)
    assert 10 <= len(pad.rumbles) <= 21  # every 50 ms at most
    assert np.all(np.diff(pad.rumbles) > 0.0)
    assert pad.rumbles[-1] == pytest.approx(0.95, abs=0.06)
    device.render(0.0)
    assert pad.rumbles[-1] == 0.0  # at once
    device.close()
    device.close()
    assert pad.closed == 1
    assert device.render(3.0) == 0.0
    assert pad.rumbles[-1] == 0.0


def test_a_rumble_goes_on_as_long_as_the_force_and_ends_by_itself_within_a_second() -> None:
    pad = HeldPad()
    device = Gamepad(pad)
    for tick in range(3000):
        device.read(tick * TICK_NS)
        device.render(4.0)
    assert pad.rumbles == [0.4] * len(pad.rumbles)
    assert 6 <= len(pad.rumbles) <= 7  # each lasts for a second
    asked: list[tuple[float, float, int]] = []
    pygame_pad = PygamePad.__new__(PygamePad)  # over a stand-in of pygame's controller
    pygame_pad._controller = SimpleNamespace(rumble=lambda *told: asked.append(told))
    pygame_pad.rumble(0.4)
    assert asked == [(0.4, 0.4, 1000)]


@settings(max_examples=60, deadline=None)
@given(
    shown=st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-1.0, 2.0), st.integers(1, 200)), min_size=1, max_size=12)
)
def test_whatever_the_pad_shows_the_motion_is_smooth_and_within_reach(shown: list[tuple[float, float, int]]) -> None:
    pad = HeldPad()
    device = Gamepad(pad, Reach(0.010, 0.009))
    positions, tick = [], 0
    for stick, trigger, count in shown:
        pad.shows = PadState(stick, trigger, False)
        for _ in range(count):
            positions.append(device.read(tick * TICK_NS))
            tick += 1
    moved = np.array(positions)
    assert moved.min() >= -1e-12
    assert moved.max() <= 0.010 + 1.2 * 0.009 + 1e-9
    assert np.abs(np.diff(moved, prepend=0.0)).max() <= 0.2e-3 + 1e-9


def test_it_passes_the_checks_of_every_device() -> None:
    findings = check_device(lambda: Gamepad(HeldPad(stick=0.4, trigger=0.3)), name="gamepad", watched=1.0)
    assert failed(findings) == []
    # Whether force pushes the hand out nobody can see without a hand.
    assert [finding.check for finding in findings if finding.passed is None] == ["sign of force"]


@pytest.mark.long
def test_without_a_pad_pygame_says_so_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.joystick.init()
    there = pygame.joystick.get_count()
    pygame.joystick.quit()
    if there:
        pytest.skip("there is a pad")
    done = subprocess.run(
        [sys.executable, "-m", "foretouch", "plugins", "check", "gamepad"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("foretouch: operator = 'gamepad': no gamepad is connected: plug one in")


def test_a_reach_that_is_no_place_is_refused() -> None:
    with pytest.raises(SettingError, match="press_depth"):
        Gamepad(HeldPad(), Reach(0.01, -1.0))
