"""One side of a session from the command line: the emergency stop, the shadow, what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path

import msgspec
import pytest
from typed_commands import run

from foretouch.cli import as_typed
from foretouch.cli.options import Endpoints
from foretouch.errors import ForetouchError, LinkError, SettingError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Status, Telemetry

BADLY_CALIBRATED = ("--listen", "tcp/127.0.0.1:7447", "--calibration", "no.toml", "--duration", 1)
TELEMETRY = Telemetry(VERSION, 1, 1, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 0, 1, 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("stop", "--connect", "nonsense"), "endpoint 'nonsense'"),
        (("stop", "--connect", "tcp/192.0.2.1:7447"), "--insecure"),
        (("stop", "--connect", "tls/127.0.0.1:7447", "--keys", "/nowhere"), "keys"),
        (("follower", "--shadow"), "no endpoint: give --listen or --connect"),
        (("follower", "--shadow", "--duration", 0), "duration = 0.0: must be finite and above 0 s"),
        (("follower", "--shadow", "--material", "jelly"), "unknown material 'jelly'"),
        (("follower", *BADLY_CALIBRATED), "no.toml: cannot be read"),
        (("follower", "--shadow", *BADLY_CALIBRATED), "no.toml: cannot be read"),
        (("teleop", "--calibration", "no.toml", "--headless", "--duration", 1), "no.toml: cannot be read"),
        pytest.param(
            ("simulate", "--calibration", "no.toml", "--scene", "plane", "--duration", 1),
            "no.toml: cannot be read",
            marks=pytest.mark.long,
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(arguments: tuple[object, ...], message: str) -> None:
    result = run(*arguments)
    assert isinstance(result.exception, ForetouchError)
    assert message in str(result.exception)
    assert "\n" not in str(result.exception)


def test_who_stops_a_robot_waits_for_no_laws_and_robots() -> None:
    code = "import sys; from foretouch.link import ask_to_stop; print(*sys.modules)"
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "foretouch.link" in there
    assert not {"numba", "scipy", "mujoco", "foretouch.session"} & set(there)


def test_endpoints_are_given_as_they_were_typed() -> None:
    assert str(Endpoints(["tcp/127.0.0.1:1"], ["tcp/127.0.0.1:2"])) == "tcp/127.0.0.1:1, tcp/127.0.0.1:2"
    assert Endpoints().all == ()


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for five seconds here."""
    monkeypatch.setattr("foretouch.cli.commands.sides.PATIENCE", 0.5)


@pytest.mark.network
@pytest.mark.usefixtures("quick")
def test_a_stop_that_nobody_hears_is_said_to_be_none() -> None:
    endpoint = free_endpoint()
    result = run("stop", "--connect", endpoint)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr == (
        f"foretouch: NOT stopped (after 0.5 s): no follower is heard at {endpoint}; stop it by its own switch\n"
    )


FOLLOWER = """
import os, signal, sys, time
from foretouch.link import WaitingNote
note, asked = WaitingNote(), []
signal.signal(signal.SIGUSR1, lambda *_: asked.append(1))
note.say("")
print("ready", flush=True)
for _ in range(2000):
    time.sleep(0.01)
    if asked:
        again = "" if "shadow" in sys.argv else f"; to release it at rest: foretouch release {os.getpid()}"
        note.say(f"emergency stop (asked for by signal): it unloads{again}")
"""
"""A process that says what a follower says when it is stopped by signal; a shadow moves no robot."""


@pytest.mark.usefixtures("quick")
def test_without_endpoints_the_followers_of_this_machine_are_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    result = run("stop")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith("foretouch: NOT stopped: no follower of yours runs on this machine; give --connect")
    assert json.loads(run("stop", "--json").stdout) == {"stopped": False, "followers": []}
    started = []
    try:
        for words, code in (((), 0), (("shadow",), 1)):
            process = subprocess.Popen([sys.executable, "-c", FOLLOWER, *words], stdout=subprocess.PIPE, text=True)
            started.append(process)
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            result = run("stop")
            assert result.exit_code == code
            assert f"follower {started[0].pid} has stopped: emergency stop (asked for by signal)" in result.stdout
            assert (f"follower {process.pid} NOT stopped (after 0.5 s)" in result.stderr) == bool(code)
    finally:
        for process in started:
            process.kill()
            process.communicate()


@pytest.mark.long
def test_a_setting_is_named_as_the_option_that_was_typed() -> None:
    wrong = SettingError("force_delay", -1.0, "must be at least 0")
    assert as_typed(wrong, ["simulate", "--force-delay", "-1"]) == "--force-delay = -1.0: must be at least 0"
    assert as_typed(wrong, ["simulate", "--force-delay=-1"]) == "--force-delay = -1.0: must be at least 0"
    assert as_typed(wrong, ["report", "a.mcap"]) == str(wrong)
    assert as_typed(LinkError("no peer"), ["stop"]) == "no peer"
    typed = [sys.executable, "-m", "foretouch", "simulate", "--loss", "3"]
    output = subprocess.run(typed, capture_output=True, text=True, check=False)
    assert (output.returncode, output.stdout) == (2, "")
    assert output.stderr.startswith("foretouch: --loss = 3.0: ")


class Peer(threading.Thread):
    """Says telemetry with a status 200 times a second, and another one from the third request on."""

    def __init__(self, link: ZenohLink, before: int, after: int) -> None:
        super().__init__()
        self.link, self.before, self.after = link, before, after
        self.reasons: list[str] = []
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(0.005):
            self.reasons += [message.reason for _, message in self.link.take("emergency")]
            status = self.after if len(self.reasons) >= 3 else self.before
            self.link.publish(msgspec.structs.replace(TELEMETRY, status=status))


@pytest.mark.network
@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("after", [Status.STOPPED, Status.SHADOW, 77])
def test_it_is_asked_for_until_telemetry_says_so(after: int) -> None:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=["emergency"]) as link:
        peer = Peer(link, Status.FOLLOWING, after)
        peer.start()
        try:
            result = run("stop", "--connect", endpoint)
        finally:
            peer.ended.set()
            peer.join()
    assert len(peer.reasons) >= 3
    assert all(reason.startswith("asked for by ") for reason in peer.reasons)
    if after == Status.STOPPED:
        assert (result.exit_code, result.stderr) == (0, "")
        assert result.stdout.startswith("the robot has stopped: ")
        return
    assert (result.exit_code, result.stdout) == (1, "")
    doing = "commands nothing: somebody else moves the robot" if after == Status.SHADOW else "no follower is heard"
    assert doing in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.long
@pytest.mark.network
def test_a_shadow_that_another_process_records_gives_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint, path = free_endpoint(), tmp_path / "shadow.mcap"

    def start(*arguments: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "foretouch", *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    monkeypatch.setenv("FORETOUCH_MATERIALS", str(tmp_path / "materials"))
    options = ("--shadow", "--material", "hunt-crossley", "--force-delay", 0.2, "--duration", 5, "--remember", "soft")
    processes = [
        start("follower", "--listen", endpoint, *options, "--insecure"),
        start("record", path, "--connect", endpoint),
    ]
    try:
        ends = [process.communicate(timeout=60) for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert [process.returncode for process in processes] == [0, 0], ends
    output = ends[0][1]
    assert "the scripted operator moves it and nothing is commanded" in output
    assert f"remember: {tmp_path / 'materials' / 'soft.json'}" in output
    assert "s in contact at" in output.splitlines()[-1]
    report = json.loads(run("report", path, "--json").stdout)
    assert report["status"] == "ok"
    assert report["operator"] == "shadow"
    assert (report["settings"]["position_delay"], report["settings"]["force_delay"]) == ("0.0", "0.2")
    assert (report["settings"]["material"], report["settings"]["surface"]) == ("hunt-crossley", "0.01")
    assert report["tracking_error"]["max_mm"] == 0.0
    assert report["prediction_error_percent"] < 0.5 * report["delayed_force_error_percent"]
    known = json.loads(run("predict", path, "--delay", 0.2, "--json").stdout)
    assert known["prediction_error_percent"] == pytest.approx(report["prediction_error_percent"], abs=2.0)
