"""What an arm's link meets: the force of an obstacle, the arm's notice of it, and its way back."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from foretouch.errors import SettingError
from foretouch.messages import VERSION, Command, Status
from foretouch.robot import ArmAlongLine, ArticulatedArm, make_material, read_arm
from foretouch.robot.arms import Obstacle
from foretouch.session import SessionSettings
from foretouch.session.steps import follower
from foretouch.settings import ARMS

AWAY = (0.0, 0.0, -9.0)
MS = 1_000_000


def in_the_air(*_: object) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def in_the_way(ball: Obstacle, arm: ArticulatedArm, toward: np.ndarray, gap: float) -> int:
    """Put a ball so far off [m] from a capsule, of the last that leaves it clear of the others; which it is."""
    for link in reversed(range(ball.places().shape[0])):
        at = ball.places()[link] + (ball.distances()[link] + gap) * toward
        ball.move(tuple(at.tolist()))
        if ball.clear:
            return link
    raise AssertionError("no link is free that way")


def test_it_pushes_as_a_spring_and_a_damper_do_and_only_a_link() -> None:
    ball, h = Obstacle(AWAY, 0.03, 1000.0, 20.0), 5e-4
    arm = ArticulatedArm(read_arm("fr3"), in_the_air, seed=0, obstacle=ball)
    link = in_the_way(ball, arm, np.array((0.0, 1.0, 0.0)), 1e-5)
    x, y, z = ball.place
    ball.push(h)
    assert not ball.force.any()
    ball.move((x, y - 0.002, z))
    ball.push(h)
    first = ball.force[link]
    assert 1.0 < first < 2.0  # its axis may lie askew, and the nearest point elsewhere
    depth = first / 1000.0
    ball.place, ball._middle = (x, y - 0.0021, z), ball._middle - (0.0, 1e-4, 0.0)  # nearer within a step
    ball.push(h)
    more = (ball.force[link] - first) / (1000.0 + 20.0 / h)
    assert 0.5e-4 < more < 1.001e-4
    assert depth < 0.002
    applied = arm.body.data.xfrc_applied
    assert np.linalg.norm(applied[:, :3].sum(axis=0)) == pytest.approx(ball.force.sum(), rel=1e-6)
    assert not applied[arm.body.model.body("tool").id].any()


@pytest.mark.parametrize("wrong", [(0.0, 1.0, 0.0), (0.1, -1.0, 0.0), (0.1, 1.0, -1.0)])
def test_an_obstacle_that_is_none_is_refused(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(SettingError):
        Obstacle(AWAY, *wrong)


@pytest.mark.parametrize(("name", "within", "most"), [("fr3", 60, 30.0), ("ur5e", 60, 30.0)])
@pytest.mark.first
def test_a_link_that_meets_something_stops_the_arm_until_a_command_leads_back(
    name: str, within: int, most: float
) -> None:
    """The wrist goes sideways into a ball of 10 kN/m at 0.1 m/s; the command ends 40 mm inside it."""
    ball = Obstacle(AWAY, 0.03, 1e4)
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=0, obstacle=ball)
    x, y, z = arm.read().exact_place
    in_the_way(ball, arm, np.array((0.0, 1.0, 0.0)), 0.01)
    touched = noticed = None
    for tick in range(2500):
        sample = arm.exchange((x, y + min(1e-4 * tick, 0.05), z))
        touched = tick if touched is None and ball.force.any() else touched
        noticed = tick if noticed is None and sample.held else noticed
    assert touched is not None
    assert noticed is not None
    assert 0 < noticed - touched < within
    assert sample.held
    assert ball.force.max() < most
    for tick in range(1500):
        sample = arm.exchange((x, y + max(0.05 - 1e-4 * tick, 0.0), z))
    assert not sample.held
    assert not ball.force.any()
    assert math.dist(sample.exact_place, (x, y, z)) < 3e-3


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.first
def test_pressing_and_quick_turns_are_no_obstacle(name: str) -> None:
    """Steps in all directions, and against a floor of 20 kN/m, of the SO-101 1 kN/m: less than what is noticed."""
    stiffness = 1e3 if name == "so101" else 2e4

    def floor(place: tuple, velocity: tuple, elapsed: float) -> tuple:
        return 0.0, 0.0, max(-stiffness * place[2] - 20.0 * velocity[2], 0.0) if place[2] < 0.0 else 0.0

    arm = ArticulatedArm(read_arm(name), floor, seed=0)
    random, worst = np.random.default_rng(2), 0.0
    low, high = map(np.array, arm.reach)
    for _ in range(12):
        place = tuple(random.uniform(low, (*high[:2], 0.03)).tolist())
        for _ in range(300):
            assert not arm.exchange(place).held
            worst = max(worst, float(arm.control.links.states["worst"][0]))
    assert worst < 0.9


@pytest.mark.long
def test_a_follower_stands_there_says_so_and_waits_for_a_way_back() -> None:
    material = make_material("kelvin-voigt")
    ball = Obstacle(AWAY, 0.03, 1e4)
    robot = ArmAlongLine(read_arm("ur5e"), material, seed=0, obstacle=ball)
    in_the_way(ball, robot.arm, np.array((0.0, 0.0, -1.0)), 0.004)
    state = follower.start(robot.specification, SessionSettings(robot="ur5e", material="kelvin-voigt"))
    sample, statuses, now = robot.read(), [], 0
    for tick in range(6000):
        now += MS
        wanted = min(2e-5 * tick, 0.015) if tick < 3000 else max(0.015 - 2e-5 * (tick - 3000), -0.005)
        fields = {"holder": "anna", "epoch": 1, "telemetry_sequence": state.tick, "run": 1}
        command = Command(VERSION, tick + 1, now, wanted, 0, **fields)
        state, told = follower.step(state, follower.Inputs([command], sample, MS, 0), now)
        sample = robot.exchange(told.desired_position)
        statuses.append(told.telemetry.status)
        if tick == 2900:
            assert told.desired_position < 0.010
            assert ball.force.max() < 60.0
    assert statuses[2900] is Status.OBSTRUCTED
    assert statuses[-1] is Status.FOLLOWING
    assert Status.RETURNING in statuses[3000:]
    assert not ball.force.any()
    assert sample.position < 0.002


@pytest.mark.parametrize("name", ["fr3", "ur5e"])
@pytest.mark.parametrize(("share", "beside"), [(1.0, False), (0.5, True)])
def test_a_tool_that_touches_beside_its_tip_holds_the_arm(
    name: str, share: float, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force of 3 N across the probe, at its tip and half way up its rod: the same force, and another torque."""
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=1)
    data, tool = arm.body.data, arm.body.model.body("tool").id
    root, tip = data.site("sensor").xpos, data.site("tip").xpos

    def pushed(torques: np.ndarray, _: object) -> None:
        force = np.array((3.0, 0.0, 0.0))
        lever = root + share * (tip - root) - data.xipos[tool]
        data.xfrc_applied[tool] = *force, *np.cross(lever, force)
        data.ctrl[:] = torques
        mujoco.mj_step2(arm.body.model, data)

    monkeypatch.setattr(arm.body, "end_step", pushed)
    held = [arm.exchange((0.0, 0.0, 0.05)).held for _ in range(400)]
    assert any(held) is beside
