"""The way to a peer: real links over loopback, with delays and losses of a seeded network."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.doctor import Verdict
from foretouch.doctor.network import DOCTOR_CHANNELS, RATE, Answerer, RoundTrips, ask, check_peer, judge_round_trips
from foretouch.errors import LinkError, PeerVersionError
from foretouch.link import Faults, KeyFolder, ZenohLink, free_endpoint, load_credentials
from foretouch.link.certificates import utc_now
from foretouch.messages import VERSION, Hello, Message, Telemetry

pytest.importorskip("zenoh")
pytestmark = pytest.mark.network

Opens = Callable[[Callable[[Message], None]], ZenohLink]


def connecting(endpoint: str) -> Opens:
    return lambda watch: ZenohLink(connect=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch)


@contextmanager
def answering(faults: Faults | None = None) -> Iterator[str]:
    """A peer that answers, behind a network with faults; gives its endpoint."""
    endpoint, ended = free_endpoint(), threading.Event()
    answerer = Answerer(lambda watch: ZenohLink(listen=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch), faults)
    thread = threading.Thread(target=answerer.run, args=(ended.is_set,))
    thread.start()
    try:
        yield endpoint
    finally:
        ended.set()
        thread.join()
        answerer.close()


def checked(endpoint: str, seconds: float = 1.0) -> dict[str, tuple[Verdict, str, str]]:
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    findings = check_peer(endpoint, host, int(port), connecting(endpoint), seconds)
    return {finding.name.split()[0]: (finding.verdict, finding.summary, finding.mend) for finding in findings}


def test_a_peer_beside_answers_every_question_at_once() -> None:
    with answering() as endpoint:
        received = ask(connecting(endpoint), 1.0)
    assert received.roles == {"doctor"}
    assert received.asked == RATE
    assert received.loss == 0.0
    assert 0.0 < received.percentile(0.5) < 0.02
    assert received.percentile(1.0) == max(received.times)


@pytest.mark.long
def test_a_delay_and_losses_of_the_network_are_measured() -> None:
    with answering(Faults(delay=0.12, loss=0.3, seed=4)) as endpoint:
        received = ask(connecting(endpoint), 3.0)
    assert min(received.times) >= 0.12
    assert statistics.median(received.times) == pytest.approx(0.12, abs=0.02)
    # 300 independent losses of 0.3: their share is within four standard deviations, 4 sqrt(0.3 0.7 / 300) = 0.106.
    assert received.loss == pytest.approx(0.3, abs=0.106)
    finding = judge_round_trips("link", received, "")
    assert finding.verdict is Verdict.BAD
    assert "foretouch simulate --position-delay 0.06" in finding.mend


@pytest.mark.long
def test_jitter_that_makes_a_follower_hold_is_a_warning() -> None:
    with answering(Faults(delay=0.1, jitter=0.08, seed=1)) as endpoint:
        result = checked(endpoint)
    assert result["reach"][0] is Verdict.GOOD
    verdict, _, mend = result["link"]
    assert verdict is Verdict.WARNING
    assert "--jitter" in mend


@pytest.mark.long
def test_two_who_ask_at_once_count_their_own_answers_alone() -> None:
    with answering() as endpoint:
        results: list[RoundTrips] = []
        threads = [threading.Thread(target=lambda: results.append(ask(connecting(endpoint), 1.0))) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert [(len(received.times), received.asked) for received in results] == [(RATE, RATE)] * 2


def test_nobody_at_the_port_is_bad_and_says_what_to_start_there() -> None:
    endpoint = free_endpoint()
    result = checked(endpoint)
    assert result.keys() == {"reach"}
    verdict, output, mend = result["reach"]
    assert verdict is Verdict.BAD
    assert "no program listens" in output
    assert mend == f"on the other machine: foretouch doctor --listen {endpoint}"


def test_an_unknown_host_is_bad() -> None:
    (finding,) = check_peer("tcp/no-such-host.invalid:7447", "no-such-host.invalid", 7447, connecting(""), 1.0)
    assert finding.verdict is Verdict.BAD
    assert finding.mend == "getent hosts no-such-host.invalid"


def test_an_endpoint_that_answers_nothing_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    """A listener whose queue is full answers no further connection, as a firewall does."""
    monkeypatch.setattr("foretouch.doctor.network.CONNECT_PATIENCE", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(0)
        address = silent.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for each in waiting:
            each.setblocking(False)
            each.connect_ex(address)
        time.sleep(0.1)
        result = checked(f"tcp/127.0.0.1:{address[1]}")
        for each in waiting:
            each.close()
    verdict, output, mend = result["reach"]
    assert verdict is Verdict.BAD
    assert "nothing came back within 0.5 s" in output
    assert mend == f"on the other machine: sudo ufw allow {address[1]}/tcp"


@pytest.mark.long
def test_another_program_at_the_port_is_a_warning() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        result = checked(f"tcp/127.0.0.1:{other.getsockname()[1]}", seconds=0.2)
    assert result["reach"][0] is Verdict.GOOD
    assert result["link"][0] is Verdict.WARNING
    assert "no side of a session answers" in result["link"][1]


@pytest.mark.long
@pytest.mark.parametrize("beside_a_doctor", [False, True])
def test_a_session_is_listened_to_and_nothing_is_sent_into_it(beside_a_doctor: bool) -> None:
    """A follower that loses every tenth of its messages; what arrives there is counted. A doctor may be there too."""
    endpoint, ended, arrived = free_endpoint(), threading.Event(), []
    everything = ("command", "settings", "stop", "emergency", "hello", "handle", "choice")
    link = ZenohLink(listen=[endpoint], subscribe=everything, watch=arrived.append)

    def speak() -> None:
        sequence = 0
        while not ended.is_set():
            sequence += 1
            now = time.monotonic_ns()
            if sequence % 100 == 1:
                link.publish(Hello(VERSION, sequence, now, "follower", ("material",), ("foam",)))
                if beside_a_doctor:
                    link.publish(Hello(VERSION, sequence, now, "doctor", ("present",), ("yes",)))
            if sequence % 10:
                link.publish(
                    Telemetry(VERSION, sequence, now, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 0, 1, 1, run=7)
                )
            time.sleep(0.002)

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        received = ask(connecting(endpoint), 1.0)
    finally:
        ended.set()
        thread.join()
        link.close()
    assert received.roles == ({"follower", "doctor"} if beside_a_doctor else {"follower"})
    assert received.asked == 0
    assert received.received > 50
    assert received.loss == pytest.approx(0.1, abs=0.02)
    assert 0.002 < received.longest_gap < 1.0
    assert {message.role for message in arrived if isinstance(message, Hello)} <= {"follower", "doctor"}
    assert not [message for message in arrived if isinstance(message, Hello) and message.names == ("asks",)]
    assert all(isinstance(message, Hello) for message in arrived)
    assert "the round trip needs a doctor there" in judge_round_trips("link", received, "").summary


@pytest.mark.long
def test_a_peer_of_another_version_is_bad() -> None:
    endpoint, ended = free_endpoint(), threading.Event()
    link = ZenohLink(listen=[endpoint], subscribe=())

    def speak() -> None:
        while not ended.is_set():
            link.publish(Hello(VERSION + 1, 1, 1, "follower", (), ()))
            time.sleep(0.05)

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        with pytest.raises(PeerVersionError):
            ask(connecting(endpoint), 0.2)
        verdict, output, mend = checked(endpoint, seconds=0.2)["link"]
    finally:
        ended.set()
        thread.join()
        link.close()
    assert verdict is Verdict.BAD
    assert "message version" in output
    assert mend.startswith("pip install")


@pytest.mark.long
def test_between_machines_watchers_ask_and_answer(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    folder = KeyFolder(tmp_path / "keys")
    folder.init(utc_now())
    folder.issue("watcher", "", utc_now())
    credentials = load_credentials("watcher", folder.path)
    endpoint, ended = free_endpoint("tls"), threading.Event()

    def opens(**where: list[str]) -> Opens:
        return lambda watch: ZenohLink(**where, subscribe=DOCTOR_CHANNELS, watch=watch, credentials=credentials)

    answerer = Answerer(opens(listen=[endpoint]))
    thread = threading.Thread(target=answerer.run, args=(ended.is_set,))
    thread.start()
    try:
        received = ask(opens(connect=[endpoint]), 0.5)
    finally:
        ended.set()
        thread.join()
        answerer.close()
    assert received.roles == {"doctor"}
    assert received.loss == 0.0


def test_keys_that_are_missing_are_a_bad_link() -> None:
    def refuse(watch: Callable[[Message], None]) -> ZenohLink:
        raise LinkError("no keys")

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        _, link = check_peer(f"tls/127.0.0.1:{port}", "127.0.0.1", port, refuse, 0.1)
    assert (link.verdict, link.summary, link.mend) == (Verdict.BAD, "no keys", "foretouch keys show")


def test_figures_of_nothing_are_none() -> None:
    assert math.isnan(RoundTrips().loss)
    assert math.isnan(RoundTrips().percentile(0.5))
    assert judge_round_trips("link", RoundTrips(frozenset({"doctor"}), 10), "there").verdict is Verdict.BAD


@pytest.mark.long
def test_the_command_answers_and_asks(tmp_path: Path) -> None:
    endpoint, unused = free_endpoint(), free_endpoint()
    answers = subprocess.Popen(
        [sys.executable, "-m", "foretouch", "doctor", "--listen", endpoint, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert answers.stderr is not None
        assert "answers on" in answers.stderr.readline()
        options = ["--seconds", "0.5", "--keys", str(tmp_path / "none"), "--json"]
        good = CliRunner().invoke(app, ["doctor", "--connect", endpoint, *options])
        bad = CliRunner().invoke(app, ["doctor", "--connect", unused, *options])
    finally:
        answers.send_signal(signal.SIGINT)
        out, _ = answers.communicate(timeout=20)
    assert answers.returncode == 0
    asked = round(0.5 * RATE)
    assert json.loads(out) == {"answered": asked}
    result = {finding["name"]: finding for finding in json.loads(good.stdout)["findings"]}
    assert result[f"link {endpoint}"]["figures"]["answered"] == asked
    assert good.exit_code == (1 if json.loads(good.stdout)["verdict"] == "bad" else 0)
    assert json.loads(bad.stdout)["verdict"] == "bad"
    assert bad.exit_code == 1


@pytest.mark.parametrize("no_colour", [True, pytest.param(False, marks=pytest.mark.long)])
@pytest.mark.long
def test_the_table_says_verdicts_in_words_and_no_color_is_heeded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], no_colour: bool
) -> None:
    pty = pytest.importorskip("pty")
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    terminal_is = {"TERM": "xterm-256color", "COLUMNS": "100"} | ({"NO_COLOR": "1"} if no_colour else {})
    for name, value in terminal_is.items():
        monkeypatch.setenv(name, value)
    terminal, end = pty.openpty()
    shown: list[bytes] = []

    def look() -> None:
        with suppress(OSError):  # the other end has closed
            while part := os.read(terminal, 65536):
                shown.append(part)

    looking = threading.Thread(target=look)
    looking.start()
    with open(end, "w") as screen, monkeypatch.context() as there:
        there.setattr(sys, "stdout", screen)
        app(["doctor", "--seconds", "0.2", "--keys", str(tmp_path / "none")], standalone_mode=False)
    looking.join()
    os.close(terminal)
    assert capsys.readouterr().err == ""  # no bar where the error stream is no terminal
    text = b"".join(shown).decode()
    assert "good" in text
    assert "all in all:" in text
    assert ("\x1b[38;" in text) is not no_colour
