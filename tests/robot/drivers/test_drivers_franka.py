"""An arm of Franka: the library itself against its author's simulated arm, where both are here, and a stand-in."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import math
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import franka_stand_in
import pytest
from franka_simulated import Simulated

from apart import Apart
from foretouch.errors import InputError, SettingError
from foretouch.robot import SpatialRobot
from foretouch.robot.drivers import LostArmError, franka, opening
from foretouch.robot.drivers.franka import make_franka

FORCE, DEEP = 4.0, 0.014  # 4 mm into a floor of 1,000 N/m that is 10 mm below
LEAST = 1.5  # What comes of that with a spring of 2,000 N/m between, and friction [N]
pytestmark = pytest.mark.live
SIMULATED = all(importlib.util.find_spec(name) for name in ("franky", "franky_sim"))


@pytest.fixture(
    params=[
        "stand-in",
        pytest.param("library", marks=pytest.mark.skipif(not SIMULATED, reason="needs franky-control and franky-sim")),
    ]
)
def body(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    if request.param == "library":
        with Apart(Simulated) as simulated:
            yield simulated
    else:
        franka_stand_in.THE_ARM.append(franka_stand_in.Arm())
        monkeypatch.setattr(franka, "library", lambda *_: franka_stand_in)
        monkeypatch.setattr(franka, "require_answer", lambda *_: None)
        yield franka_stand_in.THE_ARM[-1]


@pytest.fixture
def arm(body: Any) -> Iterator[SpatialRobot]:
    made = make_franka(SimpleNamespace(robot=f"franka@{body.host}", scene="plane"))
    assert isinstance(made, SpatialRobot)
    yield made
    made.close()


def driven(
    arm: SpatialRobot, place: tuple[float, float, float], seconds: float, until: Callable[[], bool] = lambda: False
) -> list[float]:
    """Command a way at 20 mm/s down or up to a place and stay there, in real time; the upward forces [N]."""
    z, forces, end, told = arm.read().place[2], [], time.monotonic() + seconds, time.monotonic()
    while time.monotonic() < end and not until():
        step, told = 0.02 * (time.monotonic() - told), time.monotonic()
        z += min(max(place[2] - z, -step), step)
        forces.append(arm.exchange((*place[:2], z)).force[2])
        time.sleep(1e-3)
    return forces


def lowered(arm: SpatialRobot) -> tuple[float, float, float]:
    """Press; where the tip is told to be then. It stands higher: the spring that draws it is soft."""
    x, y, z = arm.read().place
    deep = (x, y, z - DEEP)
    assert LEAST < driven(arm, deep, 1.6)[-1] < FORCE + 0.2
    return deep


def above(place: tuple[float, float, float]) -> tuple[float, float, float]:
    return (*place[:2], place[2] + DEEP)


def test_it_is_read_without_a_motion_and_pressed_with_one(arm: SpatialRobot, body: Any) -> None:
    for _ in range(50):
        arm.exchange((math.nan,) * 3)
        time.sleep(1e-3)
    assert not body.moves()
    assert len(arm.read().joints) == 7
    before = arm.read().place
    deep = lowered(arm)
    assert body.moves()
    assert arm.read().place[:2] == pytest.approx(before[:2], abs=4e-3)
    assert driven(arm, above(deep), 1.6)[-1] == pytest.approx(0.0, abs=0.1)
    arm.close()
    assert not body.moves()


def test_it_unloads_by_itself_where_no_commands_come(arm: SpatialRobot, body: Any) -> None:
    deep = lowered(arm)
    time.sleep(2.0)  # a session that hangs
    assert arm.read().force[2] < 1.1
    assert body.moves()
    assert LEAST < driven(arm, deep, 1.6)[-1] < FORCE + 0.2


def test_a_reflex_in_a_press_is_said_and_never_recovered_from_here(arm: SpatialRobot, body: Any) -> None:
    deep = lowered(arm)
    body.reflex()
    driven(arm, deep, 0.5)
    assert arm.read().held
    assert arm.says == "reflex: cartesian reflex"
    assert not body.moves()
    body.recover()
    driven(arm, above(deep), 3.0, until=lambda: body.moves() and not arm.read().held)
    assert arm.says == ""
    assert driven(arm, above(deep), 1.6)[-1] == pytest.approx(0.0, abs=0.1)


def test_a_connection_that_drops_in_a_press_is_no_force_and_then_the_end(arm: SpatialRobot, body: Any) -> None:
    deep = lowered(arm)
    body.kill()
    began = time.monotonic()
    assert math.isnan(driven(arm, above(deep), 0.3)[-1])
    with pytest.raises(LostArmError, match=r"Franka at .*: it has said nothing for 1 s"):
        driven(arm, above(deep), 5.0)
    assert 0.9 < time.monotonic() - began < 2.5
    arm.close()
    arm.close()


@pytest.mark.long
def test_states_that_come_late(arm: SpatialRobot, body: Any) -> None:
    deep = lowered(arm)
    body.late = 0.004
    assert all(map(math.isfinite, driven(arm, deep, 0.3)))
    body.late = 0.06
    assert any(map(math.isnan, driven(arm, deep, 0.5)))
    body.late = 0.0
    driven(arm, deep, 0.2)
    assert math.isfinite(driven(arm, deep, 0.1)[-1])


@pytest.mark.long
def test_forces_and_places_that_are_no_numbers(arm: SpatialRobot, body: Any) -> None:
    deep = lowered(arm)
    body.force = math.nan
    assert math.isnan(driven(arm, deep, 0.1)[-1])
    body.force = None
    assert math.isfinite(driven(arm, deep, 0.1)[-1])
    before, body.place = arm.read().place, math.nan
    driven(arm, deep, 0.1)
    assert arm.read().place == pytest.approx(before, abs=1e-3)
    assert math.isnan(arm.read().force[2])


@pytest.mark.long
def test_it_keeps_no_session_waiting(arm: SpatialRobot, body: Any) -> None:
    deep, longest = lowered(arm), 0.0
    for late in (0.0, 0.05):
        body.late = late
        for _ in range(300):
            began = time.perf_counter()
            arm.exchange(deep)
            longest = max(longest, time.perf_counter() - began)
            time.sleep(1e-3)
    assert longest < 0.02


def test_no_arm_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(franka, "library", lambda *_: franka_stand_in)
    with pytest.raises(InputError, match=r"Franka at 127.254.1.1: port 1337 does not answer \(Connection refused\)"):
        make_franka(SimpleNamespace(robot="franka@127.254.1.1", scene=""))
    with pytest.raises(SettingError, match="must be franka@HOST, with the address of the arm's controller"):
        make_franka(SimpleNamespace(robot="franka@", scene=""))


@pytest.mark.skipif(not importlib.util.find_spec("franky"), reason="needs franky-control")
def test_what_listens_and_says_nothing_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "OPENING", 0.5)
    with (
        socket.create_server(("127.254.1.2", 1337)),
        pytest.raises(InputError, match=r"Franka at 127.254.1.2: it does not answer: see that FCI is active"),
    ):
        make_franka(SimpleNamespace(robot="franka@127.254.1.2", scene=""))


@pytest.mark.skipif(not importlib.util.find_spec("franky"), reason="needs franky-control")
def test_the_stand_in_takes_what_the_library_takes() -> None:
    """The library is compiled: its stub says what its functions take."""
    found = importlib.util.find_spec("franky")
    assert found is not None
    stub = ast.parse((Path(str(found.origin)).parent / "_franky.pyi").read_text())
    real = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
    names = {"Robot": "_RobotInternal"}
    for name in ("Robot", "Affine", "CartesianReference", "CartesianImpedanceTrackingMotion", "TorqueStopMotion"):
        methods: dict[str, list[set[str]]] = {}
        for node in real[names.get(name, name)].body:
            if isinstance(node, ast.FunctionDef):
                methods.setdefault(node.name, []).append({one.arg for one in (*node.args.args, *node.args.kwonlyargs)})
        for method, function in vars(getattr(franka_stand_in, name)).items():
            if callable(function) and (method == "__init__" or not method.startswith("_")):
                wanted = set(inspect.signature(function).parameters)
                assert any(wanted <= taken for taken in methods[method]), f"{name}.{method}: {wanted}"
            elif isinstance(function, property):
                assert method in methods, f"{name}.{method}"
    attributes = {node.name for node in real["RobotState"].body if isinstance(node, ast.FunctionDef)}
    assert {"O_T_EE", "O_F_ext_hat_K", "q", "robot_mode", "current_errors", "time"} <= attributes
    modes = {node.target.id for node in real["RobotMode"].body if isinstance(node, ast.AnnAssign)}  # type: ignore[union-attr]
    assert {*franka.MODES, "Reflex", "Idle", "Move"} <= modes
