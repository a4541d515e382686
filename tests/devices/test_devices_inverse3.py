"""The Inverse3 over a stand-in of Haply's service, with its protocol over a real WebSocket: no device was here."""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("websockets.sync.server")

from device_sessions import teleop
from inverse_service import FOOT, Service, presses

from foretouch.devices import UNKNOWN_REACH, DeviceSpecification
from foretouch.devices.device import LEAST_DAMPING
from foretouch.devices.felt import LOOKS, PATIENCE
from foretouch.devices.inverse3 import Inverse3, InverseService, SpatialInverse3, make_inverse3
from foretouch.devices.inverse3.service import LOST
from foretouch.errors import SettingError
from foretouch.session import SessionSettings
from foretouch.session.conformance import check_device, check_named, failed
from foretouch.session.operators import felt_device, make_operator

SPECIFICATION = DeviceSpecification(damping=2.0, force_limit=8.0)


@pytest.fixture
def service() -> Iterator[Service]:
    made = Service()
    yield made
    made.close()


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def held(service: Service, told: list[str]) -> Iterator[Inverse3]:
    made = Inverse3(InverseService(service.address, told.append), SPECIFICATION)
    yield made
    made.close()


def until(true: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.001)


def hold(service: Service, place: tuple[float, float, float]) -> None:
    """Let the hand hold the handle still there, in the device's frame [m]."""
    service._intention = lambda time: tuple(a - b for a, b in zip(place, FOOT, strict=True))
    until(lambda: math.dist(service.place, place) < 1e-4)


def position(device: Inverse3) -> float:
    """A position that is one: this machine may be late."""
    until(lambda: math.isfinite(device.read(0)))
    return device.read(0)


def test_pressing_down_grows_into_the_material_from_where_the_session_begins(service: Service, held: Inverse3) -> None:
    assert position(held) == pytest.approx(0.0, abs=1e-4)
    hold(service, (0.03, -0.10, FOOT[2] - 0.012))
    until(lambda: held.read(0) == pytest.approx(0.012, abs=2e-4))
    other = Inverse3(InverseService(service.address), SPECIFICATION, axis=1, direction=1)
    position(other)
    hold(service, (0.0, -0.09, FOOT[2]))
    until(lambda: other.read(0) == pytest.approx(0.01, abs=4e-4))
    other.close()


def test_a_force_pushes_the_hand_up_and_the_hand_yields(service: Service, held: Inverse3) -> None:
    position(held)

    def yielded() -> bool:
        assert held.render(3.0) in (3.0, 0.0)  # 0 where this machine is late
        return held.read(0) == pytest.approx(-0.01, rel=0.1)  # by a grip of 300 N/m

    until(yielded)
    assert (0.0, 0.0, 3.0) in service.forces
    assert held.specification.pulls
    until(lambda: held.render(-1.0) == -1.0)
    until(lambda: service.forces[-1] == (0.0, 0.0, -1.0) or (0.0, 0.0, -1.0) in service.forces)


def test_the_limit_is_kept_and_no_number_is_no_force(service: Service, held: Inverse3) -> None:
    until(lambda: held.render(1e9) == 8.0)
    until(lambda: (0.0, 0.0, 8.0) in service.forces)
    assert held.render(math.nan) == 0.0
    assert max(force[2] for force in service.forces) == 8.0


def test_in_space_axes_are_the_worlds_and_the_limit_is_of_the_whole(service: Service) -> None:
    device = SpatialInverse3(InverseService(service.address), SPECIFICATION)
    until(lambda: device.read(0) == pytest.approx(FOOT, abs=1e-4))
    device.render((0.0, 3.0, -4.0))
    until(lambda: (0.0, 3.0, -4.0) in service.forces)
    device.render((24.0, 32.0, 0.0))
    until(lambda: service.forces[-1] == pytest.approx((4.8, 6.4, 0.0)))
    for wrong in ((math.nan, 0.0, 1.0), (math.inf, 0.0, 0.0)):
        device.render(wrong)
        until(lambda: service.forces[-1] == (0.0, 0.0, 0.0))
    device.close()
    assert device.read(0) == pytest.approx(FOOT, abs=0.1)


def test_the_first_message_says_who_comes_and_what_axes_are_meant(service: Service, held: Inverse3) -> None:
    until(lambda: len(service.heard) > 1)
    first, later = service.heard[:2]
    words = {"profile": {"name": "foretouch:leader"}, "basis": {"permutation": "XYZ"}}
    assert first["session"] == {"configure": words}
    assert "session" not in later
    command = {"set_cursor_force": {"vector": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    assert later == {"inverse3": [{"device_id": "049D", "commands": command}]}


def test_a_service_before_3_5_is_told_in_its_own_words() -> None:
    service = Service(old=True)
    device = Inverse3(InverseService(service.address), SPECIFICATION)
    assert position(device) == pytest.approx(0.0, abs=1e-4)
    until(lambda: device.render(2.0) == 2.0)
    until(lambda: (0.0, 0.0, 2.0) in service.forces)
    assert all("session" not in message for message in service.heard)
    device.close()
    service.close()


def test_where_nobody_renders_any_more_no_force_is_sent(service: Service, held: Inverse3) -> None:
    until(lambda: held.render(5.0) == 5.0)
    until(lambda: service.force[2] == 5.0)
    begun = time.monotonic()
    until(lambda: service.force[2] == 0.0)
    assert time.monotonic() - begun < 5.0 * PATIENCE
    until(lambda: held.render(5.0) == 5.0)
    until(lambda: service.force[2] == 5.0)
    held.close()
    until(lambda: service.forces[-1] == (0.0, 0.0, 0.0))
    assert held.render(5.0) == 0.0


def test_no_call_waits_for_a_service_that_is_late(service: Service, held: Inverse3, told: list[str]) -> None:
    position(held)
    service.lateness = 0.1
    taken, seen = [], []
    for tick in range(300):
        begun = time.perf_counter()
        seen.append(held.read(tick))
        given = held.render(1.0)
        taken.append(time.perf_counter() - begun)
        assert given == 0.0 or math.isfinite(seen[-1]) or tick < 10
        time.sleep(0.001)
    assert np.percentile(taken, 99.0) < 5e-3
    assert math.isfinite(seen[0])  # it repeats for some milliseconds, and then there is none
    assert np.isnan(seen).mean() > 0.5
    service.lateness = 0.0
    position(held)  # and goes on
    until(lambda: held.render(1.0) == 1.0)
    assert told == []
    assert not held.lost


def test_a_late_service_has_a_command_without_force_as_its_newest(service: Service, held: Inverse3) -> None:
    service.lateness = 0.15

    def pushed() -> bool:
        held.render(4.0)
        return service.force[2] == 4.0

    until(pushed)
    for _ in range(100):  # rendered all the time
        held.render(4.0)
        time.sleep(0.001)
    until(lambda: service.force[2] == 0.0, 0.2)


def test_where_nobody_knows_where_the_hand_is_no_force_is_sent(service: Service, held: Inverse3) -> None:
    position(held)

    def pushed(up: float) -> bool:
        held.render(4.0)
        return service.force[2] == up

    until(lambda: pushed(4.0))
    service.status["ready"] = False
    until(lambda: pushed(0.0), 0.8 * LOST)
    assert not held.lost
    service.status["ready"] = True
    until(lambda: pushed(4.0))


def at_height(number: str) -> str:
    """A state whose height is this text."""
    return (
        f'{{"inverse3": [{{"device_id": "049D", "state": {{"cursor_position": {{"x": 0, "y": 0, "z": {number}}}}}}}]}}'
    )


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (lambda service: service.die(), "the connection ended"),
        (lambda service: setattr(service, "lateness", 3.0), "it does not answer"),
        (lambda service: setattr(service, "listed", False), "the service has no device 049D any more"),
        (lambda service: service.status.update(ready=False), "the device is not ready"),
        (lambda service: service.status.update(power_supply=False), "the device has no power"),
        (lambda service: setattr(service, "says", "nonsense"), "it says what is no state"),
        (lambda service: setattr(service, "says", '{"inverse3": 3}'), "it says what is no state"),
        (lambda service: setattr(service, "says", at_height("NaN")), "it says what is no state"),
        (lambda service: setattr(service, "says", at_height("null")), "it says what is no state"),
        (lambda service: setattr(service, "says", at_height("1e999")), "it says what is no state"),
    ],
    ids=["dies", "is silent", "unplugged", "not ready", "no power", "malformed", "other types", "NaN", "null", "huge"],
)
def test_a_device_that_is_lost_shows_no_position_and_gives_no_force(
    service: Service, held: Inverse3, told: list[str], end: Callable[[Service], object], reason: str
) -> None:
    position(held)
    until(lambda: held.render(3.0) == 3.0)
    end(service)
    until(lambda: held.lost, 3.0 * LOST + 2.0)
    assert math.isnan(held.read(1))
    assert held.render(3.0) == 0.0
    until(lambda: told != [])
    (line,) = told
    assert line.startswith(f"inverse3: lost the device at {service.address}: ")
    assert reason in line
    assert "\n" not in line
    service.lateness, service.says, service.listed = 0.0, "", True  # it is back: it stays lost until it is opened anew
    time.sleep(0.05)
    assert math.isnan(held.read(2))
    held.close()
    assert math.isfinite(held.read(3))


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"listed": False}, "the service has no Inverse3: plug it in"),
        ({"status": {"calibrated": False}}, "device 049D is not calibrated"),
        ({"status": {"ready": False}}, "device 049D is not ready"),
        ({"status": {"power_supply": False}}, "device 049D has no power"),
        ({"status": {"in_use": True}}, "device 049D is used by another program"),
        ({"scale": 2.0}, "device 049D has its lengths scaled by the service"),
        ({"says": "hello"}, "device 049D shows no position: it says what is no state"),
    ],
    ids=str,
)
def test_a_device_that_cannot_be_used_is_refused_in_one_line(service: Service, change: dict, rule: str) -> None:
    for name, value in change.items():
        setattr(service, name, value)
    with pytest.raises(SettingError, match=rule) as refused:
        InverseService(service.address)
    assert "\n" not in str(refused.value)
    assert all(force == (0.0, 0.0, 0.0) for force in service.forces)


@pytest.mark.parametrize("address", ["", ":10001", "here", "here:", "here:0", "here:65536", "a b:1", "a/b:1", "u@h:1"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(SettingError, match=r"must be inverse3 or inverse3@HOST:PORT"):
        InverseService(address)


def test_where_nothing_or_something_else_listens_it_is_said_within_two_seconds() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        begun = time.monotonic()
        with pytest.raises(SettingError, match="no Inverse Service answers there"):
            InverseService(f"127.0.0.1:{port}")
        assert time.monotonic() - begun < 2.5
    with pytest.raises(SettingError, match="no Inverse Service answers there"):
        InverseService(f"127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("buttons", "pressed"), [({"a": True}, True), ({"a": False}, False), ({"button_1": True}, False)]
)
def test_the_first_button_of_a_grip_is_the_clutch(buttons: dict[str, bool], pressed: bool) -> None:
    service = Service()
    service.buttons = buttons
    device = Inverse3(InverseService(service.address), SPECIFICATION)
    until(lambda: device.clutched is pressed)
    device.close()
    assert not device.clutched
    service.close()


@settings(max_examples=40, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["inverse3", "state", "device_id"]), inner),
        max_leaves=8,
    )
)
def test_no_answer_ends_the_thread_or_is_taken_for_a_place(answer: object) -> None:
    service = InverseService.__new__(InverseService)  # what takes answers, without a thread
    service._id, service._newest, service._problem, service._clutched = "049D", (FOOT, -math.inf), "", False
    service._connection = type("Said", (), {"recv": lambda self, patience: json.dumps(answer)})()
    service._take(0.1)
    assert service._newest[0] == FOOT


@pytest.mark.live  # its reads are timed
def test_it_keeps_to_what_sessions_count_on() -> None:
    for _ in range(5):  # a machine on which its thread waits has positions that are too old
        service = Service(presses(0.02, 1.0))
        findings = check_device(lambda: Inverse3(InverseService(service.address), SPECIFICATION), name="inverse3")  # noqa: B023
        service.close()
        if not failed(findings):
            break
    assert failed(findings) == []
    assert {one.check for one in findings if one.passed is None} == {"sign of force"}


@pytest.mark.live  # it is watched for some seconds
def test_its_check_takes_an_address(plugged: Path, service: Service) -> None:
    name = f"inverse3@{service.address}"
    ((title, findings),) = check_named(name, kind="device").items()
    assert title == f"device {name}"
    assert {one.check: one.passed for one in findings}["name"] is True
    assert service.heard


def test_settings_make_it_along_a_line_and_in_a_scene(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = SessionSettings()
    object.__setattr__(asked, "operator", f"inverse3@{service.address}")
    device = make_inverse3(asked, UNKNOWN_REACH)
    assert isinstance(device, Inverse3)
    assert device.specification.watchdog == PATIENCE + LOOKS
    device.close()
    object.__setattr__(asked, "scene", "plane")
    device = make_inverse3(asked, UNKNOWN_REACH)
    assert isinstance(device, SpatialInverse3)
    device.close()


def test_the_damping_is_asked_for_and_the_least_is_taken_else(plugged: Path, service: Service) -> None:
    said: list[str] = []
    device = make_operator(SessionSettings(operator=f"inverse3@{service.address}"), say=said.append)
    assert felt_device(device, SessionSettings()).damping == LEAST_DAMPING
    assert any("nobody states the damping" in line and "--device-damping" in line for line in said)
    device.close()
    device = make_operator(SessionSettings(operator=f"inverse3@{service.address}", device_damping=1.5), say=said.append)
    assert device.specification.damping == 1.5
    device.close()


def test_without_the_library_one_line_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['websockets.sync.client'] = None\n"
        "from foretouch.devices.inverse3 import InverseService\n"
        "try:\n    InverseService()\nexcept Exception as error:\n    print(type(error).__name__, error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("MissingExtraError websockets is not installed: pip install ")
    assert "[haply]" in done.stdout


# --- whole sessions ---------------------------------------------------------------------------------------------------


SCENE = pytest.param(("--scene", "plane"), marks=pytest.mark.long)


@pytest.mark.live
@pytest.mark.parametrize("scene", [(), SCENE], ids=["line", "scene"])
def test_a_whole_session_presses_and_is_felt(plugged: Path, tmp_path: Path, scene: tuple[str, ...]) -> None:
    service = Service(presses(0.060 if scene else 0.025, 3.0, rest=4.0))  # until hand and robot have met
    operator = ("--operator", f"inverse3@{service.address}", "--device-damping", "2", "--first-touch", "follow")
    done = teleop(plugged, tmp_path, *operator, *scene, "--material", "hunt-crossley", "--duration", "14")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["settings"]["operator"] == "inverse3"
    assert report["settings"]["felt"] == "yes"
    pushed = np.array(service.forces)
    if len(pushed) < 14 * 300:
        pytest.skip(f"no session: this machine got {len(pushed) / 14:.0f} states a second out of 2,000")
    assert pushed[:, 2].max() > 0.3, done.stderr  # up, out of the material
    assert np.abs(pushed).max() <= 10.0
    assert service.force == [0.0, 0.0, 0.0]
    assert "lost the device" not in done.stderr
    service.close()


@pytest.mark.live
@pytest.mark.long
def test_a_service_that_dies_leaves_the_session_in_order(plugged: Path, tmp_path: Path) -> None:
    service = Service(presses(0.025, 2.0, rest=1.0))
    operator = ("--operator", f"inverse3@{service.address}", "--device-damping", "2", "--first-touch", "follow")
    began = len(service.heard)

    def kill() -> None:
        until(lambda: len(service.heard) > began, 110.0)  # kernels may have to be compiled
        time.sleep(5.0)
        service.die()

    killer = threading.Thread(target=kill)
    killer.start()
    done = teleop(plugged, tmp_path, *operator, "--duration", "9")
    killer.join()
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("lost the device") == 1
    assert "the device gives no position: the last one is held" in done.stderr
    assert "Traceback" not in done.stderr
    assert json.loads(done.stdout)["settings"]["operator"] == "inverse3"
