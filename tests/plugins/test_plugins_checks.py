"""The conformance checks: what the package brings passes them, and each catches what it is for."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import pytest
from plugin_packages import EXAMPLE
from typer.testing import CliRunner

sys.path.insert(0, str(EXAMPLE / "src"))

import wrong_devices
import wrong_estimators
import wrong_materials
import wrong_robots
from foretouch_plugin_example.windowed import Windowed

from foretouch.cli.app import app
from foretouch.identification import ESTIMATORS, make_estimator
from foretouch.session.conformance import (
    BUILT_IN,
    Finding,
    check_device,
    check_estimator,
    check_material,
    check_named,
    check_robot,
    failed,
)
from foretouch.settings import ARMS

HARDWARE = ("gamepad", "force-dimension")
"""Not on this machine: with a pad and a binding that stand in for them, in `tests/devices`."""
LEARNT = [(law, name) for law, names in ESTIMATORS.items() for name in names]


SEARCHING = ("ur5e", "so101")
"""Arms whose inverse kinematics takes much of a period: a busy machine is late with them."""


def summary(findings: list[Finding]) -> dict[str, bool | None]:
    return {finding.check: finding.passed for finding in findings}


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(kind, name, marks=[pytest.mark.live] if kind == "robot" else [])  # its exchanges are timed
        for kind in ("robot", "device", "material")
        for name in BUILT_IN[kind]
    ],
)
@pytest.mark.first
def test_what_the_package_brings_passes(kind: str, name: str) -> None:
    if name in HARDWARE:
        pytest.skip("needs a thing in the hand")
    for findings in check_named(name, kind=kind).values():
        timed = [finding for finding in findings if finding.check != "exchange time" or name not in SEARCHING]
        assert failed(timed) == []
        unseen = {finding.check for finding in timed if finding.passed is None}
        assert unseen == ({"sign of acceleration"} if name in ARMS else set())  # and all else was seen


@pytest.mark.parametrize(
    ("law", "name"),
    [
        pytest.param(law, name, marks=[pytest.mark.long] if name == "offline" and law != "kelvin-voigt" else [])
        for law, name in LEARNT
    ],
)
@pytest.mark.first
def test_every_estimator_of_the_package_passes(law: str, name: str) -> None:
    assert failed(check_estimator(lambda: make_estimator(law, name), name=name)) == []


def test_those_that_the_wrong_ones_derive_from_are_right() -> None:
    assert set(summary(check_device(wrong_devices.Held)).values()) == {True}
    assert set(summary(check_robot(wrong_robots.Rail)).values()) == {True}
    right = check_material(lambda: wrong_materials.material(wrong_materials.Spring()), name="test")
    assert set(summary(right).values()) == {True}
    assert set(summary(check_estimator(Windowed, name="windowed")).values()) == {True}


def caught(findings: list[Finding], case: str, message: str) -> None:
    """The check fails, and its sentence says what was found."""
    (finding,) = [one for one in findings if one.check == case.partition(" / ")[0]]
    assert finding.passed is False, findings
    assert message in finding.summary
    assert finding.rule


@pytest.mark.parametrize("case", wrong_devices.WRONG)
@pytest.mark.first
def test_a_wrong_device_is_caught(case: str) -> None:
    make, message = wrong_devices.WRONG[case]
    caught(check_device(make), case, message)


@pytest.mark.parametrize("case", wrong_robots.WRONG)
def test_a_wrong_robot_is_caught(case: str) -> None:
    make, message = wrong_robots.WRONG[case]
    caught(check_robot(make), case, message)


@pytest.mark.parametrize("case", wrong_materials.WRONG)
def test_a_wrong_material_is_caught(case: str) -> None:
    make, message = wrong_materials.WRONG[case]
    caught(check_material(make, name="test"), case, message)


@pytest.mark.parametrize("case", wrong_estimators.WRONG)
@pytest.mark.first
def test_a_wrong_estimator_is_caught(case: str) -> None:
    make, message = wrong_estimators.WRONG[case]
    caught(check_estimator(make, name="windowed"), case, message)


def test_every_check_has_one_that_it_catches() -> None:
    """A check that nothing fails would check nothing."""
    result: dict[str, tuple[list[Finding], dict[str, object]]] = {
        "device": (check_device(wrong_devices.Held), dict(wrong_devices.WRONG)),
        "robot": (check_robot(wrong_robots.Rail), dict(wrong_robots.WRONG)),
        "material": (check_material(wrong_materials.WRONG["name"][0]), dict(wrong_materials.WRONG)),
        "estimator": (check_estimator(Windowed), dict(wrong_estimators.WRONG)),
    }
    for findings, wrong in result.values():
        assert {finding.check for finding in findings} == {case.partition(" / ")[0] for case in wrong}


def test_what_cannot_be_seen_is_not_called_broken() -> None:
    assert summary(check_device(wrong_devices.Still))["sign of position"] is None

    class Real(wrong_robots.Rail):
        """Fails if it is told to go anywhere."""

        def __init__(self) -> None:
            super().__init__()
            from dataclasses import replace

            self.specification = replace(self.specification, simulated=False)
            self.asked: list[float] = []

        def exchange(self, desired_position: float) -> object:  # type: ignore[override]
            self.asked.append(desired_position)
            return super().exchange(desired_position)

    robot = Real()
    result = summary(check_robot(lambda: robot))
    assert not any(abs(position) < float("inf") for position in robot.asked)
    assert result["sign of position"] is None
    assert summary(check_robot(Real, move=True))["sign of position"] is True
    assert summary(check_robot(Real, move=True))["sign of force"] is None


def test_what_was_not_seen_is_not_told_as_kept(install: Callable[..., None]) -> None:
    source = "from dataclasses import replace\nfrom wrong_robots import Rail\n"
    source += "def make(settings):\n    rail = Rail()\n"
    source += "    rail.specification = replace(rail.specification, simulated=False)\n    return rail\n"
    install("real", {"robot": {"arm": "real:make"}}, source)
    output = CliRunner().invoke(app, ["plugins", "check", "arm"]).output
    assert "  not seen  workspace                    it is a real one, which no check drives into anything" in output
    assert output.endswith("\n6 rules are kept, 5 were not seen; --move shows 2 of them\n")
    output = CliRunner().invoke(app, ["plugins", "check", "arm", "--move"]).output
    assert output.endswith("\n8 rules are kept, 3 were not seen\n")


@pytest.mark.parametrize("make", [lambda: 3, dict])
@pytest.mark.parametrize("check", [check_device, check_robot, check_material, check_estimator])
def test_something_else_altogether_is_caught(check: Callable[..., list[Finding]], make: Callable[[], object]) -> None:
    (finding,) = check(make)
    assert finding.passed is False


def test_the_command_prints_what_was_found_and_ends_with_1_where_a_rule_is_broken(
    install: Callable[..., None],
) -> None:
    result = CliRunner().invoke(app, ["plugins", "check", "sponge", "--json"])
    assert result.exit_code == 0
    output = json.loads(result.output)
    assert output["passed"] is True
    assert {row["of"] for row in output["checks"]} == {"material sponge"}
    source = "from foretouch.devices import ScriptedOperator\nclass Mine(ScriptedOperator):\n    name = 'mine'\n"
    source += "    def read(self, now_ns): return -super().read(now_ns)\n"
    source += "def make(settings, reach): return Mine(*reach)\n"
    install("wrong", {"device": {"mine": "wrong:make"}}, source)
    result = CliRunner().invoke(app, ["plugins", "check", "mine"])
    assert result.exit_code == 1
    assert "BROKEN    sign of position" in result.output
    assert "the rule: positions grow into the material" in result.output
    assert result.output.endswith("1 rule is not kept\n")
