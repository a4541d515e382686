"""Plug-ins that are too slow, give no position, cannot be opened, or do not say where their surface is: all is told."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FunctionType

import odd_drivers
import pytest
from plugin_sessions import run_with
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.devices import RestingOperator
from foretouch.errors import SettingError
from foretouch.plugins import PluginError
from foretouch.recordings import read_session
from foretouch.report import render_text, session_figures, write_page
from foretouch.session import SessionSettings, make_operator, make_session_robot, simulate
from foretouch.session.conformance import Finding, check_device, check_named
from foretouch.session.conformance.catalogue import watched
from foretouch.session.conformance.finding import too_slow

TELEOP = ("teleop", "--headless", "--duration", 4, "--recording", "s.mcap")


# --- what is checked and does not come back, or takes far too long ----------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "name", "check", "found"),
    [("device", "slow", "read time", "ms at the median of"), ("robot", "slow", "exchange time", "ms at the median of")],
)
def test_what_is_far_too_slow_is_told_first_and_nothing_else_looked_at(
    install: Callable[..., None], kind: str, name: str, check: str, found: str
) -> None:
    source = odd_drivers.DEVICE if kind == "device" else odd_drivers.ROBOT
    install("made-up", {kind: {name: f"made_up:{name}"}}, source)
    begun, told = time.monotonic(), []
    ((title, findings),) = check_named(name, kind=kind, tell=lambda of, finding: told.append((of, finding))).items()
    assert time.monotonic() - begun < 5.0
    assert findings[0].check == check
    assert findings[0].passed is False
    assert found in findings[0].summary
    assert len(findings) > 8
    assert all(finding.passed is None and "not looked at" in finding.summary for finding in findings[1:])
    assert told == [(title, finding) for finding in findings]


@pytest.mark.long
def test_what_is_late_by_less_is_looked_at_altogether() -> None:
    def call() -> None:
        end = time.perf_counter() + 5e-4
        while time.perf_counter() < end:
            pass

    assert too_slow("time", call, 2e-4, 5e-3, "the rule", ["other"]) == []
    time_found, other = too_slow("time", call, 2e-4, 4e-4, "the rule", ["other"])
    assert (time_found.passed, time_found.rule) == (False, "the rule")
    assert (other.check, other.passed) == ("other", None)
    begun = time.monotonic()
    result, *_ = too_slow("time", lambda: time.sleep(0.3), 2e-4, 1e-3, "the rule", [])
    assert time.monotonic() - begun < 10.0
    assert "at the median of 10," in result.summary


@pytest.mark.long
def test_a_call_that_does_not_come_back_is_told_after_some_seconds(install: Callable[..., None]) -> None:
    install("made-up", {"device": {"hung": "made_up:hung"}}, odd_drivers.DEVICE)
    begun = time.monotonic()
    result = CliRunner().invoke(app, ["plugins", "check", "hung"])
    assert time.monotonic() - begun < 20.0
    assert result.exit_code == 1
    assert "  kept      name " in result.output  # what was known before
    assert "BROKEN    answers                      a call has not come back for 5 s, in read (made_up.py, line" in (
        result.output
    )
    assert result.output.endswith("1 rule is not kept\n")
    result = CliRunner().invoke(app, ["plugins", "check", "hung", "--json"])
    assert [row["check"] for row in json.loads(result.output)["checks"] if row["passed"] is False] == ["answers"]


def test_one_that_cannot_be_made_is_waited_for_longer_and_then_told(install: Callable[..., None]) -> None:
    install("made-up", {"device": {"stuck": "made_up:stuck"}}, odd_drivers.DEVICE)
    told: list[Finding] = []

    def check(tell: Callable[[Finding], None]) -> None:
        make_operator(SessionSettings(operator="stuck"), surface=0.01, press_depth=0.01, say=print)

    begun = time.monotonic()
    watched(check, told.append, longest=0.1, making=1.0)
    assert 1.0 <= time.monotonic() - begun < 10.0
    assert "in stuck (made_up.py, line" in told[0].summary


def test_a_driver_that_never_comes_back_stops_no_later_check() -> None:
    class Hanging(RestingOperator):
        def read(self, now_ns: int) -> float:
            if now_ns > 0 and threading.current_thread().name == "hangs":
                threading.Event().wait()
            return super().read(now_ns)

    for name in ("hangs", "comes back"):
        checking = threading.Thread(target=check_device, args=(Hanging,), name=name, daemon=True)
        checking.start()
        checking.join(1.0 if name == "hangs" else 60.0)
    assert not checking.is_alive()


def test_many_calls_are_no_long_one_and_what_a_check_raises_is_raised() -> None:
    told: list[Finding] = []

    def nap(seconds: float) -> None:
        time.sleep(seconds)

    def check(tell: Callable[[Finding], None]) -> None:
        tell(Finding("one", True, "", ""))
        for _ in range(30):
            nap(0.05)
        tell(Finding("two", True, "", ""))

    # It stands in the room of the checks, as those of the package do.
    there = check.__globals__ | {"__name__": f"{Finding.__module__}_made_up"}
    in_room = FunctionType(check.__code__, there, closure=check.__closure__)
    watched(in_room, told.append, longest=1.0, making=1.0)
    assert [finding.check for finding in told] == ["one", "two"]

    def raises(tell: Callable[[Finding], None]) -> None:
        raise SettingError("x", 1, "no")

    with pytest.raises(SettingError):
        watched(raises, told.append)


# --- sessions ---------------------------------------------------------------------------------------------------------


@pytest.mark.live
@pytest.mark.long
def test_a_loop_that_its_device_keeps_late_is_said_first(tmp_path: Path) -> None:
    ran = run_with(tmp_path, "device", odd_drivers.DEVICE, "slow", *TELEOP, "--operator", "slow", "--report", "out")
    assert ran.code == 0, ran.err
    line = next(line for line in ran.out.splitlines() if "loop was late" in line)
    assert line.startswith("The leader's loop was late in ")
    assert line.endswith(" of 1000 a second.")
    assert ran.out.index(line) < ran.out.index("Forces at equal command")
    assert line.replace("'", "&#x27;") in (tmp_path / "out" / "index.html").read_text()
    timing = session_figures(read_session(tmp_path / "s.mcap"))["timing"]["leader"]
    assert timing["late_ticks"] > 0.9 * timing["ticks"]
    assert 50.0 < timing["ticks_per_s"] < 340.0


@pytest.mark.live
@pytest.mark.long
def test_an_operator_is_told_that_the_device_gives_no_position(tmp_path: Path) -> None:
    ran = run_with(tmp_path, "device", odd_drivers.DEVICE, "blind", *TELEOP, "--operator", "blind")
    assert ran.code == 0, ran.err
    assert "leader: the device gives no position: the last one is held\n" in ran.err
    assert "The device gave no position in " in ran.out


@pytest.fixture
def not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each figure a page has its caption alone: a drawing takes longer than all else."""
    monkeypatch.setattr("foretouch.report.writing.pages.embedded", lambda figure, caption: caption)


@pytest.mark.usefixtures("not_drawn")
@pytest.mark.long
def test_where_the_device_gives_no_position_nothing_is_scored(install: Callable[..., None], tmp_path: Path) -> None:
    install("made-up", {"device": {"blind": "made_up:blind"}}, odd_drivers.DEVICE)
    settings = SessionSettings(operator="blind", material="hunt-crossley")
    operator = make_operator(settings, surface=0.01, press_depth=0.02, say=print)
    log = simulate(settings, duration=6.0, operator=operator, robot=make_session_robot(settings)[0]).log
    report = session_figures(log)
    assert report["nowhere_samples"] == 3000
    text = render_text(report)
    assert "The device gave no position in 3,000 of 6,000 ticks (50.0 %): the last one was held.\n" in text
    assert "not scored: " in text
    assert "3,000 with no position of the device" in text
    assert report["scored_samples"] <= 1500
    held = log.leader["position"][1500:4500]
    assert (held == held[0]).all()
    assert "The device gave no position" in write_page(tmp_path / "page", log, report).read_text()


@pytest.mark.usefixtures("not_drawn")
@pytest.mark.long
def test_a_robot_of_another_package_is_named_in_place_of_a_material(
    install: Callable[..., None], tmp_path: Path
) -> None:
    install("made-up", {"robot": {"probe": "made_up:probe"}}, odd_drivers.ROBOT)
    settings = SessionSettings(robot="probe", operator="browser")
    output: list[str] = []
    hand = make_operator(settings, surface=float("nan"), press_depth=float("nan"), say=output.append)
    (line,) = output
    assert line.startswith("operator: robot 'probe' does not say where its surface is, so a script stays in the air")
    log = simulate(settings, duration=3.0, operator=hand, robot=make_session_robot(settings)[0]).log
    report = session_figures(log)
    text = render_text(report)
    heading = text.splitlines()[0]
    assert heading.startswith("Session: 3.0 s, robot probe, operator browser, ")
    assert "material" not in heading
    assert "no_contact: " in text
    assert "\nRobot 'probe' does not say where its surface is, so a script stays in the air: take the handle" in text
    page = write_page(tmp_path / "page", log, report).read_text()
    assert '<p class="quiet">3.0 s, robot probe, browser; open loop' in page


@pytest.mark.live
@pytest.mark.long
def test_a_session_that_never_began_has_one_line_and_no_report(tmp_path: Path) -> None:
    ran = run_with(tmp_path, "device", odd_drivers.DEVICE, "cant", *TELEOP, "--operator", "cant")
    assert ran.code == 2
    assert "raises OSError: no device at /dev/lever0 where one is to be made; connect the device and" in ran.err
    assert "no report: the session never began, and s.mcap holds no tick of a leader\n" in ran.err
    assert ran.out == ""


def test_what_cannot_be_opened_is_to_be_connected_and_not_mended(install: Callable[..., None]) -> None:
    install("made-up", {"device": {"cant": "made_up:cant"}}, odd_drivers.DEVICE)
    with pytest.raises(PluginError, match="connect the device and switch it on, and see that you have the right") as at:
        make_operator(SessionSettings(operator="cant"), surface=0.01, press_depth=0.01, say=print)
    assert "uninstall" not in str(at.value)
