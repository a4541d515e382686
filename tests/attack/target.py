"""A follower and a leader that run, joined over TLS on loopback, for those who attack them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "link"))

from intruders import hello_of, intruder, listen, sample, say_everything, until  # noqa: F401

from foretouch.link import Identity, KeyFolder, ZenohLink, free_endpoint, load_credentials
from foretouch.messages import Status, split_texts

COMMAND = (sys.executable, "-m", "foretouch")
STARTING = 120.0
"""A process may take so long [s] to begin where everything is compiled first."""


@dataclass
class Score:
    failures: list[str] = field(default_factory=list)

    def note(self, what: str, tried: int, got_in: int, more: str = "") -> None:
        print(f"  {what:<58} tried {tried:>6}   got in {got_in}{'   ' + more if more else ''}", flush=True)
        if got_in:
            self.failures.append(what)

    def end(self) -> int:
        print(f"FAILED: {'; '.join(self.failures)}" if self.failures else "nothing got in", flush=True)
        return 1 if self.failures else 0


class Process:
    def __init__(self, folder: Path, *arguments: object) -> None:
        self._said = tempfile.NamedTemporaryFile("w+", dir=folder, suffix=".txt")  # noqa: SIM115
        command = [*COMMAND, *map(str, arguments)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self._said, stderr=subprocess.STDOUT, start_new_session=True
        )

    @property
    def said(self) -> str:
        return Path(self._said.name).read_text(errors="surrogateescape")

    @property
    def memory(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        return int(next(line for line in status if line.startswith("VmRSS")).split()[1]) / 1024

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def end(self) -> None:
        if self.running:
            self.process.terminate()
        try:
            self.process.wait(15.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._said.close()


@dataclass
class Target:
    keys: KeyFolder
    follower: Process
    leader: Process
    at_follower: str
    at_leader: str
    watch: ZenohLink

    def identity(self, name: str) -> Identity:
        return self.keys.read()[1][name]

    @property
    def authority(self) -> Identity:
        return self.keys.read()[0]

    def telemetry(self) -> list[Any]:
        return [message for _, message in self.watch.take("telemetry")]

    def traces(self) -> dict[str, object]:
        """What anything that was taken by either side would have changed, once both have said hello again."""
        self.telemetry()
        self.watch.take("leader")
        self.watch.take("hello")
        time.sleep(1.2)
        rows, led = self.telemetry(), [message for _, message in self.watch.take("leader")]
        hellos = {hello.role: split_texts(hello.texts) for _, hello in self.watch.take("hello")}
        counted = ("undecodable", "of_others", "refused", "future")
        return {
            "running": self.follower.running and self.leader.running,
            "obeyed": sorted({one.epoch for one in rows}),
            "heard": sorted({one.run for one in led}),
            "stopped": any(one.status == Status.STOPPED for one in rows),
            "said hello": sorted(hellos),
        } | {
            f"{role} {name}": count
            for role, (_, counts) in sorted(hellos.items())
            for name, count in sorted(counts.items())
            if name.endswith(counted)
        }


def keys_in(folder: Path) -> KeyFolder:
    keys, now = KeyFolder(folder), datetime.now(UTC)
    keys.init(now)
    for role, name in (("leader", ""), ("leader", "bob"), ("follower", ""), ("watcher", "")):
        keys.issue(role, name, now)
    return keys


@contextmanager
def session(folder: Path, *, material: str = "hunt-crossley") -> Iterator[Target]:
    keys = keys_in(folder / "keys")
    at_follower, at_leader = free_endpoint("tls"), free_endpoint("tls")
    common = ("--material", material, "--keys", keys.path, "--duration", 300)
    follower = Process(folder, "follower", "--listen", at_follower, "--position-delay", 0, *common)
    leader = Process(
        folder, "leader", "--connect", at_follower, "--listen", at_leader, "--force-delay", 0,
        "--operator", "scripted", *common,
    )  # fmt: skip
    watching = ["telemetry", "leader", "hello", "stop", "emergency", "command"]
    credentials = load_credentials("watcher", keys.path)
    try:
        with ZenohLink(connect=[at_follower, at_leader], subscribe=watching, credentials=credentials) as watch:
            target = Target(keys, follower, leader, at_follower, at_leader, watch)
            until(lambda: any(one.command_sequence for one in target.telemetry()), STARTING, "the robot follows")
            yield target
    finally:
        leader.end()
        follower.end()
