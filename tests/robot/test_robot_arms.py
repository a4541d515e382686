"""The simulated arms of the package: their descriptions, their control and what they feel, against closed forms."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foretouch.errors import InputError
from foretouch.robot import ArmAlongLine, ArmPicture, ArticulatedArm, make_material, read_arm
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.kinematics import InverseKinematics
from foretouch.robot.engine import load_mujoco
from foretouch.settings import ARMS

DESCRIPTIONS = Path(__file__).parents[2] / "src" / "foretouch" / "robot" / "arms" / "descriptions"

MASSES = {"fr3": 15.494813, "ur5e": 20.9949, "so101": 0.620006}
"""Sums of the masses that the descriptions of the same arms in MuJoCo Menagerie give to the bodies that are here [kg];
of the FR3 without its foot, of the SO-101 without the moving jaw."""


def in_the_air(*_: object) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def floor(stiffness: float):
    """A spring below z = 0, with a little damping."""

    def force(place: tuple, velocity: tuple, elapsed: float) -> tuple:
        pressed = stiffness * -place[2] - 5.0 * velocity[2]
        return 0.0, 0.0, max(pressed, 0.0) if place[2] < 0.0 else 0.0

    return force


def lowered(arm: ArticulatedArm, to: float, seconds: float, held: float = 0.5) -> list:
    """Samples of an arm that goes straight down, or up, to a height [m], and stays there."""
    start, ticks = arm.read().exact_place[2], round(seconds * 1e3)
    heights = [start + (to - start) * min((k + 1) / ticks, 1.0) for k in range(ticks + round(held * 1e3))]
    return [arm.exchange((0.0, 0.0, height)) for height in heights]


def standard(alpha: float, a: float, d: float, theta: float) -> np.ndarray:
    """A joint by the parameters of Denavit and Hartenberg (1955): about z, along z, along x, about x."""
    turn = Rotation.from_euler("ZX", (theta, alpha)).as_matrix()
    along = Rotation.from_rotvec((0.0, 0.0, theta)).apply((a, 0.0, d))
    return np.block([[turn, along[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def modified(alpha: float, a: float, d: float, theta: float) -> np.ndarray:
    """The same in the form of Craig (1986): along x, about x, along z, about z."""
    first = np.eye(4)
    first[:3, :3] = Rotation.from_rotvec((alpha, 0.0, 0.0)).as_matrix()
    first[:3, 3] = (a, 0.0, 0.0)
    second = np.eye(4)
    second[:3, :3] = Rotation.from_rotvec((0.0, 0.0, theta)).as_matrix()
    second[:3, 3] = (0.0, 0.0, d)
    return first @ second


def franka(joints: np.ndarray) -> np.ndarray:
    """The FR3's flange by the parameters that Franka publishes."""
    quarter = 0.5 * math.pi
    rows = [(0, 0, 0.333), (-quarter, 0, 0), (quarter, 0, 0.316), (quarter, 0.0825, 0), (-quarter, -0.0825, 0.384)]
    rows += [(quarter, 0, 0), (quarter, 0.088, 0)]
    pose = np.eye(4)
    for (alpha, a, d), theta in zip(rows, joints, strict=True):
        pose = pose @ modified(alpha, a, d, theta)
    return pose @ modified(0.0, 0.0, 0.107, 0.0)


def universal(joints: np.ndarray) -> np.ndarray:
    """The UR5e's flange by the nominal parameters that Universal Robots publishes."""
    quarter = 0.5 * math.pi
    rows = [(quarter, 0, 0.1625), (0, -0.425, 0), (0, -0.3922, 0)]
    rows += [(quarter, 0, 0.1333), (-quarter, 0, 0.0997), (0, 0, 0.0996)]
    pose = np.eye(4)
    for (alpha, a, d), theta in zip(rows, joints, strict=True):
        pose = pose @ standard(alpha, a, d, theta)
    return pose


@cache
def built(name: str) -> tuple:
    model = read_arm(name).model(1e-3, backlash=False)
    return model, load_mujoco().MjData(model)


def flange(name: str, joints: np.ndarray) -> np.ndarray:
    """Pose of an arm's flange in its foot's frame, by MuJoCo."""
    model, data = built(name)
    data.qpos[:] = joints
    load_mujoco().mj_kinematics(model, data)
    base, site = data.site("base"), data.site("flange")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos - base.xpos
    return pose


@pytest.mark.parametrize(("name", "published", "within"), [("fr3", franka, 1e-9), ("ur5e", universal, 1.5e-3)])
def test_a_flange_is_where_the_published_parameters_put_it(name: str, published, within: float) -> None:
    """Menagerie rounds the lengths of the UR5e to millimetres, and its foot is turned by a quarter."""
    random = np.random.default_rng(3)
    poses = random.uniform(-1.5, 1.5, (40, read_arm(name).home.size))
    offsets = np.zeros(poses.shape[1]) if name == "fr3" else np.array((-0.5 * math.pi, 0, 0, 0, 0, 0))
    for joints in poses:
        ours, theirs = flange(name, joints), published(joints + offsets)
        assert math.dist(ours[:3, 3], theirs[:3, 3]) < within
        np.testing.assert_allclose(ours[:3, 2], theirs[:3, 2], atol=2e-5)


@pytest.mark.parametrize("name", ARMS)
def test_a_description_is_small_and_says_what_menagerie_says(name: str) -> None:
    path = DESCRIPTIONS / f"{name}.xml"
    text, description = path.read_text(), read_arm(name)
    assert 4_000 < len(text) < 8_000
    assert "gravcomp" not in text
    assert "<mesh" not in text
    assert "commit" in text
    assert "License" in text
    model = description.model(5e-4)
    assert sum(model.body_mass) - description.probe[1] == pytest.approx(MASSES[name], abs=2e-5)
    body = Body(description, 5e-4)
    np.testing.assert_allclose(body.rotation.reshape(3, 3)[:, 2], (0.0, 0.0, -1.0), atol=1e-3)  # it points down
    assert abs(body.place[2] - (0.05 if name == "so101" else 0.1)) < 1e-3
    limits = body.limits()
    assert (np.abs(body.bias) < 0.5 * limits["torque"]).all()
    inside = np.minimum(body.positions - limits["low"], limits["high"] - body.positions)
    assert inside.min() > 0.15
    assert np.linalg.svd(body.jacobian[:3], compute_uv=False)[-1] > 0.1


@pytest.mark.parametrize(("name", "within"), [("fr3", 3e-4), ("ur5e", 3e-4), ("so101", 1.5e-3)])
@pytest.mark.first
def test_it_goes_where_it_is_told_and_feels_nothing_in_the_air(name: str, within: float) -> None:
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=0)
    offset = np.array(arm.read().force)
    start = np.array(arm.read().exact_place)
    to = np.array((0.03, -0.03, 0.02))
    for k in range(1200):
        sample = arm.exchange(tuple(start + (to - start) * min(k / 600.0, 1.0)))
    assert math.dist(sample.exact_place, to) < within
    assert math.dist(sample.place, sample.exact_place) < 2.0 * arm.specification.encoder_resolution
    assert math.dist(sample.force, offset) < (1.0 if name == "so101" else 0.15)
    rotation = arm.body.rotation.reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 2], (0.0, 0.0, -1.0), atol=3e-3)


@pytest.mark.parametrize("name", ["fr3", "ur5e"])
@pytest.mark.first
def test_the_wrist_feels_the_contact_force_and_holds_the_limit(name: str) -> None:
    arm = ArticulatedArm(read_arm(name), floor(2000.0), seed=0, start=(0.0, 0.0, 0.004))
    free = np.mean([s.force for s in lowered(arm, 0.004, 0.1, 0.1)], axis=0)
    pressed = lowered(arm, -0.004, 1.0)[-100:]  # 8 N
    felt = np.mean([s.force for s in pressed], axis=0) - free
    assert felt[2] == pytest.approx(np.mean([s.exact_force[2] for s in pressed]), abs=0.05)
    np.testing.assert_allclose(felt[:2], 0.0, atol=0.05)
    assert pressed[-1].exact_force[2] == pytest.approx(8.0, abs=0.8)
    deep = lowered(arm, -0.05, 2.0, 2.0)  # it would be 100 N
    assert max(s.exact_force[2] for s in deep) < 20.0
    assert deep[-1].exact_force[2] < 15.6
    assert deep[-1].clipped


@pytest.mark.long
def test_without_a_wrist_sensor_the_current_tells_the_force_within_its_friction() -> None:
    arm = ArticulatedArm(read_arm("so101"), floor(2000.0), seed=0, start=(0.0, 0.0, 0.004))
    samples = lowered(arm, -0.004, 2.0, 1.0)
    assert samples[-1].exact_force[2] > 3.0
    assert abs(samples[-1].force[2] - samples[-1].exact_force[2]) < arm.specification.contact_floor


@pytest.mark.long
def test_what_moves_the_arm_itself_is_no_contact_force() -> None:
    arm = ArticulatedArm(read_arm("so101"), in_the_air, seed=0)
    numbers, place, goal, forces = np.random.default_rng(5), np.zeros(3), np.zeros(3), []
    for tick in range(4000):
        if tick % 400 == 0:
            goal = numbers.uniform(*arm.reach)
        left = goal - place
        place = place + left * min(2e-4 / max(float(np.linalg.norm(left)), 1e-9), 1.0)
        forces.append(arm.exchange(tuple(place)).force)
    assert np.sqrt(np.square(forces[500:]).mean(0)).max() < 1.0  # N: the joints' friction; its mass alone would show 3


@pytest.mark.parametrize(("name", "ticks"), [("fr3", 1), ("ur5e", 2), ("so101", 5)])
def test_it_shows_new_samples_at_its_own_rate(name: str, ticks: int) -> None:
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=0)
    shown = [arm.exchange((0.0, 0.0, 0.05 - 1e-5 * k)).place for k in range(20)]
    changed = [k for k in range(1, 20) if shown[k] != shown[k - 1]]
    assert set(np.diff(changed)) == {ticks}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.first
def test_no_command_drives_a_joint_beyond_its_limits(name: str) -> None:
    """Steps, places out of reach and no numbers: torques and joints stay within what the arm can."""
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=0)
    random, body = np.random.default_rng(5), arm.body
    limits, fastest = body.limits(), body.description.joint_speed
    places = random.uniform(-0.5, 0.5, (15, 3))
    places[3], places[9] = np.nan, np.inf
    for place in places:
        for _ in range(150):
            arm.exchange(tuple(place))
            assert (np.abs(body.data.ctrl) <= limits["torque"]).all()
            assert (np.abs(body.velocities) < 1.2 * fastest).all()
            assert (body.positions > limits["low"]).all()
            assert (body.positions < limits["high"]).all()
            low, high = arm.reach
            assert (np.array(arm.commanded) > np.array(low) - 0.01).all()
            assert (np.array(arm.commanded) < np.array(high) + 0.01).all()


def test_the_same_seed_and_commands_give_the_same_samples() -> None:
    first, second = (ArticulatedArm(read_arm("fr3"), floor(500.0), seed=4) for _ in range(2))
    assert lowered(first, -0.005, 0.3, 0.0) == lowered(second, -0.005, 0.3, 0.0)


@pytest.mark.parametrize("name", ["fr3", "ur5e"])
@pytest.mark.long
def test_a_tool_turns_to_the_commanded_orientation_about_its_tip(name: str) -> None:
    arm = ArticulatedArm(read_arm(name), in_the_air, seed=0)
    home, place = arm.body.rotation.reshape(3, 3).copy(), (0.0, 0.0, 0.05)
    for orientation in ((0.2, -0.2, 0.3), (0.0, -2.0, 0.0), (math.nan, 0.0, 0.0)):
        arm.turn(orientation)
        angles, away = [], []
        for _ in range(2500):
            sample = arm.exchange(place)
            turned = Rotation.from_matrix(arm.body.rotation.reshape(3, 3) @ home.T)
            angles.append(turned.magnitude())
            away.append(math.dist(sample.exact_place, place))
        assert np.abs(np.diff(angles)).max() < 1.5e-3  # rad in a millisecond: nothing jumps
        assert max(away) < 4e-3
        expected = (0.0, -0.6, 0.0) if not abs(orientation[1]) < 0.6 or math.isnan(orientation[0]) else orientation
        assert (turned * Rotation.from_rotvec(expected).inv()).magnitude() < 2e-3


def test_an_arm_of_five_joints_holds_its_tool() -> None:
    arm, other = (ArticulatedArm(read_arm("so101"), in_the_air, seed=0) for _ in range(2))
    arm.turn((0.3, 0.0, 0.0))
    assert [arm.exchange((0.0, 0.0, 0.05)) for _ in range(200)] == [
        other.exchange((0.0, 0.0, 0.05)) for _ in range(200)
    ]


def test_it_says_where_it_goes_slower() -> None:
    arm = ArticulatedArm(read_arm("so101"), in_the_air, seed=0)
    assert (arm.speed_share, arm.says) == (1.0, "")
    for _ in range(1500):
        arm.exchange((-0.05, -0.05, -0.03))
    assert arm.speed_share < 1.0
    assert "goes slower" in arm.says


def test_inverse_kinematics_comes_back_to_the_joints_that_made_the_pose() -> None:
    for name in ARMS:
        description = read_arm(name)
        inverse, body = InverseKinematics(description, 0.02), Body(description, 5e-4)
        low, high = description.reach
        for share in np.random.default_rng(1).uniform(0.1, 0.9, (5, 3)):
            place = low + share * (high - low)
            body.stand(inverse.reach(tuple(place)))
            np.testing.assert_allclose(body.place, place, atol=2e-4)
            np.testing.assert_allclose(body.rotation.reshape(3, 3)[:, 2], (0.0, 0.0, -1.0), atol=2e-3)


def test_along_a_line_it_presses_the_material_as_its_law_says() -> None:
    material = make_material("kelvin-voigt")
    robot = ArmAlongLine(read_arm("fr3"), material, seed=0)
    for k in range(1500):
        sample = robot.exchange(min(k * 2e-5, material.surface + 2e-3))
    state = material.model.initial_state()
    for _ in range(500):
        state, force, _ = material.model.advance(state, sample.exact_position - material.surface, 0.0, 1e-3)
    assert sample.exact_force == pytest.approx(force, rel=0.02)
    assert sample.position == pytest.approx(sample.exact_position, abs=1e-4)


CHANGES = {
    "no site": ('<site name="flange" pos="0 0 0.107"/>', "", 'no site "flange"'),
    "no home": ('name="home"', 'name="rest"', 'no keyframe "home"'),
    "no rate": ('<numeric name="rate" data="1000"/>', "", 'no <numeric name="rate">'),
    "odd rate": ('name="rate" data="1000"', 'name="rate" data="300"', "whole fraction of 1000 Hz"),
    "speeds": ("2.62 2.62 2.62 2.62 5.26 4.18 5.26", "2.62 2.62", "has to have 7"),
    "no number": ('data="1e-5"', 'data="-1"', "above 0"),
    "nan": ('data="1e-5"', 'data="nan"', '<numeric name="encoder"> has data="nan", which is not finite'),
    "infinite": ('data="0.5 0 0.2"', 'data="0.5 inf 0.2"', "scene is 0.5 inf 0.2, and has to be finite"),
    "backwards": ("2.62 2.62 2.62 2.62 5.26 4.18 5.26", "-2.62 2.62 2.62 2.62 5.26 4.18 5.26", "joint_speed is -2.62 "),
    "no start": ('joint_acceleration" data="10"', 'joint_acceleration" data="0"', "joint_acceleration is 0 0"),
    "no length": ('data="0.16 0.1"', 'data="-0.16 0.1"', "probe is -0.16 0.1, and each number has to be above 0"),
    "no mass": ('data="0.16 0.1"', 'data="0.16 0"', "probe is 0.16 0, and each number has to be above 0"),
    "box": ("-0.12 -0.12 -0.06 0.12 0.12 0.12", "-0.12 0.12 -0.06 0.12 0.12 0.12", "lowest x, y, z have to be below"),
    "no torque": (' ctrlrange="-87 87"', "", 'motor of joint "fr3_joint1" has no ctrlrange: give its largest torque'),
    "one way": ('ctrlrange="-12 12"', 'ctrlrange="0 12"', 'motor of joint "fr3_joint5" has ctrlrange 0 12: give'),
    "position": (
        '<motor name="fr3_joint2"',
        '<position name="fr3_joint2"',
        'of joint "fr3_joint2" is no plain <motor>',
    ),
    "filter": (
        '<motor name="fr3_joint2"',
        '<general dyntype="integrator" name="fr3_joint2"',
        "is no plain <motor> with gear 1",
    ),
    "gear": ('joint="fr3_joint3" ctrl', 'joint="fr3_joint3" gear="100" ctrl', "is no plain <motor> with gear 1"),
    "motors": ('joint="fr3_joint3" ctrl', 'joint="fr3_joint2" ctrl', 'joint "fr3_joint2" has two actuators'),
    "site": (
        '<motor name="fr3_joint3" joint="fr3_joint3"',
        '<motor name="fr3_joint3" site="flange"',
        '"fr3_joint3" moves no joint',
    ),
    "no range": (' range="-1.8361 1.8361"', "", 'joint "fr3_joint2" has no range'),
    "far home": ("-0.1635", "9", '"home" has joint "fr3_joint2" at 9 rad, outside its range -1.836 to 1.836'),
    "up": ('pos="0 0 0.107"', 'pos="0 0 0.107" quat="0 1 0 0"', "points 180 degrees away from straight down"),
    "aslant": ("-2.1803 0 2.0168", "-2.1803 0 2.2168", "points 11 degrees away from straight down, and may by 10"),
    "tip": ('<site name="flange"', '<site name="tip"/><site name="flange"', 'has a site "tip", as the probe has'),
    "sensor": ('<site name="flange"', '<site name="sensor"/><site name="flange"', 'has a site "sensor"'),
    "weight": ('<site name="flange"', '<site name="tool_mass"/><site name="flange"', 'has a site "tool_mass"'),
    "tool": ('<body name="fr3_link7"', '<body name="tool"', 'has a body "tool", as the probe has'),
    "sensors": (
        "</actuator>",
        '</actuator><sensor><force name="mjSENS_FORCE" site="base"/></sensor>',
        'it has a sensor, <force name="mjSENS_FORCE">, and the probe that is put on its flange brings all',
    ),
    "speeds of joints": (
        "</actuator>",
        '</actuator><sensor><jointvel name="fast" joint="fr3_joint2"/></sensor>',
        'it has a sensor, <jointvel name="fast">',
    ),
    "control": ('data="impedance"', 'data="magic"', "one of: impedance, servo"),
    "probe": ('data="0.16 0.1"', 'data="0.16 5"', "weighs 5 kg, and it carries 3 kg"),
    "twice": ('<body name="fr3_link1"', '<body gravcomp="1" name="fr3_link1"', "gravcomp"),
    "no arm": ("</mujoco>", "", "is no XML, or not the whole of it: no element found: line 10"),
    "no mjcf": ("<worldbody>", "<world>", "is no XML, or not the whole of it: mismatched tag"),
    "word": ('name="rate" data="1000"', 'name="rate" data="fast"', "MuJoCo cannot read it"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_description_that_breaks_a_rule_is_refused_in_one_line(
    change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    before, after, rule = CHANGES[change]
    text = (DESCRIPTIONS / "fr3.xml").read_text()
    assert before in text
    path = tmp_path / "mine.xml"
    path.write_text(text.replace(before, after))
    refused_alone(path, rule, monkeypatch, capfd)


def refused_alone(
    path: Path, rule: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], name: str | None = None
) -> None:
    """In one line, beside which nothing is printed, and no log is left in the folder where one is."""
    folder = path.parent
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    with pytest.raises(InputError) as refused:
        read_arm(name or str(path))
    assert rule in str(refused.value)
    assert str(refused.value).startswith(f"{name or path}: ")
    assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")
    assert sorted(folder.iterdir()) == before


def test_who_has_read_an_arm_finds_no_log_of_mujoco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    model = read_arm("fr3").model(1e-3)
    data = mujoco.MjData(model)
    data.qvel[:] = 1e300
    mujoco.mj_step(model, data)
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQVEL].number == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("stiffness", "damping", "rule"),
    [
        ("0", "2.7", "servo_stiffness is 0 0 0 0 0, and each number has to be above 0"),
        ("998 998 -998 998 998", "2.7", "servo_stiffness is 998 998 -998 998 998, and each"),
        ("998", "-2.7", "servo_damping is -2.7 -2.7 -2.7 -2.7 -2.7, and no number may be below 0"),
    ],
)
def test_a_servo_that_pushes_the_wrong_way_is_refused(
    stiffness: str,
    damping: str,
    rule: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    text = (DESCRIPTIONS / "so101.xml").read_text()
    path = tmp_path / "mine.xml"
    path.write_text(text.replace('"998.22"', f'"{stiffness}"').replace('"2.731"', f'"{damping}"'))
    refused_alone(path, rule, monkeypatch, capfd)
    path.write_text(text.replace('"2.731"', '"0"'))
    assert not read_arm(str(path)).damping.any()


NO_ARMS = {
    "nothing": (None, "no such file"),
    "folder": ("", "is a folder, and has to be the MJCF file of an arm"),
    "empty": (b"", "is no XML, or not the whole of it: no element found"),
    "bytes": (b"\x89PNG\r\n\x00\xff", "is no XML, or not the whole of it: "),
    "encoding": (b'<?xml version="1.0" encoding="klingon"?><mujoco/>', "it has no site"),
    "urdf": (b'<robot name="x"><link name="a"/></robot>', "is a URDF (<robot>), and an arm is described in MJCF"),
    "page": (b"<html><body/></html>", "its first element is <html>, and that of MJCF"),
}


@pytest.mark.parametrize("kind", NO_ARMS)
def test_what_is_no_description_is_refused_before_mujoco_complains_of_it(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    content, rule = NO_ARMS[kind]
    path = tmp_path / "mine.xml"
    if content == "":
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    refused_alone(path, rule, monkeypatch, capfd, "mine.xml")


def test_an_arm_that_cannot_reach_the_scene_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "far.xml"
    path.write_text((DESCRIPTIONS / "fr3.xml").read_text().replace('data="0.5 0 0.2"', 'data="0.95 0 0.2"'))
    with pytest.raises(InputError, match=r"the arm's tip stays .* mm away from .* of the scene, in world"):
        ArticulatedArm(read_arm(str(path)), in_the_air, seed=0)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.first
def test_the_joints_that_an_arm_tells_of_put_its_tip_where_it_is(name: str) -> None:
    """While it moves, too: as far as a joint's encoder counts, and as a tip goes in a period of the controller."""
    arm, picture = ArticulatedArm(read_arm(name), floor(800.0), seed=1), ArmPicture(read_arm(name))
    for tick in range(800):
        sample = arm.exchange((0.02 * math.sin(tick / 300), 0.01, max(0.05 - 1e-4 * tick, -0.002)))
        assert len(sample.joints) == picture.joints
        away = math.dist(picture.tip(sample.joints), sample.exact_place)
        assert away < (3e-3 if name == "so101" else 5e-4), tick
    for _ in range(400):
        sample = arm.exchange((0.0, 0.01, 0.01))
    assert math.dist(picture.tip(sample.joints), sample.exact_place) < 1e-3


def test_shapes_that_are_no_capsules_are_drawn_as_such_and_those_for_contacts_are_not(tmp_path: Path) -> None:
    plain = ArmPicture(read_arm("fr3"))
    text = read_arm("fr3").path.read_text()
    site = '<site name="flange" pos="0 0 0.107"/>'
    shapes = (
        '<geom type="box" size="0.01 0.01 0.05" pos="0 0 0.05"/>'
        '<geom type="cylinder" size="0.02 0.06" euler="0 1.5707963267948966 0"/>'
        '<geom type="sphere" size="0.03" pos="0 0.1 0"/><geom type="sphere" size="0.5" group="3"/>'
    )
    (tmp_path / "own.xml").write_text(text.replace(site, shapes + site))
    *_, hand, probe = ArmPicture(read_arm(str(tmp_path / "own.xml"))).links
    box, cylinder, ball = hand[-3:]
    assert len(hand) == len(plain.links[-2]) + 3
    assert (len(probe), probe[0].radius) == (1, pytest.approx(0.004))
    assert box.radius == pytest.approx(0.01)
    np.testing.assert_allclose([box.begin, box.end], [(0.0, 0.0, 0.01), (0.0, 0.0, 0.09)], atol=1e-9)
    assert cylinder.radius == pytest.approx(0.02)
    np.testing.assert_allclose([cylinder.begin, cylinder.end], [(-0.04, 0.0, 0.0), (0.04, 0.0, 0.0)], atol=1e-9)
    np.testing.assert_allclose([ball.begin, ball.end], [(0.0, 0.1, 0.0)] * 2, atol=1e-9)


def test_an_arm_with_play_that_feels_late_slides_to_and_fro_on_a_stiff_floor_without_striking_it() -> None:
    arm = ArticulatedArm(read_arm("so101"), floor(1e5), seed=3, start=(0.0, 0.0, 0.004))
    lowered(arm, -0.003, 0.3, 0.0)
    turns = 2.0 * np.pi * np.arange(1500) / 500.0
    forces = [arm.exchange((0.03 * math.sin(turn), 0.0, -0.003)).exact_force[2] for turn in turns]
    assert max(forces) < 40.0  # 101 N where the slide is as fast as in the air


def test_a_quick_way_to_the_side_neither_turns_the_tool_nor_lowers_it() -> None:
    arm = ArticulatedArm(read_arm("fr3"), in_the_air, seed=3)
    held, turned, lowers = arm.body.rotation.copy(), 0.0, 0.0
    for _ in range(500):
        arm.exchange((0.1, 0.0, 0.05))
        turned = max(turned, float(np.abs(arm.body.rotation - held).max()))
        lowers = max(lowers, abs(float(arm.body.place[2]) - 0.05))
    assert turned < 0.01  # 0.05 where the force that accelerates the tip turns the tool, too
    assert lowers < 2e-3


@pytest.mark.parametrize("name", ["fr3", "ur5e"])
def test_a_step_across_a_stiff_floor_leaves_the_force_that_is_held_on_it(name: str) -> None:
    """Joints would be late by turns, and press meanwhile (16 N, and 6 N).

    They are where torques may change at one rate each, or where a servo waits for an error before it moves inertia.
    """
    arm = ArticulatedArm(read_arm(name), floor(1e5), seed=5, start=(0.0, 0.0, 0.004))
    held = lowered(arm, -0.0015, 1.0)[-1].exact_force[2]
    across = [arm.exchange((0.04, -0.03, -0.0015)).exact_force[2] for _ in range(600)]
    assert held == pytest.approx(13.5, abs=0.2)
    assert held - 2.0 < min(across) <= max(across) < 15.0
