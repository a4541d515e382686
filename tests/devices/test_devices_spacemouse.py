"""The SpaceMouse's handle, over reports that a stand-in of hidapi's device gives: no mouse was ever here."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from device_sessions import teleop
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.devices import UNKNOWN_REACH, Reach, spacemouse
from foretouch.devices.gamepad import DEAD_ZONE, LARGEST_SPEED, STICK_SPEED
from foretouch.devices.spacemouse import (
    BEGINS,
    FULL,
    GONE,
    MICE,
    SAYS,
    CapState,
    HidMouse,
    SpaceMouse,
    SpatialSpaceMouse,
    after,
    make_spacemouse,
    open_mouse,
)
from foretouch.devices.spatial import HALF_REACH
from foretouch.errors import SettingError
from foretouch.session import SessionSettings
from foretouch.session.conformance import check_device, failed

TICK_NS = 1_000_000


def pushed(right: float = 0.0, back: float = 0.0, down: float = 0.0, *, rotation: bool = False) -> list[int]:
    """A report of the cap, each -1 to 1 as the mouse counts; some mice have the rotation in the same report."""
    numbers = [round(one * FULL) for one in (right, back, down)]
    return list(struct.pack("<b3h", 1, *numbers) + (struct.pack("<3h", 300, -300, 9) if rotation else b""))


def buttons(bits: int) -> list[int]:
    return [3, *struct.pack("<I", bits)]


class Reports:
    """The functions of ``hid.device`` that are used. A cap that is pushed tells of itself every 8 ms."""

    def __init__(self) -> None:
        self.waiting: list[list[int]] = []
        self.held: list[int] | None = None
        self.there = True
        self.closed = self.reads = 0
        self.nonblocking: int | None = None

    def set_nonblocking(self, value: int) -> None:
        self.nonblocking = value

    def read(self, longest: int) -> list[int]:
        self.reads += 1
        if self.closed:
            raise ValueError("not open")
        if not self.there:
            raise OSError("read error")
        if self.held is not None and self.reads % 16 == 0:
            self.waiting.append(self.held)
        return self.waiting.pop(0) if self.waiting else []

    def close(self) -> None:
        self.closed += 1


def handle(reach: Reach = UNKNOWN_REACH) -> tuple[Reports, SpaceMouse, list[str]]:
    reports, told = Reports(), []
    return reports, SpaceMouse(HidMouse(reports), reach, told.append), told


def run(device: SpaceMouse, seconds: float, begin: float = 0.0) -> np.ndarray:
    first = round(begin * 1000)
    return np.array([device.read((first + tick) * TICK_NS) for tick in range(round(seconds * 1000))])


def test_the_cap_pushed_down_moves_the_handle_in_by_rate() -> None:
    reports, device, _ = handle()
    reports.held = pushed(down=1.0)
    position = run(device, 1.0)
    assert reports.nonblocking == 1
    assert np.diff(position)[-100:].mean() * 1000.0 == pytest.approx(STICK_SPEED, rel=1e-3)
    reports.held = pushed(down=-(DEAD_ZONE + 0.5 * (1.0 - DEAD_ZONE)), rotation=True)
    back = run(device, 0.5, 1.0)
    assert np.diff(back)[-50:].mean() * 1000.0 == pytest.approx(-0.5 * STICK_SPEED, rel=0.02)
    reports.held = pushed(right=1.0, back=1.0, down=0.9 * DEAD_ZONE)  # other axes move no line
    assert np.ptp(run(device, 1.0, 1.5)[-200:]) < 1e-9


def test_it_goes_no_further_than_a_press_and_not_out_of_its_start() -> None:
    reports, device, _ = handle(Reach(0.010, 0.009))
    reports.held = pushed(down=1.0)
    assert run(device, 3.0).max() == pytest.approx(0.010 + 1.2 * 0.009, rel=1e-6)
    reports.held = pushed(down=-1.0)
    assert run(device, 3.0, 3.0)[-1] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(SettingError, match="surface"):
        handle(Reach(-0.1, 0.009))


@pytest.mark.parametrize(
    ("report", "way"),
    [
        (pushed(right=1.0), (1.0, 0.0, 0.0)),
        (pushed(back=-1.0), (0.0, 1.0, 0.0)),
        (pushed(down=1.0), (0.0, 0.0, -1.0)),
    ],
)
def test_in_space_it_goes_where_the_cap_is_pushed(report: list[int], way: tuple[float, float, float]) -> None:
    reports = Reports()
    device = SpatialSpaceMouse(HidMouse(reports))
    assert device.read(0) == BEGINS
    reports.held = report
    place = np.array([device.read(tick * TICK_NS) for tick in range(1, 1000)])
    moved = (place[-1] - BEGINS) / np.linalg.norm(place[-1] - BEGINS)
    assert moved == pytest.approx(way, abs=1e-9)
    assert device.intention == tuple(place[-1])
    place = np.array([device.read(tick * 20 * TICK_NS) for tick in range(50, 2000)])
    assert np.abs(place).max() == pytest.approx(HALF_REACH, rel=1e-6)


def test_a_scale_makes_the_hands_way_longer_or_shorter() -> None:
    device = SpatialSpaceMouse(HidMouse(Reports()), scale=0.5)
    assert device.read(0) == (0.0, 0.0, 0.1)


def test_the_first_button_is_the_clutch() -> None:
    reports, device, _ = handle()
    for bits, held in ((0b01, True), (0b10, False), (0b11, True), (0, False)):
        reports.waiting.append(buttons(bits))
        device.read(0)
        assert device.clutched is held


def test_a_mouse_that_is_unplugged_leaves_the_handle_where_it_is_and_says_so_once() -> None:
    reports, device, told = handle()
    reports.held = pushed(down=1.0)
    reports.waiting.append(buttons(1))
    moved = run(device, 0.5)
    assert device.clutched
    reports.there = False
    still = run(device, 1.0, 0.5)
    assert still[-1] == pytest.approx(moved[-1], abs=STICK_SPEED * 0.04)  # what it was late by
    assert np.ptp(still[-200:]) < 1e-9
    assert device.gone
    assert not device.clutched
    assert told == [GONE]
    reports.there = True  # plugged in again it is another: begin again
    assert np.ptp(run(device, 1.0, 1.5)[200:]) < 1e-9


def test_a_receiver_whose_mouse_is_switched_off_leaves_the_handle_too() -> None:
    reports, device, told = handle()
    reports.held = pushed(down=1.0)
    run(device, 0.5)
    reports.held = None  # no report that says so, and no error
    assert np.ptp(run(device, 2.0, 0.5)[-1000:]) < 1e-9
    assert told == []


def test_what_was_pushed_before_the_session_moves_nothing() -> None:
    reports, device, _ = handle()
    reports.waiting = [pushed(down=1.0)] * 64  # the kernel keeps no more: that it was let go is not among them
    assert np.ptp(run(device, 1.0)) < 1e-9
    reports.held = pushed(down=1.0)
    assert run(device, 1.0, 1.0)[-1] > 0.05


def test_what_was_pushed_while_the_loop_stood_still_moves_nothing() -> None:
    reports, device, _ = handle()
    run(device, 1.0)
    reports.waiting = [buttons(1), *([pushed(down=1.0)] * 63)]
    assert np.ptp(run(device, 1.0, 3.0)) < 1e-9
    assert device.clutched  # the probe stays rather than goes
    reports.held = pushed(down=1.0)
    run(device, 1.0, 4.0)
    before = device.read(round(5e9))
    assert device.read(round(5.2e9)) - before < 0.05 * LARGEST_SPEED  # a gap counts as 50 ms at most


def test_nothing_is_felt() -> None:
    reports, device, _ = handle()
    assert not device.closed_loop
    assert device.specification is None
    assert device.render(3.0) == 3.0
    assert device.render(-1.0) == device.render(math.nan) == 0.0
    device.close()
    device.close()
    assert reports.closed == 1
    assert device.render(3.0) == 0.0
    assert math.isfinite(device.read(10**9))


@settings(max_examples=300)
@given(st.lists(st.lists(st.integers(0, 255), max_size=70), max_size=20))
@pytest.mark.long
def test_no_report_is_taken_for_what_it_is_not(reports: list[list[int]]) -> None:
    mouse = Reports()
    device = SpaceMouse(HidMouse(mouse))
    state = CapState()
    for tick, report in enumerate(reports):
        before, state = state, after(state, report)
        assert all(-1.0 <= value <= 1.0 for value in state[:3])
        if len(report) < 2 or report[0] not in (1, 3):
            assert state == before
        mouse.waiting = [report]
        device.read(tick * TICK_NS)
    for tick in range(400):
        position = device.read((len(reports) + tick) * TICK_NS)
        assert math.isfinite(position)
        assert 0.0 <= position < STICK_SPEED


def test_a_flood_of_reports_is_taken_bit_by_bit() -> None:
    reports, device, _ = handle()
    reports.waiting = [pushed(down=1.0)] * 10_000
    device.read(0)
    assert reports.reads <= 64


def test_it_keeps_to_what_sessions_count_on() -> None:
    def make() -> SpaceMouse:
        reports, device, _ = handle()
        reports.held = pushed(down=0.5)
        return device

    findings = check_device(make, name="spacemouse", watched=1.0)
    timed = ("read time", "render time")  # of a machine that may be late
    assert [finding for finding in failed(findings) if finding.check not in timed] == []


# --- hidapi -----------------------------------------------------------------------------------------------------------


class Hid(SimpleNamespace):
    """The module, with these mice."""

    def __init__(self, found: Iterable[tuple[int, int, int]], opens: bool = True) -> None:
        super().__init__(opened=[], device=self._device)
        self._found, self._opens = found, opens

    def enumerate(self) -> list[dict[str, object]]:
        keys = ("vendor_id", "product_id", "usage")
        return [
            {"usage_page": 1, "path": f"/dev/hidraw{number}".encode()} | dict(zip(keys, one, strict=True))
            for number, one in enumerate(self._found)
        ]

    def _device(self) -> Reports:
        reports = Reports()

        def open_path(path: bytes) -> None:
            if not self._opens:
                raise OSError("open failed")
            self.opened.append(path)

        reports.open_path = open_path  # type: ignore[attr-defined]
        return reports


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Callable[[Hid], Hid]:
    def install(hid: Hid) -> Hid:
        monkeypatch.setattr(spacemouse, "_binding", lambda: hid)
        return hid

    return install


@pytest.mark.parametrize("mouse", MICE, ids=lambda one: f"{one[0]:04x}:{one[1]:04x}")
def test_every_mouse_is_found_by_the_part_that_has_the_cap(
    installed: Callable[[Hid], Hid], mouse: tuple[int, int]
) -> None:
    hid = installed(Hid([(0x1234, 0xC635, 8), (*mouse, 6), (*mouse, 8)]))
    open_mouse()
    open_mouse("/dev/hidraw7")
    assert hid.opened == [b"/dev/hidraw2", b"/dev/hidraw7"]


def test_none_and_one_that_does_not_open_are_refused_in_one_line(installed: Callable[[Hid], Hid]) -> None:
    installed(Hid([(0x256F, 0x0001, 8)]))
    with pytest.raises(SettingError, match="no SpaceMouse is connected"):
        open_mouse()
    installed(Hid([(*MICE[0], 8)], opens=False))
    with pytest.raises(SettingError, match=r"/dev/hidraw0 does not open \(open failed\): give yourself the right"):
        open_mouse()


def test_settings_make_it_along_a_line_and_in_a_scene(
    installed: Callable[[Hid], Hid], capsys: pytest.CaptureFixture[str]
) -> None:
    hid = installed(Hid([(*MICE[0], 8)]))
    asked = SessionSettings()
    object.__setattr__(asked, "operator", "spacemouse@/dev/hidraw5")
    assert isinstance(make_spacemouse(asked, Reach(0.01, 0.009)), SpaceMouse)
    assert capsys.readouterr().err == f"{SAYS}\n"
    object.__setattr__(asked, "scene", "plane")
    assert isinstance(make_spacemouse(asked, UNKNOWN_REACH), SpatialSpaceMouse)
    assert hid.opened == [b"/dev/hidraw5"] * 2


def test_hidapi_itself_says_that_there_is_no_mouse() -> None:
    pytest.importorskip("hid")
    with pytest.raises(SettingError, match="does not open"):
        open_mouse("/dev/hidraw-of-nobody")
    if not any((one["vendor_id"], one["product_id"]) in MICE for one in spacemouse._binding().enumerate()):
        with pytest.raises(SettingError, match="no SpaceMouse is connected"):
            open_mouse()


def test_without_the_library_one_line_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['hid'] = sys.modules['hidraw'] = None\n"
        "from foretouch.devices.spacemouse import open_mouse\n"
        "try:\n    open_mouse()\nexcept Exception as error:\n    print(type(error).__name__, error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("MissingExtraError hidapi is not installed: pip install ")
    assert "[spacemouse]" in done.stdout


# --- a whole session --------------------------------------------------------------------------------------------------

STAND_IN = """
import struct, time


class device:
    '''A mouse whose cap is pushed down at first, then let go for 3 s, lifted, and so on.'''

    def __init__(self):
        self.told, self.begun = 0.0, None

    def open_path(self, path):
        assert path == b'/dev/hidraw0'

    def set_nonblocking(self, value):
        pass

    def read(self, longest):
        now = time.monotonic()
        self.begun = self.begun or now
        if now - self.told < 0.008:
            return []
        self.told, passed = now, (now - self.begun) % 6.0
        down = 350 if passed < 0.9 else -350 if 4.0 < passed < 4.9 else 0
        return list(struct.pack('<b3h', 1, 0, 0, down))

    def close(self):
        pass


def enumerate():
    return [dict(vendor_id=0x256F, product_id=0xC635, usage_page=1, usage=8, path=b'/dev/hidraw0')]
"""


SCENE = pytest.param(("--scene", "plane"), marks=pytest.mark.long)


@pytest.mark.live
@pytest.mark.parametrize("scene", [(), SCENE], ids=["line", "scene"])
@pytest.mark.long
def test_a_whole_session_presses_and_says_that_nothing_is_felt(
    plugged: Path, tmp_path: Path, scene: tuple[str, ...]
) -> None:
    (plugged / "hidraw.py").write_text(STAND_IN)
    words = ("--operator", "spacemouse", "--material", "hunt-crossley", "--duration", "10", *scene)
    done = teleop(plugged, tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(SAYS) == 1
    report = json.loads(done.stdout)
    assert report["settings"]["operator"] == "spacemouse"
    assert report["max_follower_force_N"] > 0.3
    assert report["settings"].get("felt") != "yes"
