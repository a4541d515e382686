"""The gate between a program's TCP connection and a real link."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from running import Running, until

from foretouch.errors import LinkError
from foretouch.link import CHANNEL_NUMBERS, Faults, FrameServer, KeyFolder, ZenohLink, free_endpoint, load_credentials
from foretouch.link.certificates import utc_now
from foretouch.messages import (
    CHANNELS,
    VERSION,
    Command,
    Hello,
    Message,
    Settings,
    Stop,
    Telemetry,
    decode,
    encode,
)
from foretouch.session import FOLLOWER_CHANNELS, Gate, gate_channels

pytestmark = pytest.mark.network

NAMES = {number: name for name, number in CHANNEL_NUMBERS.items()}
KINDS = {channel.kind: name for name, channel in CHANNELS.items()}


class Program:
    """What a program does that comes through the gate."""

    def __init__(self, endpoint: str) -> None:
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        self.socket = socket.create_connection((host, int(port)))
        self.socket.settimeout(0.01)
        self._came = b""
        self.heard: list[tuple[float, str, Message]] = []
        self.closed = False

    def say(self, message: Message, channel: str = "") -> None:
        data = encode(message)
        self.socket.sendall(struct.pack("<IB", 1 + len(data), CHANNEL_NUMBERS[channel or KINDS[type(message)]]) + data)

    def hear(self) -> list[tuple[float, str, Message]]:
        try:
            data = self.socket.recv(65_536)
            self.closed = not data
            self._came += data
        except TimeoutError:
            pass
        while len(self._came) >= 5 and len(self._came) >= 4 + struct.unpack_from("<I", self._came)[0]:
            size, number = struct.unpack_from("<IB", self._came)
            name = NAMES[number]
            self.heard.append((time.monotonic(), name, decode(self._came[5 : 4 + size], CHANNELS[name].kind)))
            self._came = self._came[4 + size :]
        return self.heard

    def of(self, name: str) -> list[Any]:
        return [message for _, channel, message in self.hear() if channel == name]


class Opened:
    """A gate that runs in a thread, and the other side's link."""

    def __init__(self, side: str, faults: Faults, **keys: Any) -> None:
        kind = "tls" if keys else "tcp"
        between, self.at = free_endpoint(kind), free_endpoint()
        self.said: list[str] = []
        self.server = FrameServer(self.at, self.said.append)
        self.gate = Gate(side, self.server, faults)
        other = FOLLOWER_CHANNELS if side == "leader" else ("telemetry", "model", "stop", "hello")
        theirs = "follower" if side == "leader" else "leader"
        self.link = ZenohLink(listen=[between], subscribe=other, credentials=keys.get(theirs))
        self._own = ZenohLink(
            connect=[between], subscribe=gate_channels(side), credentials=keys.get(side), watch=self.gate.hear
        )
        self.done = threading.Event()
        self._thread = threading.Thread(target=self.gate.run, args=(self._own, self.done.is_set))
        self._thread.start()

    def close(self) -> None:
        self.done.set()
        self._thread.join()
        self.server.close()
        self._own.close()
        self.link.close()


@contextmanager
def opened(side: str = "leader", faults: Faults = Faults(), **keys: Any) -> Iterator[tuple[Opened, Program]]:  # noqa: B008
    gate = Opened(side, faults, **keys)
    program = Program(gate.at)
    try:
        yield gate, program
    finally:
        program.socket.close()
        gate.close()


def command(sequence: int, holder: str = "somebody") -> Command:
    return Command(VERSION, sequence, time.monotonic_ns(), 0.001 * sequence, 0, holder=holder, epoch=77)


def telemetry(sequence: int) -> Telemetry:
    numbers = (0.0,) * 6
    return Telemetry(VERSION, sequence, time.monotonic_ns(), 0, *numbers, False, False, 0, 0, 0, run=5)


def met(gate: Opened, program: Program, link_says: Callable[[], None]) -> None:
    """Wait until messages go both ways."""
    until(lambda: program.say(command(1)) or gate.link.take("command"))
    until(lambda: link_says() or program.hear())
    time.sleep(0.1)
    gate.link.take("command")
    program.heard.clear()


def test_a_program_is_the_leader() -> None:
    with opened() as (gate, program):
        met(gate, program, lambda: gate.link.publish(telemetry(1)))
        sent = [command(number) for number in range(2, 302)]
        for message in sent:
            program.say(message)
            gate.link.publish(telemetry(message.sequence))
            time.sleep(5e-4)
        came: list[Message] = []
        until(lambda: came.extend(message for _, message in gate.link.take("command")) or len(came) >= 300)
        assert came == sent
        until(lambda: len(program.of("telemetry")) >= 300)
        numbers = [message.sequence for message in program.of("telemetry")]
        assert numbers[-300:] == list(range(2, 302))
        hellos: list[Hello] = []
        until(lambda: hellos.extend(hello for _, hello in gate.link.take("hello")) or hellos)
        assert hellos[-1].role == "leader"
        assert hellos[-1].texts["process"] == "77"
        assert hellos[-1].texts["leader"] == "somebody"
        assert not program.of("hello"), "its own is not told to it"


def test_a_program_is_the_follower() -> None:
    with opened("follower") as (gate, program):
        until(lambda: program.say(telemetry(1)) or gate.link.take("telemetry"))
        until(lambda: gate.link.publish(command(3)) or program.of("command"))
        program.say(command(4))
        until(lambda: program.hear() and program.closed)
        assert "a message on channel command, on which a follower does not speak" in gate.said[-1]


def test_what_comes_is_delayed_and_lost_as_the_console_asks() -> None:
    with opened(faults=Faults(delay=0.2)) as (gate, program):
        met(gate, program, lambda: gate.link.publish(telemetry(1)))
        begun = time.monotonic()
        gate.link.publish(telemetry(2))
        until(lambda: any(one.sequence == 2 for one in program.of("telemetry")))
        assert 0.2 <= program.heard[-1][0] - begun < 0.3
        gate.link.publish(Settings(VERSION, 1, 1, 0.0, 0.01, loss=0.5))
        time.sleep(0.1)
        program.heard.clear()
        for number in range(3, 403):
            gate.link.publish(telemetry(number))
            time.sleep(5e-4)
        time.sleep(0.1)
        until(lambda: program.hear() and len(program.heard) == len(program.hear()))
        assert 120 < len(program.of("telemetry")) < 280
        hellos: list[Hello] = []

        def told() -> bool:
            hellos.extend(one for _, one in gate.link.take("hello") if "settings_since_ns" in one.texts)
            return bool(hellos)

        until(told)
        assert hellos[-1].texts["force_delay"] == "0.01"
        assert hellos[-1].texts["return_loss"] == "0.5"


@pytest.mark.parametrize(
    ("data", "channel", "line"),
    [
        (b"rubbish", "command", "a message on channel command is none: not a Command"),
        (encode(msgspec.structs.replace(command(1), version=VERSION + 1)), "command", f"{VERSION + 1}"),
        (encode(Hello(VERSION, 1, 1, "leader", (), ())), "hello", "a message on channel hello, on which"),
        (encode(telemetry(1)), "telemetry", "on which a leader does not speak"),
        (encode(Settings(VERSION, 1, 1, 0.0, 0.0)), "settings", "on which a leader does not speak"),
    ],
    ids=["rubbish", "another version", "hello", "telemetry", "settings"],  # the bytes hold a time
)
@pytest.mark.first
def test_what_a_leader_would_not_say_ends_the_connection(data: bytes, channel: str, line: str) -> None:
    with opened() as (gate, program):
        until(lambda: program.say(command(1)) or gate.link.take("command"))
        time.sleep(0.1)
        gate.link.take("command")
        frame = struct.pack("<IB", 1 + len(data), CHANNEL_NUMBERS[channel]) + data
        program.socket.sendall(frame + frame)
        until(lambda: program.hear() is not None and program.closed)
        assert line in gate.said[-1]
        assert len(gate.said) == 2
        assert not gate.link.take("command")


def test_a_hello_says_nothing_of_the_program_before() -> None:
    with opened() as (gate, program):
        met(gate, program, lambda: gate.link.publish(telemetry(1)))
        program.socket.close()
        until(lambda: not gate.server.connected)
        other = Program(gate.at)
        until(lambda: gate.server.connected)
        time.sleep(0.1)
        gate.link.take("hello")
        time.sleep(1.5)
        assert not gate.link.take("hello"), "it has said nothing yet"
        other.say(msgspec.structs.replace(command(1, "another"), epoch=78))
        hellos: list[Hello] = []
        until(lambda: hellos.extend(hello for _, hello in gate.link.take("hello")) or hellos)
        assert (hellos[0].texts["process"], hellos[0].texts["leader"]) == ("78", "another")
        other.socket.close()


def test_a_stop_ends_the_session_for_both() -> None:
    with opened() as (gate, program):
        met(gate, program, lambda: gate.link.publish(telemetry(1)))
        program.say(Stop(VERSION, 1, 1, "enough", 77))
        until(lambda: gate.link.take("stop"))
    with opened() as (gate, program):
        met(gate, program, lambda: gate.link.publish(telemetry(1)))
        gate.link.publish(Stop(VERSION, 1, 1, "enough"))
        until(lambda: program.of("stop"))
        until(lambda: gate.gate.ended)
        assert gate.gate.ended == "enough"


def test_with_keys_a_program_holds_control_in_the_gates_name(tmp_path: Any) -> None:
    pytest.importorskip("cryptography")
    keys = KeyFolder(tmp_path)
    now = utc_now()
    keys.init(now)
    keys.issue("leader", "alice", now)
    keys.issue("follower", "", now)
    credentials = {side: load_credentials(side, tmp_path) for side in ("leader", "follower")}
    with opened(**credentials) as (gate, program):
        came: list[Command] = []

        def asked() -> bool:
            program.say(command(1, holder="mallory"))
            came.extend(message for _, message in gate.link.take("command"))
            return bool(came)

        until(asked)
        assert came[-1].holder == "leader.alice"
        assert gate.link.undecodable == 0


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--at", "tcp/0.0.0.0:7460"], "is off this machine"),
        (["--side", "watcher"], "unknown side 'watcher': choose one of"),
        (["--loss", "2"], "loss = 2.0"),
        ([], "no endpoint"),
    ],
)
def test_the_command_refuses_what_cannot_be(options: list[str], line: str) -> None:
    from typer.testing import CliRunner

    from foretouch.cli.app import app

    at = [] if "--at" in options else ["--at", free_endpoint()]
    done = CliRunner().invoke(app, ["gate", *options, *at, *(["--connect", "tcp/127.0.0.1:1"] if options else [])])
    assert done.exit_code != 0
    assert line in str(done.exception)


@pytest.mark.long
def test_the_command_runs_until_it_is_ended() -> None:
    at = free_endpoint()
    with Running("gate", "--listen", free_endpoint(), "--at", at, "--json") as gate:
        assert gate.process.stderr is not None
        assert gate.process.stderr.readline() == f"gate: a leader may connect at {at}\n"
        Program(at).socket.close()
        assert "a program has connected" in gate.process.stderr.readline()
        gate.process.terminate()
        code, out, _ = gate.wait()
        assert code == 0
        assert msgspec.json.decode(out) == {"ended": "terminated", "taken": 0, "handed": 0, "dropped": 0}


def test_an_address_off_this_machine_is_refused_by_the_server() -> None:
    with pytest.raises(LinkError, match="off this machine"):
        FrameServer("tcp/0.0.0.0:7460", print)
