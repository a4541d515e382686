"""A robot over UDP: the real C++ end, compiled, in a process of its own."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import foretouch.robot.drivers
from foretouch.errors import InputError, SettingError
from foretouch.robot import SpatialRobot
from foretouch.robot.drivers import LostArmError
from foretouch.robot.drivers.udp import AT, GO, HELLO, LENGTHS, WHO, Head, make_udp, pack, unpack
from foretouch.session.conformance import check_robot, failed

HEADER = Path(foretouch.robot.drivers.__path__[0])
SOURCE = Path(__file__).parents[2] / "examples" / "udp_robot" / "robot.cpp"
COMPILER = shutil.which("g++") or shutil.which("clang++")

pytestmark = pytest.mark.skipif(COMPILER is None, reason="the other end needs a C++ compiler")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = tmp_path_factory.mktemp("udp") / "robot"
    flags = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsanitize=address,undefined"]
    subprocess.run([str(COMPILER), *flags, "-I", str(HEADER), str(SOURCE), "-o", str(built)], check=True, timeout=120)
    return built


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        number: int = free.getsockname()[1]
        return number


@pytest.fixture
def process(program: Path, port: int) -> Iterator[subprocess.Popen[str]]:
    """The robot, for 20 s at most."""
    with subprocess.Popen([str(program), str(port), "20"], stdout=subprocess.PIPE, text=True) as running:
        yield running
        running.kill()


def robot_at(port: int, scene: str = "plane") -> SpatialRobot:
    made = make_udp(SimpleNamespace(robot=f"udp@127.0.0.1:{port}", scene=scene))
    assert isinstance(made, SpatialRobot)
    return made


def lowered(robot: SpatialRobot, height: float, seconds: float) -> float:
    """Command a way down at 20 mm/s, in real time, and stay there; the force at the end [N]."""
    z, sample = robot.read().place[2], robot.read()
    for _ in range(round(1e3 * seconds)):
        z = max(z - 2e-5, height)
        sample = robot.exchange((0.0, 0.0, z))
        time.sleep(1e-3)
    return sample.force[2]


@pytest.mark.live
@pytest.mark.long
def test_the_example_keeps_the_rules_of_a_driver_moved_too(process: subprocess.Popen[str], port: int) -> None:
    assert (
        failed(check_robot(lambda: make_udp(SimpleNamespace(robot=f"udp@127.0.0.1:{port}", scene="")), move=True)) == []
    )


def test_the_example_is_pressed_and_leaves_by_itself_where_the_session_ends(
    process: subprocess.Popen[str], port: int
) -> None:
    robot = robot_at(port)
    assert robot.read().place == pytest.approx((0.0, 0.0, 0.01))
    assert robot.specification.force_limit == 15.0
    assert lowered(robot, -0.005, 1.5) == pytest.approx(5.0, abs=0.2)
    robot.close()  # as where the session's process is killed: nothing is sent any more
    assert process.stdout is not None
    assert process.stdout.readline() == "commands come\n"
    assert process.stdout.readline().startswith("no commands: unloads at z = -5.00 mm, 5.00 N")
    time.sleep(1.0)
    watching = robot_at(port)
    sample = watching.read()
    assert sample.force[2] == 0.0
    assert 0.0 < sample.place[2] < 0.01
    assert sample.held
    assert watching.says == "its own watchdog unloads it"
    watching.close()


def test_a_robot_that_dies_in_a_press_ends_the_session_with_one_line(process: subprocess.Popen[str], port: int) -> None:
    robot = robot_at(port)
    lowered(robot, -0.003, 1.0)
    process.kill()
    process.wait(5.0)
    began = time.monotonic()
    with pytest.raises(LostArmError, match=f"robot at 127.0.0.1:{port}: it has said nothing for 1 s"):
        lowered(robot, -0.003, 5.0)
    assert time.monotonic() - began < 4.0
    robot.close()
    robot.close()


def test_who_moves_it_is_not_pushed_aside_by_another(process: subprocess.Popen[str], port: int) -> None:
    robot = robot_at(port)
    lowered(robot, 0.008, 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.connect(("127.0.0.1", port))
        other.send(pack(Head(HELLO, 1, 1, 0)))
        other.send(pack(Head(GO, 1, 1, 0), 0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
        other.send(b"FTGO")
    lowered(robot, 0.008, 0.3)
    assert robot.read().place == pytest.approx((0.0, 0.0, 0.008), abs=1e-4)
    robot.close()


def test_no_robot_there_is_one_line(port: int) -> None:
    with pytest.raises(InputError, match=f"robot at 127.0.0.1:{port}: no answer within 3 s: start it"):
        robot_at(port)


@pytest.mark.parametrize("name", ["udp", "udp@", "udp@host:0", "udp@host:70000", "udp@host:x"])
def test_an_address_that_is_none_is_one_line(name: str) -> None:
    with pytest.raises(SettingError, match="must be udp@HOST:PORT"):
        make_udp(SimpleNamespace(robot=name, scene=""))


def test_the_lengths_are_those_of_the_header() -> None:
    text = (HEADER / "foretouch_robot.hpp").read_text()
    numbers = f"HEAD = 20, HELLO = {LENGTHS[HELLO]}, WHO = {LENGTHS[WHO]}, GO = {LENGTHS[GO]}, AT = {LENGTHS[AT]}"
    assert numbers in text
    assert max(LENGTHS.values()) < 200


@given(st.binary(max_size=200))
def test_bytes_that_are_no_datagram_are_none(data: bytes) -> None:
    found = unpack(data)
    assert found is None or LENGTHS[found[0].kind] == len(data)


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(allow_nan=False), min_size=6, max_size=6))
def test_a_datagram_is_read_as_it_was_packed(session: int, values: list[float]) -> None:
    head = Head(GO, session, 7, 123)
    assert unpack(pack(head, *values)) == (head, tuple(values))
