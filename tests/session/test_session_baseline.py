"""The baselines: what is rendered, and where theory says that it is stable, that it is not, and that it is heavy."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

from foretouch.devices import GRIPS, Device, Hand, ScriptedOperator
from foretouch.devices.device import minimum_jerk
from foretouch.messages import SessionLog, Telemetry
from foretouch.report import session_figures
from foretouch.robot import make_robot
from foretouch.session import SessionSettings, simulate
from foretouch.session.steps import baseline, leader

PERIOD_NS = 1_000_000


class Press(Device):
    name = "scripted"
    closed_loop = False

    def __init__(self, surface: float, depth: float) -> None:
        self._top, self._way = surface - 0.003, depth + 0.003

    def read(self, now_ns: int) -> float:
        time = now_ns * 1e-9
        down = self._way * minimum_jerk((time - 2.0) / max(0.5, 1.875 * self._way / 0.08))
        return self._top * minimum_jerk(time / 1.5) + down

    def render(self, force: float) -> float:
        return force


def run(operator: Device, settings: SessionSettings, duration: float) -> SessionLog:
    robot = make_robot(settings.material, seed=settings.seed)
    hand = operator if settings.grip == "none" else Hand(operator, GRIPS[settings.grip], settings.device)
    return simulate(settings, duration=duration, operator=hand, robot=robot).log


def made(which: str, material: str, grip: str, round_trip: float, **changes: Any) -> SessionSettings:
    delays = {"position_delay": 0.5 * round_trip, "force_delay": 0.5 * round_trip}
    return SessionSettings(material=material, grip=grip, baseline=which, model="hunt-crossley", **delays, **changes)


@cache
def held(which: str, material: str, grip: str, round_trip: float, seconds: float = 6.0) -> SessionLog:
    robot = make_robot(material, seed=0)
    depth = 0.5 * robot.material.press_depth + 2.0 / GRIPS[grip].stiffness
    press = Press(robot.material.surface, depth)
    # What the robot's own ceiling does is not what is compared.
    return run(press, made(which, material, grip, round_trip, force_ceiling=1000.0), seconds)


def palpated(which: str, material: str, grip: str, round_trip: float, duration: float = 5.0) -> SessionLog:
    robot = make_robot(material, seed=0)
    press = ScriptedOperator(robot.material.surface, robot.material.press_depth)
    return run(press, made(which, material, grip, round_trip), duration)


def swing(log: SessionLog) -> float:
    return float(np.ptp(log.leader["exact_hand_position"][-3000:]))


def surplus(log: SessionLog) -> float:
    """Largest energy that the hand was given beyond the bound of one tick [J]."""
    return float(-np.min(log.leader["energy"] + log.leader["energy_bound"]))


@pytest.mark.parametrize(
    ("which", "material", "grip", "round_trip"),
    [
        *((which, "foam-measured", "normal", late) for which in ("delayed", "delayed-tdpa") for late in (0.0, 0.02)),
        ("delayed", "hunt-crossley", "stiff", 0.4),
    ],
)
@pytest.mark.long
def test_soft_foam_is_stable_at_short_delays_and_what_is_softer_than_the_grip_at_any(
    which: str, material: str, grip: str, round_trip: float
) -> None:
    log = held(which, material, grip, round_trip, 10.0)
    assert swing(log) < 1e-5
    if material == "foam-measured":
        assert surplus(log) <= 0.0
        assert np.mean(log.leader["rendered_force"][-3000:]) > 1.5


STIFF_FOR_ITS_GRIP = [
    ("kelvin-voigt", "stiff", 0.0),
    pytest.param("foam-measured", "normal", 0.4, marks=pytest.mark.long),
    pytest.param("kelvin-voigt", "soft", 0.4, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("material", "grip", "round_trip"), STIFF_FOR_ITS_GRIP)
@pytest.mark.long
def test_the_delayed_force_drives_the_hand_where_the_material_is_stiffer_than_the_grip(
    material: str, grip: str, round_trip: float
) -> None:
    log = held("delayed", material, grip, round_trip)
    assert swing(log) > 2e-3
    assert surplus(log) > 0.01


@pytest.mark.long
@pytest.mark.parametrize(("material", "grip", "round_trip"), STIFF_FOR_ITS_GRIP)
def test_passivity_control_keeps_the_hand_still_there_and_takes_the_force_away(
    material: str, grip: str, round_trip: float
) -> None:
    log = held("delayed-tdpa", material, grip, round_trip)
    free = held("delayed", material, grip, round_trip)
    assert swing(log) < 1e-4
    assert surplus(log) < min(2e-3, 0.1 * surplus(free))
    assert np.mean(log.leader["rendered_force"][-3000:]) < 0.3 * np.mean(log.follower["exact_force"][-3000:])


@pytest.mark.long
def test_without_a_delay_the_force_is_nearly_right_and_with_one_it_is_not() -> None:
    right = session_figures(palpated("delayed", "hunt-crossley", "stiff", 0.0))
    late = session_figures(palpated("delayed", "hunt-crossley", "stiff", 0.5))
    assert right["rendered_error_percent"] < 10.0
    assert late["rendered_error_percent"] > 50.0
    assert right["prediction_error_percent"] == pytest.approx(right["rendered_error_percent"], abs=1.0)


@pytest.mark.long
def test_palpating_with_passivity_control_gives_out_no_more_than_ticks_do() -> None:
    for grip in GRIPS:
        assert surplus(palpated("delayed-tdpa", "foam-measured", grip, 0.4)) < 2e-4


@pytest.mark.long  # what a start imports is tested in tests/cli
def test_no_default_imports_it() -> None:
    code = (
        "import sys; from foretouch.devices import ScriptedOperator; from foretouch.robot import make_robot;"
        "from foretouch.session import SessionSettings, simulate;"
        "settings = SessionSettings(material='hunt-crossley', model='hunt-crossley');"
        "robot = make_robot('hunt-crossley', seed=0);"
        "simulate(settings, duration=0.05, operator=ScriptedOperator(0.02, 0.01), robot=robot);"
        "assert not {'foretouch.session.steps.baseline', 'foretouch.rendering.passivity_control'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_it_guards_only_where_that_is_asked_for() -> None:
    assert SessionSettings(grip="normal").guards()
    assert not SessionSettings(grip="normal", baseline="delayed").guards()
    assert not SessionSettings(grip="normal", baseline="delayed", first_touch="follow").guards()
    assert not SessionSettings().guards()
    assert SessionSettings().guards(simulated=False)
    assert not SessionSettings(first_touch="follow").guards(simulated=False)


def told(sequence: int, force: float, *, in_contact: bool = True) -> Telemetry:
    return Telemetry(3, sequence, 0, 0, 0.01, 0.01, 0.0, force, force, force, in_contact, False, 0, 0, 0)


def ticks(settings: SessionSettings, inputs: list[tuple[float, list[Telemetry], bool]]) -> list[leader.Outputs]:
    state, outputs = baseline.start(settings), []
    for index, (position, telemetry, clutched) in enumerate(inputs):
        given = leader.Inputs(position, telemetry, PERIOD_NS, 0, clutched)
        state, out = leader.step(state, given, index * PERIOD_NS)
        outputs.append(out)
    return outputs


def test_the_newest_delayed_force_is_rendered_times_its_scale_within_the_limits() -> None:
    settings = SessionSettings(grip="normal", baseline="delayed", force_scale=0.5, position_scale=2.0)
    outputs = ticks(settings, [(0.1, [told(2, 4.0), told(1, 9.0)], False), *[(0.1, [], False)] * 20])
    forces = [out.record.rendered_force for out in outputs]
    assert np.max(np.diff(forces)) <= 0.2 + 1e-12
    assert forces[-1] == 2.0
    assert outputs[-1].record.predicted_force == 4.0
    assert outputs[-1].record.mediated_force == 2.0
    assert outputs[0].record.clipped
    assert not outputs[-1].record.clipped


def test_it_couples_where_the_follower_is_and_scales_the_motion() -> None:
    settings = SessionSettings(grip="normal", baseline="delayed", position_scale=2.0)
    outputs = ticks(settings, [(0.1, [], False), (0.1, [told(1, 0.0)], False), (0.103, [], False)])
    positions = [out.command.position for out in outputs]
    assert math.isnan(positions[0])
    assert positions[1:] == pytest.approx([0.01, 0.016])
    assert not any(out.command.guarded or out.command.acknowledged_model for out in outputs)


def test_the_clutch_leaves_the_follower_and_takes_the_force_away() -> None:
    settings = SessionSettings(grip="normal", baseline="delayed")
    first = [(0.1, [told(1, 1.0)], False), *[(0.1, [], False)] * 20]
    apart = [(0.1 + 1e-4 * step, [], True) for step in range(20)]
    outputs = ticks(settings, [*first, *apart, (0.102, [], False), (0.103, [], False)])
    assert outputs[20].record.rendered_force == pytest.approx(1.0)
    assert outputs[40].record.rendered_force == 0.0
    assert not outputs[40].record.engaged
    assert [out.command.position for out in outputs[20:42]] == pytest.approx([0.01] * 22)
    assert outputs[42].command.position == pytest.approx(0.011)


def test_noise_in_free_air_is_not_felt() -> None:
    settings = SessionSettings(grip="normal", baseline="delayed")
    (out,) = ticks(settings, [(0.1, [told(1, 0.03, in_contact=False)], False)])
    assert out.record.rendered_force == 0.0
