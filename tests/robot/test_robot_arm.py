"""The simulated arm: tracking, force limit, sensors, determinism."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError, UnknownNameError
from foretouch.models.predictor import MotionFilter
from foretouch.robot import MATERIALS, RcmArm, RobotSample, make_robot

PERIOD = 1e-3


def run(robot: RcmArm, path: np.ndarray) -> dict[str, np.ndarray]:
    samples = [robot.exchange(position) for position in path.tolist()]
    return {name: np.array([getattr(sample, name) for sample in samples]) for name in RobotSample._fields}


def hand_motion(frequency: float, low: float, high: float, duration: float = 3.0) -> np.ndarray:
    """Smooth presses that start from rest at 0."""
    time = np.arange(0.0, duration, PERIOD)
    swing = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2.0 * np.pi * frequency * time)
    return swing * (1.0 - np.exp(-((time / 0.3) ** 3)))


def lag_after_the_command(desired: np.ndarray, exact: np.ndarray) -> float:
    """Least squares shift [s] of the exact position behind the desired one, from the tick of the command on.

    The sample of an exchange is one period younger than its command: that period counts.
    """
    index = np.arange(desired.size)
    inside = slice(500, -20)
    shifts = np.arange(-2.0, 6.0, 0.05)
    errors = [np.mean((np.interp(index - shift, index, desired) - exact)[inside] ** 2) for shift in shifts]
    return (float(shifts[int(np.argmin(errors))]) + 1.0) * PERIOD


@pytest.mark.parametrize("frequency", [1.0, pytest.param(2.0, marks=pytest.mark.long), 3.0])
@pytest.mark.parametrize(
    ("material", "high"), [("foam-measured", 0.005), ("foam-measured", 0.018), ("hunt-crossley", 0.020)]
)
def test_arm_follows_a_hand_within_two_milliseconds(material: str, high: float, frequency: float) -> None:
    desired = hand_motion(frequency, 0.0, high)
    seen = run(make_robot(material, seed=1), desired)
    assert (seen["exact_force"].max() > 3.0) == (high > 0.010)
    assert 0.0 < lag_after_the_command(desired, seen["exact_position"]) <= 0.002
    assert np.sqrt(np.mean((desired - seen["exact_position"])[500:] ** 2)) < 1e-4
    assert not seen["clipped"].any()


STIFFNESS = {"adhesive": 2e3, "bone": 107e3, "foam": 10e3, "hand": 5e3, "hyperelastic-fe": 2e3, "mullins": 26e3}
STIFFNESS |= {"poroelastic": 2e3, "sphere-viscoelastic": 5e3, "sponge": 2e3, "thin-layer": 12e3}
"""Largest stiffness of a material up to the limit, in and out [N/m]; of the others, whose impacts add nothing, 0."""

STIFF_AT_THE_LIMIT = ("bone", "hand", "mullins", "sphere-viscoelastic", "thin-layer")


@pytest.mark.parametrize("speed", [0.01, pytest.param(0.1, marks=pytest.mark.long), 0.3])
@pytest.mark.parametrize("material", sorted(MATERIALS))
def test_contact_force_ends_within_the_limit(material: str, speed: float) -> None:
    robot = make_robot(material, seed=3)
    goal = robot.surface + 0.020
    seen = run(robot, np.minimum(goal, speed * PERIOD * np.arange(3500)))
    force = seen["exact_force"]
    # the measured force is fed forward with its noise of 0.02 N, which moves the contact force of a stiff material
    assert force[-200:].max() < (15.05 if material in STIFF_AT_THE_LIMIT else 15.001)
    if material == "kelvin-voigt":  # 120 N if nothing held it back
        assert force[-1] > 14.0
        assert seen["clipped"][-200:].all()
        assert seen["commanded_position"][-1] < robot.surface + 0.004
        # its damper jumps by B v where it is touched: the law, not the arm; after 10 ms that is over
        touched = int(np.argmax(force > 0.0))
        force = force[touched + 10 :]
    # what speed and the moving 0.4 kg add where the material is stiff or closes: at most v sqrt(K m)
    assert force.max() < 15.0 * 1.05 + speed * math.sqrt(0.4 * STIFFNESS.get(material, 0.0))


def test_arm_comes_back_at_once_from_a_force_limit() -> None:
    robot = make_robot("kelvin-voigt", seed=3)
    run(robot, np.minimum(0.030, 0.05 * PERIOD * np.arange(1500)))
    seen = run(robot, np.full(200, 0.0))
    assert seen["exact_force"][50] == 0.0
    assert abs(seen["exact_position"][-1]) < 2e-4


@settings(max_examples=12)
@given(
    material=st.sampled_from(sorted(MATERIALS)),
    commands=st.lists(
        st.tuples(
            st.one_of(st.floats(-0.02, 0.06), st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300])),
            st.integers(2, 120),
        ),
        min_size=1,
        max_size=12,
    ),
)
def test_steps_jitter_and_nonsense_never_upset_the_arm(material: str, commands: list[tuple[float, int]]) -> None:
    robot = make_robot(material, seed=5)
    seen = run(robot, np.concatenate([np.full(count, position) for position, count in commands]))
    for values in seen.values():
        assert np.isfinite(values).all()
    assert np.abs(np.diff(seen["exact_position"])).max() < 0.6 * PERIOD
    lowest, highest = robot.specification.workspace
    assert lowest - 0.001 < seen["exact_position"].min()
    assert seen["exact_position"].max() < highest + 0.001


def test_a_step_in_free_air_is_quick_and_does_not_overshoot() -> None:
    seen = run(make_robot("foam-measured", seed=5), np.full(300, -0.015))
    assert seen["exact_position"].min() > -0.0152
    assert seen["exact_position"][120] == pytest.approx(-0.015, abs=1e-4)


def test_late_samples_do_not_shake_the_arm() -> None:
    desired = hand_motion(1.5, 0.0, 0.008)
    generator = np.random.default_rng(0)
    latest = np.maximum.accumulate(np.maximum(np.arange(desired.size) - generator.integers(0, 4, desired.size), 0))
    seen = run(make_robot("foam-measured", seed=5), desired[latest])
    assert np.sqrt(np.mean((desired - seen["exact_position"]) ** 2)) < 2e-4
    assert np.abs(np.diff(seen["exact_position"])).max() < 0.1 * PERIOD


def test_position_that_is_not_finite_keeps_the_last() -> None:
    robot, other = make_robot("foam-measured", seed=5), make_robot("foam-measured", seed=5)
    path = hand_motion(2.0, 0.0, 0.004, 0.4)
    run(robot, path)
    run(other, path)
    assert [robot.exchange(math.nan) for _ in range(5)] == [other.exchange(float(path[-1])) for _ in range(5)]


def quiet_arm(material: str, **options: float) -> RcmArm:
    return make_robot(material, seed=0, encoder_resolution=0.0, encoder_noise=0.0, sensor_noise=0.0, **options)


@pytest.mark.parametrize("material", ["foam-measured", "hunt-crossley"])
def test_sensor_holds_contact_offset_weight_and_inertia(material: str) -> None:
    """Against MuJoCo's own motion: sensor = contact + offset + m (a - g), late by the chain and no more."""
    robot = quiet_arm(material, sensor_bandwidth=2000.0, sensor_offset=0.25)
    seen = run(robot, hand_motion(3.0, 0.0, 0.018))
    position = seen["exact_position"]
    acceleration = np.zeros_like(position)
    acceleration[1:-1] = np.diff(position, 2) / PERIOD**2
    tool = np.array([robot.specification.tool_force(value) for value in acceleration])
    inertia = tool - robot.specification.tool_force(0.0)
    expected = seen["exact_force"] + 0.25 + tool
    expected[1:] = 0.5 * (expected[1:] + expected[:-1])  # MuJoCo gives the force half a period late
    inside = slice(100, -5)
    error = (seen["sensor_force"] - expected)[inside]
    assert np.abs(inertia[inside]).max() > 0.25  # large enough that a wrong sign or mass would show
    assert seen["exact_force"].max() > 3.0
    assert np.sqrt(np.mean(error**2)) < 0.015
    wrong = (seen["sensor_force"] - (expected - 2.0 * inertia))[inside]
    assert np.sqrt(np.mean(wrong**2)) > 10.0 * np.sqrt(np.mean(error**2))


def test_sensor_at_rest_hangs_the_tool_on_itself() -> None:
    robot = quiet_arm("foam-measured", sensor_offset=0.3)
    seen = run(robot, np.zeros(200))
    expected = 0.3 - robot.specification.tool_mass * 9.81
    assert robot.read().sensor_force == pytest.approx(expected, abs=1e-3)
    assert seen["sensor_force"] == pytest.approx(np.full(200, expected), abs=0.02)
    assert (seen["exact_force"] == 0.0).all()


def test_compensated_sensor_force_is_the_contact_force() -> None:
    """As a follower does it: acceleration from the encoders, offset as it was in free air."""
    robot = make_robot("foam-measured", seed=7)
    seen = run(robot, np.concatenate((np.zeros(300), hand_motion(1.0, 0.0, 0.018))))
    motion, change, force = MotionFilter(), MotionFilter(velocity_cutoff=40.0), []
    for k, (position, sensor) in enumerate(zip(seen["position"], seen["sensor_force"], strict=True)):
        acceleration = change.update(k * PERIOD, motion.update(k * PERIOD, position))
        force.append(sensor - robot.specification.tool_force(acceleration))
    offset = float(np.mean(force[100:300]))
    assert offset == pytest.approx(0.3, abs=0.01)
    error = np.array(force)[300:] - offset - seen["exact_force"][300:]
    assert seen["exact_force"].max() > 5.0
    assert np.sqrt(np.mean(error**2)) < 0.15


def test_noise_and_resolution_are_those_of_the_specification() -> None:
    robot = make_robot("foam-measured", seed=11, sensor_noise=0.05)
    seen = run(robot, np.zeros(3000))
    specification = robot.specification
    assert np.std(seen["sensor_force"]) == pytest.approx(0.05, rel=0.1)
    steps = seen["position"] / specification.encoder_resolution
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert 1e-6 < np.std(seen["position"] - seen["exact_position"]) < 5e-6


def test_momentum_balances_the_forces() -> None:
    """What the sensor, the material and gravity do to the tool is what changes its momentum."""
    robot = quiet_arm("foam-measured", sensor_bandwidth=5000.0, sensor_offset=0.0)
    seen = run(robot, hand_motion(2.0, 0.0, 0.016, 1.0))
    velocity = np.gradient(seen["exact_position"], PERIOD)
    specification = robot.specification
    contact = seen["exact_force"]
    contact[1:] = 0.5 * (contact[1:] + contact[:-1])  # as late as the sensor
    net = seen["sensor_force"] - contact + specification.tool_mass * specification.gravity
    impulse = np.cumsum(net[100:]) * PERIOD
    momentum = specification.tool_mass * (velocity[100:] - velocity[99])
    assert np.abs(momentum).max() > 0.005
    assert np.abs(impulse - momentum).max() < 0.1 * np.abs(momentum).max()


def test_probe_gets_no_energy_from_the_foam() -> None:
    """Over whole presses with the real substeps the material takes energy, as measured foam does."""
    seen = run(make_robot("foam-measured", seed=2), hand_motion(2.0, 0.0, 0.018))
    put_in = np.cumsum(seen["exact_force"] * np.gradient(seen["exact_position"]))
    assert put_in.min() > -1e-4
    assert put_in[-1] > 0.02


def test_same_seed_same_samples() -> None:
    path = hand_motion(2.0, 0.0, 0.018, 0.5)
    first, second, other = (make_robot("foam-measured", seed=seed) for seed in (4, 4, 5))
    assert first.read() == second.read()
    samples = [first.exchange(position) for position in path.tolist()]
    assert samples == [second.exchange(position) for position in path.tolist()]
    assert samples != [other.exchange(position) for position in path.tolist()]


def test_read_moves_no_time() -> None:
    robot = make_robot("hunt-crossley", seed=4)
    assert robot.read() == robot.read()
    sample = robot.exchange(0.001)
    assert robot.read() == sample
    robot.close()
    robot.close()


def test_surface_can_be_moved() -> None:
    robot = make_robot("hunt-crossley", seed=4, surface=0.004)
    seen = run(robot, hand_motion(1.0, 0.0, 0.008, 1.0))
    touching = seen["exact_position"][seen["exact_force"] > 0.0]
    assert robot.surface == 0.004
    assert 0.004 < touching.min() < 0.0042


def test_bad_settings_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown material"):
        make_robot("jelly", seed=0)
    bad: list[dict[str, object]] = [
        {"sample_period": 0.0},
        {"force_limit": -1.0},
        {"sensor_noise": math.nan},
        {"workspace": (0.01, 0.02)},
        {"substeps": 1, "sample_period": 0.002},
        {"surface": math.inf},
        {"substeps": 0},
    ]
    for options in bad:
        with pytest.raises(SettingError):
            make_robot("hunt-crossley", seed=0, **options)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="seed"):
        make_robot("hunt-crossley", seed=-1)
