"""Strangers and peers in another's role, over TLS on loopback: what they get and what they give is nothing."""

from __future__ import annotations

import gc
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from intruders import MARK, hello_of, intruder, listen, sample, say_everything, until

from foretouch.errors import LinkError
from foretouch.link import (
    ROLES,
    Identity,
    KeyFolder,
    ZenohLink,
    access_list,
    free_endpoint,
    load_credentials,
    may_publish,
)
from foretouch.link.access import may_claim
from foretouch.messages import CHANNELS, VERSION, Command, EmergencyStop, Hello, encode

pytest.importorskip("cryptography")
NOW = datetime.now(UTC)
COMMAND = Command(VERSION, 1, 1, 0.001, 0, holder="leader")
TELEMETRY = msgspec.structs.replace(sample("telemetry"), sequence=1)


def made(path: Path) -> KeyFolder:
    keys = KeyFolder(path)
    keys.init(NOW)
    for role in ROLES:
        keys.issue(role, "", NOW)
    return keys


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> KeyFolder:
    return made(tmp_path_factory.mktemp("ours"))


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> KeyFolder:
    return made(tmp_path_factory.mktemp("theirs"))


@pytest.fixture(scope="module")
def alice(tmp_path_factory: pytest.TempPathFactory, ours: KeyFolder) -> Identity:
    elsewhere = KeyFolder(tmp_path_factory.mktemp("alice"))
    for name in ("authority.key", "authority.crt", "allowed.txt"):
        (elsewhere.path / name).write_bytes((ours.path / name).read_bytes())
        (elsewhere.path / name).chmod(0o600)
    elsewhere.path.chmod(0o700)
    return elsewhere.issue("leader", "alice", NOW)


def link(role: str, keys: KeyFolder, **more: Any) -> ZenohLink:
    return ZenohLink(credentials=load_credentials(role, keys.path), **more)


def marked(receiver: ZenohLink) -> set[str]:
    return {name for name in receiver.inboxes if any(m.sequence == MARK for _, m in receiver.take(name))}


def test_the_access_list_denies_what_it_does_not_name_and_a_hello_is_under_its_speaker_s_key() -> None:
    permissions: Any = access_list(ROLES, ["command", "stop"])
    rules = permissions["rules"]
    assert (permissions["enabled"], permissions["default_permission"]) == (True, "deny")
    ingress = {rule["id"]: rule["key_exprs"] for rule in rules if rule["id"] in ROLES}
    stop = "foretouch/stop"
    assert ingress == {"leader": ["foretouch/command/leader", stop], "follower": [stop], "watcher": [stop]}
    assert all(rule["permission"] == "allow" for rule in rules)
    assert {message for rule in rules for message in rule["messages"]} == {"put", "declare_subscriber"}
    wide = {key for rule in rules for key in rule["key_exprs"] if "*" in key}
    assert wide == {"foretouch/hello/*", "foretouch/command/*", "foretouch/forth/*"}
    rules = access_list(ROLES, ["hello"])["rules"]  # type: ignore[assignment]
    ingress = {rule["id"]: rule["key_exprs"] for rule in rules if rule["id"] in ROLES}
    assert ingress == {role: [f"foretouch/hello/{role}"] for role in ROLES}
    claims = {
        ("foretouch/hello", "leader"): True,  # from this machine
        ("foretouch/hello/leader", "leader"): True,
        ("foretouch/hello/watcher", "recorder"): True,
        ("foretouch/hello/watcher", "follower"): False,
        ("foretouch/hello/leader", "follower"): False,
        ("foretouch/hello/follower", "recorder"): False,
    }
    assert {claim: may_claim(*claim) for claim in claims} == claims
    assert set(may_publish("follower")) >= {"telemetry", "model", "hello", "stop"}
    assert set(may_publish("leader")) >= {"command", "leader", "hello", "settings", "stop"}
    assert set(may_publish("watcher")) >= {"handle", "settings", "stop", "emergency", "hello"}
    assert not set(may_publish("watcher")) & {"command", "leader", "model", "telemetry"}
    assert not set(may_publish("follower")) & {"command", "leader", "handle", "settings"}
    assert not set(may_publish("leader")) & {"model", "telemetry", "handle"}


@pytest.mark.network
@pytest.mark.parametrize("role", ROLES)
def test_no_peer_speaks_in_another_s_name(ours: KeyFolder, role: str) -> None:
    authority, here, _ = ours.read()
    endpoint = free_endpoint("tls")
    with (
        link("leader", ours, listen=[endpoint], subscribe=["hello"]) as receiver,
        intruder(connect=endpoint, identity=here[role], trusts=authority) as session,
    ):
        roles: set[str] = set()
        own = hello_of(role).role  # type: ignore[attr-defined]

        def turn() -> set[str]:
            say_everything(session)
            roles.update(hello.role for _, hello in receiver.take("hello"))
            return roles

        until(turn)
        for _ in range(20):
            turn()
            for claimed in ROLES:
                session.put(f"foretouch/hello/{role}", encode(hello_of(claimed)))
            time.sleep(0.01)
        assert roles == {own}
        assert receiver.undecodable > 0


@pytest.mark.network
def test_nobody_commands_in_another_s_name(ours: KeyFolder) -> None:
    endpoint = free_endpoint("tls")
    authority, here, allowed = ours.read()
    if "leader.bob" not in allowed:
        ours.issue("leader", "bob", NOW)
        authority, here, allowed = ours.read()
    true = msgspec.structs.replace(COMMAND, epoch=77)
    with (
        link("follower", ours, listen=[endpoint], subscribe=["command"]) as follower,
        intruder(connect=endpoint, identity=here["leader.bob"], trusts=authority) as bob,
        link("leader", ours, connect=[endpoint]) as leader,
    ):
        assert leader.name == "leader"
        arrived: list[Command] = []

        def turn() -> list[Command]:
            leader.publish(true)
            forged = msgspec.structs.replace(true, sequence=MARK)
            own = msgspec.structs.replace(forged, holder="leader.bob")
            for key in ("command", "command/leader", "command/leader.bob", "command/follower", "command/x"):
                bob.put(f"foretouch/{key}", encode(forged))
                bob.put(f"foretouch/{key}", encode(own))
            arrived.extend(message for _, message in follower.take("command"))
            return arrived

        until(lambda: {one.holder for one in turn()} == {"leader", "leader.bob"})
        for _ in range(50):
            turn()
            time.sleep(0.01)
        assert {(one.holder, one.sequence == MARK) for one in arrived} == {("leader", False), ("leader.bob", True)}
        assert follower.undecodable > 0, "what came under bob's own key in another's name"


@pytest.fixture
def lap(ours: KeyFolder) -> Iterator[tuple[str, Callable[[], int]]]:
    """A follower and a leader that talk over TLS; what a call gives is how many commands have arrived so far."""
    endpoint = free_endpoint("tls")
    follower = link("follower", ours, listen=[endpoint], subscribe=list(CHANNELS))
    leader = link("leader", ours, connect=[endpoint], subscribe=list(CHANNELS))
    arrived = 0

    def turn() -> int:
        nonlocal arrived
        leader.publish(COMMAND)
        follower.publish(TELEMETRY)
        arrived += len(follower.take("command"))
        return arrived

    with follower, leader:
        until(lambda: turn() and leader.take("telemetry"))
        turn.follower, turn.leader = follower, leader  # type: ignore[attr-defined]
        yield endpoint, turn


@pytest.mark.network
@pytest.mark.parametrize("who", ["no certificate", "of another authority", "trusting another", "no TLS", "not listed"])
def test_a_stranger_gets_nothing_and_gives_nothing(
    lap: tuple[str, Any], who: str, ours: KeyFolder, theirs: KeyFolder, alice: Identity
) -> None:
    endpoint, turn = lap
    authority, other = ours.read()[0], theirs.read()
    shown: dict[str, Any] = {
        "no certificate": {"trusts": authority},
        "of another authority": {"trusts": authority, "identity": other[1]["leader"]},
        "trusting another": {"trusts": other[0], "identity": other[1]["follower"]},
        "no TLS": {},
        "not listed": {"trusts": authority, "identity": alice},
    }[who]
    received: list[str] = []
    before = turn()
    with intruder(connect=endpoint.replace("tls/", "tcp/") if who == "no TLS" else endpoint, **shown) as session:
        keys = ("**", "foretouch/*", *(f"foretouch/{name}" for name in CHANNELS))
        kept = [listen(session, key, received) for key in keys]
        begun, arrived = time.monotonic(), 0
        while (lasted := time.monotonic() - begun) < 0.7 or (arrived <= 20 and lasted < 20.0):
            say_everything(session)
            arrived = turn() - before
            time.sleep(0.01)
        assert len(kept) == len(keys)
        assert not received
    assert arrived > 20, "the session itself goes on"
    assert not marked(turn.follower)
    assert not marked(turn.leader)
    assert turn.follower.undecodable == turn.leader.undecodable == 0


@pytest.mark.network
@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("channels", [[*CHANNELS], ["command", "stop"]], ids=["all", "some"])
def test_a_peer_is_heard_where_its_role_may_speak_and_nowhere_else(
    ours: KeyFolder, role: str, channels: list[str]
) -> None:
    authority, here, _ = ours.read()
    endpoint = free_endpoint("tls")
    expected, received = set(may_publish(role)) & set(channels), set[str]()
    with (
        link("follower", ours, listen=[endpoint], subscribe=channels) as receiver,
        intruder(connect=endpoint, identity=here[role], trusts=authority) as session,
    ):

        def turn() -> set[str]:
            say_everything(session)
            received.update(marked(receiver))
            return received

        until(lambda: turn() >= expected)
        for _ in range(10):
            turn()
            time.sleep(0.02)
        assert received == expected
        assert receiver.undecodable == 0


@pytest.mark.network
def test_a_watcher_hears_the_session_and_its_requests_get_no_answer(lap: tuple[str, Any], ours: KeyFolder) -> None:
    endpoint, turn = lap
    authority, here, _ = ours.read()
    received: list[str] = []
    with intruder(connect=endpoint, identity=here["watcher"], trusts=authority) as session:
        kept = listen(session, "foretouch/telemetry", received)
        until(lambda: turn() and received)
        wide: list[str] = []
        everything = listen(session, "**", wide)
        kept.undeclare()
        time.sleep(0.2)
        wide.clear()
        for _ in range(10):
            turn()
            time.sleep(0.02)
        assert not wide, "what is not named is not heard"
        session.delete("foretouch/stop")
        assert not list(session.get("**", timeout=0.5))
        everything.undeclare()
    assert turn.follower.undecodable == 0


@pytest.mark.network
def test_a_watcher_may_ask_for_an_emergency_stop_and_hears_that_it_was_heard(
    lap: tuple[str, Any], ours: KeyFolder
) -> None:
    endpoint, turn = lap
    turn.follower.take("emergency")
    with link("watcher", ours, connect=[endpoint], subscribe=["telemetry"]) as watcher:
        stop = EmergencyStop(VERSION, 1, 1, "a watcher shouted")
        asked: list[str] = []

        def ask() -> bool:
            watcher.publish(stop)
            turn()
            asked.extend(message.reason for _, message in turn.follower.take("emergency"))
            return bool(asked and watcher.take("telemetry"))

        until(ask)
    assert set(asked) == {"a watcher shouted"}
    assert turn.follower.undecodable == 0


@pytest.mark.network
@pytest.mark.parametrize("who", ["of another authority", "in another role"])
def test_a_leader_takes_nothing_from_a_false_follower(who: str, ours: KeyFolder, theirs: KeyFolder) -> None:
    endpoint = free_endpoint("tls")
    authority, here, _ = (theirs if who == "of another authority" else ours).read()
    identity = here["follower" if who == "of another authority" else "watcher"]
    received: list[str] = []
    with (
        intruder(listen=endpoint, identity=identity, trusts=authority) as session,
        link("leader", ours, connect=[endpoint], subscribe=["model", "telemetry", "leader"]) as leader,
    ):
        kept = listen(session, "foretouch/command", received)
        for _ in range(40):
            for name in ("model", "telemetry", "leader"):
                session.put(f"foretouch/{name}", b"x")
            leader.publish(COMMAND)
            time.sleep(0.02)
        assert leader.undecodable == 0
        assert not any(leader.take(name) for name in leader.inboxes)
        assert who == "in another role" or not received
        kept.undeclare()


@pytest.mark.network
def test_what_is_on_this_machine_needs_no_keys_beside_what_is_not(ours: KeyFolder) -> None:
    tls, tcp = free_endpoint("tls"), free_endpoint()
    names = ["telemetry", "hello", "command"]
    with (
        link("follower", ours, listen=[tls, tcp], subscribe=names) as follower,
        ZenohLink(connect=[tcp], subscribe=["telemetry"]) as local,
    ):
        hello = Hello(VERSION, 1, 1, "recorder", (), ())
        until(lambda: (local.publish(hello), follower.publish(TELEMETRY)) and follower.take("hello"))
        until(lambda: follower.publish(TELEMETRY) or local.take("telemetry"))
        assert not follower.insecure
        assert not local.insecure


def test_tls_without_keys_is_refused() -> None:
    with pytest.raises(LinkError, match="needs keys: foretouch keys init"):
        ZenohLink(listen=[free_endpoint("tls")])


CLIENT = """
import sys
sys.path.insert(0, {tests!r})
from intruders import intruder, sample
from foretouch.link import KeyFolder
from foretouch.messages import encode
import time
authority, here, _ = KeyFolder({keys!r}).read()
hello, data = [], encode(sample("hello"))
for _ in range({count}):
    hello.clear()
    with intruder(connect={endpoint!r}, identity=here["watcher"], trusts=authority) as session:
        kept = session.declare_subscriber("foretouch/telemetry", lambda s: hello.append(1))
        while not hello:
            time.sleep(0.002)
        session.put("foretouch/hello/watcher", data)
"""


def footprint() -> tuple[int, int, int]:
    """Files, threads and memory [kB] of this process."""
    gc.collect()
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return len(os.listdir("/proc/self/fd")), int(status["Threads"]), int(status["VmRSS"].split()[0])


@pytest.mark.network
@pytest.mark.long
def test_a_hundred_connects_and_disconnects_leave_nothing_behind(ours: KeyFolder) -> None:
    endpoint = free_endpoint("tls")
    host, port = endpoint.removeprefix("tls/").split(":")
    ended = threading.Event()
    with link("follower", ours, listen=[endpoint], subscribe=["hello"]) as follower:

        def speak() -> None:
            while not ended.wait(0.002):
                follower.publish(TELEMETRY)

        speaker = threading.Thread(target=speak)
        speaker.start()
        first = footprint()

        def connect(count: int) -> None:
            text = CLIENT.format(tests=str(Path(__file__).parent), keys=str(ours.path), endpoint=endpoint, count=count)
            subprocess.run([sys.executable, "-c", text], check=True, timeout=120)
            for _ in range(count // 5):  # and some that say nothing that TLS knows
                with socket.create_connection((host, int(port)), timeout=5) as stranger:
                    stranger.sendall(b"GET / HTTP/1.0\r\n\r\n")
            follower.take("hello")
            time.sleep(0.5)
            until(lambda: footprint()[0] <= first[0] + 1)  # the network takes strangers one by one

        try:
            connect(10)
            before = footprint()
            connect(100)
            after = footprint()
        finally:
            ended.set()
            speaker.join()
    grown = np.subtract(after, before)
    assert (grown <= (1, 2, 3000)).all(), grown  # threads are of a pool that grows once
