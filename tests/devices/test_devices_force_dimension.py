"""The Force Dimension device, over a stand-in of the functions of its binding: it has never met a device."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from foretouch.devices import DeviceSpecification
from foretouch.devices.device import LEAST_DAMPING
from foretouch.devices.felt import LOOKS, PATIENCE
from foretouch.devices.force_dimension import FAILURES, TICK, WATCHDOG_TICKS, ForceDimension, ForceDimensionLink
from foretouch.errors import SettingError
from foretouch.session import SAMPLE_PERIOD, SessionSettings
from foretouch.session.conformance.device_checks import check_device
from foretouch.session.conformance.finding import failed
from foretouch.session.operators import felt_device, make_operator, require_simulated_time
from foretouch.session.steps.leader import start


class Binding:
    """The functions of `forcedimension_core.dhd` that are used, over a handle that the test moves."""

    def __init__(self) -> None:
        self.place = [0.01, -0.02, 0.05]
        self.force = [0.0, 0.0, 0.0]
        self.forces: list[float] = []
        self.limit = math.nan
        self.answer = 0
        self.takes_force = True
        self.enabled = self.opened = False
        self.button = 0
        self.there = True
        self.lateness = 0.0

    def open(self) -> int:
        self.opened = self.there
        return 3 if self.there else -1

    def close(self, ID: int = -1) -> int:
        assert ID == 3
        self.opened = False
        return 0

    def enableForce(self, enable: bool, ID: int = -1) -> int:
        self.enabled = enable
        return 0 if self.takes_force else -1

    def setMaxForce(self, limit: float, ID: int = -1) -> int:
        self.limit = limit
        return 0

    def getPosition(self, out: list[float], ID: int = -1) -> int:
        time.sleep(self.lateness)
        out[:] = self.place
        return self.answer

    def setForce(self, f: list[float], ID: int = -1) -> int:
        if not self.takes_force:
            return -1
        assert self.opened
        self.force = [f[0], f[1], f[2]]
        self.forces.append(f[2])
        return 0

    def getButton(self, index: int, ID: int = -1) -> int:
        return self.button

    def errorGetLastStr(self) -> str:
        return "no device found"


SPECIFICATION = DeviceSpecification(damping=2.0, force_limit=8.0)


def held(binding: Binding, watchdog: Any = None, **line: int) -> ForceDimension:
    link = ForceDimensionLink(binding, SPECIFICATION.force_limit, watchdog)
    return ForceDimension(link, SPECIFICATION, **line)


@pytest.fixture
def binding() -> Binding:
    return Binding()


@pytest.fixture
def device(binding: Binding) -> Iterator[ForceDimension]:
    made = held(binding)
    assert made.read(0) == 0.0  # where it is at first
    yield made
    made.close()


def test_pressing_down_grows_into_the_material_from_where_the_session_begins(
    binding: Binding, device: ForceDimension
) -> None:
    binding.place = [0.3, 0.3, 0.05 - 0.012]
    assert device.read(1_000_000) == pytest.approx(0.012)
    other = held(Binding(), axis=0, direction=1)
    assert other.read(0) == 0.0
    other.close()


def test_force_pushes_the_hand_up_and_out(binding: Binding, device: ForceDimension) -> None:
    assert device.render(2.5) == 2.5
    assert binding.force == [0.0, 0.0, 2.5]
    assert device.render(-1.0) == -1.0  # draws the hand in
    assert binding.force == [0.0, 0.0, -1.0]


def test_the_limit_is_kept_here_and_in_the_sdk(binding: Binding, device: ForceDimension) -> None:
    assert binding.limit == 8.0
    assert device.render(1e9) == 8.0
    assert binding.force[2] == 8.0
    assert device.render(math.nan) == 0.0
    assert binding.force[2] == 0.0


def test_a_device_that_is_unplugged_shows_no_position_and_gives_no_force(
    binding: Binding, device: ForceDimension
) -> None:
    binding.place[2] = 0.03
    assert device.read(0) == pytest.approx(0.02)
    device.render(3.0)
    binding.answer = -1
    binding.place[2] = -5.0
    for tick in range(FAILURES - 1):
        assert math.isnan(device.read(tick))  # who renders is told that nobody knows
        assert not device.lost
    assert device.render(3.0) == 3.0  # one read that failed is no reason to let a hand fall
    assert math.isnan(device.read(100))
    assert device.lost
    assert device.render(3.0) == 0.0
    assert binding.force[2] == 0.0
    binding.answer = 0  # it is back, elsewhere: it stays dead until it is opened anew
    assert math.isnan(device.read(200))
    assert device.render(3.0) == 0.0


def test_what_is_no_number_is_a_read_that_failed(binding: Binding, device: ForceDimension) -> None:
    device.read(0)
    binding.place = [math.nan] * 3
    assert math.isnan(device.read(1))
    binding.place = [0.0, 0.0, 0.04]
    assert device.read(2) == pytest.approx(0.01)


def test_a_force_that_the_device_refuses_was_not_given(binding: Binding, device: ForceDimension) -> None:
    binding.takes_force = False
    assert device.render(3.0) == 0.0
    binding.takes_force = True


def test_where_nobody_renders_any_more_the_force_ends(binding: Binding, device: ForceDimension) -> None:
    device.render(5.0)
    end = time.monotonic() + 5.0
    while binding.force[2] != 0.0 and time.monotonic() < end:
        time.sleep(0.005)
    assert binding.force[2] == 0.0
    assert device.render(5.0) == 5.0  # and comes back with the next


def test_a_read_that_hangs_leaves_no_force_on_the_hand(binding: Binding, device: ForceDimension) -> None:
    device.render(5.0)
    binding.lateness = 0.5
    reader = threading.Thread(target=device.read, args=(1,))
    reader.start()
    end = time.monotonic() + 0.4
    while binding.force[2] != 0.0 and time.monotonic() < end:
        time.sleep(0.005)
    assert (binding.force[2], reader.is_alive()) == (0.0, True)
    reader.join()


def test_the_devices_own_watchdog_is_set() -> None:
    asked: list[tuple[int, int]] = []
    ends = {}
    for answer in (0, -1):
        device = held(Binding(), lambda *told, says=answer: (asked.append(told), says)[1])
        device.close()
        ends[answer] = device.specification.watchdog
    assert asked == [(WATCHDOG_TICKS, 3)] * 2
    assert ends == {0: 0.02, -1: PATIENCE + LOOKS}  # where the device has none, it is the driver's own
    assert pytest.approx(0.02) == WATCHDOG_TICKS * TICK
    assert WATCHDOG_TICKS < 256  # it is given in one byte


def test_close_ends_force_and_motors_once(binding: Binding) -> None:
    device = held(binding)
    device.render(4.0)
    device.close()
    assert (binding.forces[-1], binding.enabled, binding.opened) == (0.0, False, False)
    device.close()
    assert device.render(4.0) == 0.0
    assert device.read(10**12) == 0.0
    assert not device.clutched


def test_the_first_button_is_the_clutch(binding: Binding, device: ForceDimension) -> None:
    assert not device.clutched
    binding.button = 1
    assert device.clutched


def test_no_device_is_one_line(binding: Binding) -> None:
    binding.there = False
    with pytest.raises(SettingError, match=r"'force-dimension': no device of Force Dimension opens \(no device"):
        held(binding)
    binding.there, binding.answer = True, -1
    with pytest.raises(SettingError, match="shows no position"):
        held(binding)
    assert not binding.opened
    binding.answer, binding.takes_force = 0, False
    with pytest.raises(SettingError, match="takes no force"):
        held(binding)
    with pytest.raises(SettingError, match="axis"):
        held(Binding(), axis=3)
    with pytest.raises(SettingError, match="direction"):
        held(Binding(), direction=0)


def test_it_passes_the_checks_of_every_device(binding: Binding) -> None:
    class Moved(Binding):
        reads = 0

        def getPosition(self, out: list[float], ID: int = -1) -> int:
            self.reads += 1
            if self.reads % 200 == 0:
                time.sleep(0.06)  # the machine does something else for a while
            out[:] = [0.0, 0.0, -0.02 * math.sin(time.monotonic() - begun) ** 2]
            return 0

    begun = time.monotonic()
    findings = check_device(lambda: held(Moved()), name="force-dimension", watched=1.5)
    # Its hand goes on moving while the clock that it is told of goes back.
    assert [finding.check for finding in failed(findings)] == []
    assert [finding.check for finding in findings if finding.passed is None] == ["sign of force"]


def test_a_leader_renders_what_the_device_carries_and_guards_its_first_touch(device: ForceDimension) -> None:
    settings = SessionSettings(operator="force-dimension")
    state = start(settings, device=felt_device(device, settings))
    assert state.guarded
    assert state.renderer.closed_loop
    assert state.renderer.limiter.update(100.0, 1.0) <= 8.0
    with pytest.raises(SettingError, match="needs real time: foretouch teleop"):
        require_simulated_time(device)
    assert device.render(1.0) == 0.0  # it was closed


def test_damping_and_delay_that_nobody_states_are_the_worst_and_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[DeviceSpecification] = []

    def open_one(specification: DeviceSpecification) -> ForceDimension:
        opened.append(specification)
        return ForceDimension(ForceDimensionLink(Binding(), specification.force_limit), specification)

    monkeypatch.setattr("foretouch.devices.force_dimension.open_force_dimension", open_one)
    for damping, delay, taken in (
        (None, None, ("0.1 N s/m", "1 ms", "67 N/m")),
        (1.5, None, ("1 ms", "1000 N/m")),
        (None, 5e-4, ("0.1 N s/m", "100 N/m")),
        (1.5, 5e-4, ()),
    ):
        output: list[str] = []
        settings = SessionSettings(operator="force-dimension", device_damping=damping, device_delay=delay)
        make_operator(settings, surface=math.nan, press_depth=math.nan, say=output.append).close()
        assert opened[-1].damping == (LEAST_DAMPING if damping is None else damping)
        assert opened[-1].delay == (SAMPLE_PERIOD if delay is None else delay)
        assert len(output) == bool(taken)
        assert all(f" {words}" in output[0] for words in taken)


@pytest.mark.long  # a gamepad's library is missing in test_devices_gamepad
def test_without_the_sdk_the_command_ends_with_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "foretouch", "plugins", "check", "force-dimension"], capture_output=True, text=True
    )
    if done.returncode != 2:
        pytest.skip("the SDK and a device are here")
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "libdhd and libdrd" in done.stderr or "not installed" in done.stderr or "no device" in done.stderr
