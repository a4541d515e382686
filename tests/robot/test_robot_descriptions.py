"""Figures of the arms' descriptions, link by link, against those of MuJoCo Menagerie, and the SO-101 by its lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.robot import read_arm
from foretouch.robot.arms.description import BACKLASH, driven
from foretouch.robot.engine import load_mujoco
from foretouch.settings import ARMS

FR3_RANGES = (
    (-2.9007, 2.9007),
    (-1.8361, 1.8361),
    (-2.9007, 2.9007),
    (-3.0770, -0.1169),
    (-2.8763, 2.8763),
    (0.4398, 4.6216),
    (-3.0508, 3.0508),
)
SO101_RANGES = tuple((-most, most) for most in (1.91986, 1.7453293, 1.69, 1.658063, 2.7438473))
UR5E_RANGES = tuple((-most, most) for most in (6.28319, 6.28319, 3.1415, 6.28319, 6.28319, 6.28319))

PUBLISHED = {
    "fr3": {
        "joints": tuple(f"fr3_joint{number}" for number in range(1, 8)),
        "masses": (2.92747, 2.93554, 2.2449, 2.6156, 2.32712, 1.81704, 0.627143),
        "ranges": FR3_RANGES,
        "torques": (87, 87, 87, 87, 12, 12, 12),
        "damping": (0.21,) * 7,
        "armature": (0.195,) * 4 + (0.074,) * 3,
        "friction": (1.137,) * 4 + (0.763, 0.44, 0.248),
    },
    "ur5e": {
        "joints": tuple(
            f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
        ),
        "masses": (3.7, 8.393, 2.275, 1.219, 1.219, 0.1889),
        "ranges": UR5E_RANGES,
        "torques": (150, 150, 150, 28, 28, 28),
        "damping": (200, 200, 200, 15, 15, 15),
        "armature": (0.1,) * 6,
        "friction": (0.0,) * 6,
    },
    "so101": {
        "joints": ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
        "masses": (0.100006, 0.103, 0.104, 0.079, 0.087),
        "ranges": SO101_RANGES,
        "torques": (2.94,) * 5,
        "damping": (0.60,) * 5,
        "armature": (0.028,) * 5,
        "friction": (0.052,) * 5,
    },
}
"""What Menagerie's franka_fr3, universal_robots_ur5e and robotstudio_so101 say of each driven joint and of the link
behind it: masses [kg], ranges [rad], largest torques [N m], damping [N m s/rad], rotor inertia [kg m^2] and friction
[N m]."""

HALF_PLAY = 0.0087267
"""Half the play of the SO-101's gears [rad], half a degree."""


@pytest.mark.parametrize("name", ARMS)
def test_each_joint_and_its_link_have_the_figures_that_are_published(name: str) -> None:
    model, said = read_arm(name).model(1e-3), PUBLISHED[name]
    joints = driven(model)
    links = model.jnt_bodyid[joints]
    assert tuple(model.joint(number).name for number in joints) == said["joints"]
    assert tuple(model.actuator(number).name for number in range(model.nu)) == said["joints"]
    np.testing.assert_allclose(model.body_mass[links], said["masses"], rtol=1e-9)
    np.testing.assert_allclose(model.jnt_range[joints], said["ranges"], rtol=1e-9)
    assert model.jnt_limited[joints].all()
    torques = np.array(said["torques"])
    np.testing.assert_allclose(model.actuator_ctrlrange, np.stack((-torques, torques), axis=1))
    np.testing.assert_allclose(model.actuator_gear[:, 0], 1.0)
    np.testing.assert_allclose(model.dof_damping[joints], said["damping"])
    np.testing.assert_allclose(model.dof_armature[joints], said["armature"])
    np.testing.assert_allclose(model.dof_frictionloss[joints], said["friction"])


@pytest.mark.parametrize("name", ARMS)
def test_its_shapes_are_seen_and_touch_nothing(name: str) -> None:
    model = read_arm(name).model(1e-3)
    kinds = load_mujoco().mjtGeom
    assert set(model.geom_type.tolist()) <= {int(kinds.mjGEOM_CAPSULE), int(kinds.mjGEOM_SPHERE)}
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert set(model.geom_group.tolist()) == {2}
    assert model.nmesh == 0
    assert not model.body_gravcomp.any()


@pytest.mark.parametrize(("name", "above"), [("fr3", 0.26), ("ur5e", 0.26), ("so101", 0.11)])
def test_home_is_above_the_scene_and_far_from_singular(name: str, above: float) -> None:
    """The flange stands a probe's length and a little over the scene, whose axes are those of the foot."""
    mujoco, description = load_mujoco(), read_arm(name)
    model = description.model(1e-3, backlash=False)
    data = mujoco.MjData(model)
    data.qpos[:] = description.home
    mujoco.mj_forward(model, data)
    base, flange = data.site("base"), data.site("flange")
    np.testing.assert_allclose(base.xmat.reshape(3, 3), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(flange.xpos - base.xpos - description.scene, (0.0, 0.0, above), atol=1e-4)
    np.testing.assert_allclose(flange.xmat.reshape(3, 3)[:, 2], (0.0, 0.0, -1.0), atol=1e-3)
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], flange.id)
    assert np.linalg.svd(jacobian, compute_uv=False)[-1] > 0.05


def so101_flange(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place of the SO-101's flange and direction out of it, from its lengths.

    The three middle joints turn in a vertical plane beside the pan axis, so each segment has an elevation, and all
    that is left is trigonometry. Positive angles bend downwards, and a positive pan turns clockwise seen from above.
    """
    pan, lift, elbow, wrist, _ = joints
    upper, lower, hand = math.hypot(0.11257, 0.028), math.hypot(0.1349, 0.0052), 0.0611 + 0.0981
    first = 0.5 * math.pi - math.atan2(0.028, 0.11257) - lift
    second = math.atan2(0.0052, 0.1349) - lift - elbow
    third = -lift - elbow - wrist
    out = 0.0303992 + upper * math.cos(first) + lower * math.cos(second) + hand * math.cos(third)
    height = 0.0624 + 0.0542 + upper * math.sin(first) + lower * math.sin(second) + hand * math.sin(third)
    aside = 0.0181 - 0.0182778  # The upper arm stands to the right, and the hand comes back by a little less
    along, left = np.array((math.cos(pan), -math.sin(pan), 0.0)), np.array((math.sin(pan), math.cos(pan), 0.0))
    up = np.array((0.0, 0.0, 1.0))
    place = np.array((0.0388353, 0.0, 0.0)) + out * along + aside * left + height * up
    return place, math.cos(third) * along + math.sin(third) * up


def test_the_flange_of_the_so101_is_where_its_lengths_put_it() -> None:
    """Within 0.01 mm: the orientations of its links are rounded to six digits."""
    mujoco, description = load_mujoco(), read_arm("so101")
    model = description.model(1e-3, backlash=False)
    data = mujoco.MjData(model)
    random = np.random.default_rng(2)
    for joints in (np.zeros(5), description.home, *random.uniform(-1.5, 1.5, (30, 5))):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        place, out = so101_flange(joints)
        np.testing.assert_allclose(data.site("flange").xpos - data.site("base").xpos, place, atol=1e-5)
        np.testing.assert_allclose(data.site("flange").xmat.reshape(3, 3)[:, 2], out, atol=1e-5)


@pytest.mark.parametrize("step", [5e-4, 1e-3])
def test_gravity_takes_up_the_play_of_the_so101_and_leaves_it_there(step: float) -> None:
    """The motors hold their shafts still, and what they carry falls onto one side of the play and stays.

    MuJoCo's limits give way a little, so a joint rests up to a tenth of the play beyond. The two joints about an axis
    that is vertical at home carry nothing, and are left out.
    """
    mujoco, description = load_mujoco(), read_arm("so101")
    model = description.model(step)
    data, joints = mujoco.MjData(model), driven(model)
    play = joints + 1
    assert all(model.joint(number).name.endswith(BACKLASH) for number in play)
    np.testing.assert_allclose(model.jnt_axis[play], model.jnt_axis[joints])
    np.testing.assert_allclose(model.jnt_range[play], np.full((5, 1), HALF_PLAY) * (-1.0, 1.0))
    data.qpos[joints] = description.home
    most = 0.0
    for _ in range(round(2.0 / step)):
        mujoco.mj_forward(model, data)
        held = 998.22 * (description.home - data.qpos[joints]) - 2.731 * data.qvel[joints]
        data.ctrl[:] = np.clip(held, -2.94, 2.94)
        mujoco.mj_step(model, data)
        most = max(most, float(np.abs(data.qpos[play]).max()))
    assert most < 2.0 * HALF_PLAY
    carrying = play[1:4]
    np.testing.assert_allclose(np.abs(data.qpos[carrying]), HALF_PLAY, rtol=0.1)
    np.testing.assert_allclose(data.qvel[carrying], 0.0, atol=1e-3)
