"""Names of other packages: taken where built-in names are, looked for only then, refused in one line."""

from __future__ import annotations

import importlib.metadata
import json
import re
import subprocess
import sys
from collections.abc import Callable

import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.comparison import combinations
from foretouch.errors import ForetouchError, SettingError, UnknownNameError
from foretouch.identification import ESTIMATORS, make_estimator
from foretouch.plugins import PluginError, all_plugins
from foretouch.robot import make_material
from foretouch.session import SessionSettings, make_operator, make_session_robot
from foretouch.session.conformance import catalogue

GOOD = """
from foretouch.devices import ScriptedOperator
from foretouch.identification.classic.least_squares import KelvinVoigtRLS
from foretouch.robot import Material, make_robot
from foretouch.models import HuntCrossley

class Steady(ScriptedOperator):
    name = "steady"

def steady(settings, reach):
    return Steady(reach.surface, reach.press_depth)

def jelly():
    return Material("jelly", "soft", "made up", HuntCrossley(500.0, 100.0, 1.4), 0.01)

class Own(KelvinVoigtRLS):
    name = "own"

def arm(settings):
    return make_robot("foam", seed=settings.seed)

number = 3
def raises(*_): raise OSError("no device at /dev/x")
def makes_text(*_): return "text"
class NoEstimator: pass
class OtherName(KelvinVoigtRLS): name = "other"
"""
POINTS = {
    "device": {"steady": "good:steady"},
    "material": {"jelly": "good:jelly"},
    "estimator": {"own": "good:Own"},
    "robot": {"arm": "good:arm"},
}

Install = Callable[..., None]


def run(*words: str) -> tuple[int, str]:
    """Exit code and the one line of a command that is refused."""
    result = CliRunner().invoke(app, list(words))
    assert isinstance(result.exception, ForetouchError | None | SystemExit), result.exception
    if isinstance(result.exception, ForetouchError):  # `main` makes exit code 2 and this line of it
        return 2, str(result.exception)
    return result.exit_code, result.output


def test_all_four_kinds_are_taken_by_name(install: Install) -> None:
    install("good", POINTS, GOOD)
    settings = SessionSettings(operator="steady", robot="arm", model="kelvin-voigt", estimator="own")
    robot, reach = make_session_robot(settings)
    operator = make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=pytest.fail)
    assert (operator.name, settings.make_estimator().name) == ("steady", "own")
    foam = make_material("foam")  # the robot says that it presses it
    assert (reach.surface, reach.press_depth) == (foam.surface, foam.press_depth)
    assert make_material("jelly").description == "soft"
    assert SessionSettings(material="jelly").material == "jelly"
    assert robot.specification.simulated
    assert ("kelvin-voigt", "own") in combinations(estimators=["own"])
    assert ("kelvin-voigt", "own") in combinations()


def test_names_that_are_built_in_look_through_no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(**_: object) -> object:
        raise AssertionError("packages were looked through")

    monkeypatch.setattr(importlib.metadata, "entry_points", never)
    all_plugins.cache_clear()
    for operator in ("scripted", "recorded", "browser", "gamepad", "force-dimension"):
        SessionSettings(operator=operator)
    for model, estimators in ESTIMATORS.items():
        make_estimator(model, next(iter(estimators)))
    make_material("foam")
    SessionSettings(material="foam")
    with pytest.raises(AssertionError, match="looked through"):
        make_material("jelly")


def test_help_and_import_touch_no_plugin() -> None:
    """Neither the room nor what finds entry points is imported by what starts every command."""
    code = (
        "import sys, foretouch, foretouch.cli.app as a\n"
        "from typer.main import get_command\n"
        "get_command(a.app).get_help(__import__('typer').Context(get_command(a.app)))\n"
        "print(sorted(n for n in sys.modules if n.startswith('foretouch.plugins')))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


BROKEN = {
    "missing module": ({"device": {"wobble": "nowhere:x"}}, "raises ModuleNotFoundError: No module named 'nowhere'"),
    "missing attribute": ({"device": {"wobble": "bad:x"}}, "raises AttributeError"),
    "raises at import": ({"device": {"wobble": "raising:x"}}, "raises RuntimeError: two lines at import"),
    "exits at import": ({"device": {"wobble": "leaving:x"}}, "raises SystemExit: 5 at import"),
    "nothing to call": ({"device": {"wobble": "bad:number"}}, "is an int and not something to call"),
    "factory raises": ({"device": {"wobble": "bad:raises"}}, "raises OSError: no device at /dev/x"),
    "factory's type": ({"device": {"wobble": "bad:makes_text"}}, "makes a str and not a Device"),
    "robot raises": ({"robot": {"wobble": "bad:raises"}}, "raises OSError: no device at /dev/x"),
    "robot's type": ({"robot": {"wobble": "bad:makes_text"}}, "makes a str and not a Robot"),
    "material's type": ({"material": {"wobble": "bad:makes_text"}}, "makes a str and not a Material"),
    "no estimator": ({"estimator": {"wobble": "bad:NoEstimator"}}, "is no class that derives from"),
    "estimator's name": ({"estimator": {"wobble": "bad:OtherName"}}, "has name = 'other'"),
}
OPTIONS = {"device": "--operator", "robot": "--robot", "material": "--material", "estimator": "--estimator"}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_one_is_one_clear_line_and_others_work(install: Install, case: str) -> None:
    points, message = BROKEN[case]
    install("raising", {}, "raise RuntimeError('two\\nlines')")
    install("leaving", {}, "raise SystemExit(5)")
    install("good", POINTS, GOOD)
    install("bad", points, GOOD)
    (kind,) = points
    code, line = run("simulate", OPTIONS[kind], "wobble", "--duration", "1", "--model", "kelvin-voigt")
    assert code == 2
    assert "\n" not in line
    assert message in line
    target = next(iter(points[kind].values()))
    assert f"{kind} 'wobble' (bad 1.2, entry point wobble = '{target}' of foretouch.{kind}s)" in line
    missing = f"connect the {kind} and switch it on, and see that you have the right to open it"
    assert line.endswith(missing if "OSError" in message else "mend bad or uninstall it")
    assert make_material("jelly").name == "jelly"
    assert SessionSettings(operator="steady", robot="arm").operator == "steady"
    code, line = run("plugins", "check", "wobble")
    assert code == 2
    assert message in line


def test_a_name_that_is_there_twice_is_nobodys(install: Install) -> None:
    install("good", POINTS, GOOD)
    install("twin", {"material": {"jelly": "twin:jelly"}}, GOOD, version="3")
    with pytest.raises(
        PluginError, match=r"the name is there 2 times: good 1.2 \(good:jelly\) and twin 3 \(twin:jelly"
    ):
        make_material("jelly")
    assert SessionSettings(operator="steady").operator == "steady"
    assert [entry.problem != "" for entry in catalogue() if entry.name == "jelly"] == [True, True]


@pytest.mark.parametrize(("kind", "name"), [("device", "scripted"), ("material", "foam"), ("estimator", "rls")])
def test_a_built_in_name_stays_foretouchs_and_the_other_is_told(install: Install, kind: str, name: str) -> None:
    install("thief", {kind: {name: "thief:raises"}}, GOOD)
    assert make_material("foam").name == "foam"
    assert SessionSettings(model="kelvin-voigt", estimator="rls").make_estimator().name == "rls"
    (entry,) = [entry for entry in catalogue() if entry.package == "thief"]
    assert entry.problem == f"the name is that of a built-in {kind}"
    code, line = run("plugins", "check", name, "--group", kind)
    assert (code, "thief 1.2" in line) == (2, True)
    assert line.endswith("ask thief for another name")


def test_an_estimator_of_another_law_says_which(install: Install) -> None:
    install("good", POINTS, GOOD)
    with pytest.raises(SettingError, match="learns the law kelvin-voigt and not contact-map: give --model"):
        SessionSettings(estimator="own")
    with pytest.raises(UnknownNameError, match=r"unknown estimator for kelvin-voigt 'nix': choose one of .*own"):
        SessionSettings(model="kelvin-voigt", estimator="nix")
    with pytest.raises(UnknownNameError, match="estimator for hunt-crossley 'own'"):
        combinations(models=["hunt-crossley"], estimators=["own"])


def test_unknown_names_list_those_of_packages(install: Install) -> None:
    install("good", POINTS, GOOD)
    for options, choice in (({"operator": "x"}, "steady"), ({"robot": "x"}, "arm")):
        with pytest.raises(UnknownNameError, match=rf"choose one of .*\b{choice}\b"):
            SessionSettings(**options)
    with pytest.raises(UnknownNameError, match=r"choose one of .*\bjelly\b"):
        make_material("x")


def test_the_list_has_all_and_the_broken_with_the_reason(install: Install) -> None:
    install("good", POINTS, GOOD)
    install("bad", {"device": {"wobble": "nowhere:x"}})
    code, output = run("plugins", "--json")
    assert code == 0
    rows = json.loads(output)["plugins"]
    result = {(row["kind"], row["name"]): row for row in rows}
    assert (
        result["device", "steady"] | {"package": "good", "version": "1.2", "status": "ok"} == result["device", "steady"]
    )
    assert result["estimator", "own"]["laws"] == ["kelvin-voigt"]
    assert result["device", "wobble"]["status"] == "broken"
    assert "No module named 'nowhere'" in result["device", "wobble"]["problem"]
    assert result["robot", "simulated"]["package"] == "foretouch"
    assert {row["status"] for row in rows if row["package"] == "foretouch"} == {"ok"}
    code, text = run("plugins")
    assert re.search(r"^device +wobble +bad 1.2\n +broken: raises ModuleNotFoundError", text, re.MULTILINE)
    code, text = run("materials", "list")
    assert re.search(r"^jelly .*soft$", text, re.MULTILINE)
