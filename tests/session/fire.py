"""A live session that a test does harm to: its processes, the network between them, and what a watcher saw of it."""

from __future__ import annotations

import itertools
import os
import re
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from relay import Relay

from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import Hello, LeaderState, Message, SessionLog, Status, Stop, Telemetry, split_texts

WATCHED = ("telemetry", "leader", "model", "hello", "stop")
OBEYS = (Status.FOLLOWING, Status.GUARDED, Status.RETURNING)
UNLOADED_AFTER_NS = 2_500_000_000
"""So long after it began to hold the robot has to be unloaded: it begins to unload after half a second, compliantly."""

POOLED = re.compile(r"(app|net|tx|rx|acc)-\d+$")
"""Names of the network's threads."""

STEADY_NS = 200_000_000
"""A session has resumed where it goes on for so long."""

TOUCHED = 400
"""Ticks of pressing that a model is judged by."""

AFTERWARDS = 1.3
"""A session is looked at for so long once it has resumed [s]."""

CALM = 1.0
"""Once it has resumed, nothing more may be lost from so long on [s]."""


@dataclass
class Outcome:
    """What came of one fault."""

    fault: str
    begin_ns: int
    returned_ns: int = 0
    resumed: float = np.inf
    force: float = 0.0
    unloaded: float = 0.0
    rendered: float = 0.0
    change: float = 0.0
    beyond: float = 0.0
    lost: int = 0
    felt_error: float = np.nan
    statuses: list[Status] = field(default_factory=list)
    grown: dict[str, int] = field(default_factory=dict)
    relearns: bool = False

    def broken(self) -> list[str]:
        kept = {
            f"resumed within 1 s: {self.resumed:.3f} s": self.resumed < 1.0,
            f"force of the robot below 15 N: {self.force:.2f} N": self.force < 15.0,
            f"unloaded below 1 N: {self.unloaded:.2f} N": self.unloaded < 1.0,
            f"force of the hand at most 10 N: {self.rendered:.2f} N": self.rendered <= 10.0,
            f"its change at most 0.2 N: {self.change:.3f} N": self.change <= 0.2 + 1e-9,
            f"no energy beyond the bound: {self.beyond:.2g} J": self.beyond <= 1e-12,
            f"nothing lost: {self.lost} messages": self.lost == 0,
            # A press into what nobody has felt before may be among what it is judged by.
            f"a model that is right: {self.felt_error:.0f} %": self.relearns or not self.felt_error > 40.0,
        }
        return [sentence for sentence, holds in kept.items() if not holds]


def follows(telemetry: Telemetry) -> bool:
    """Whether the robot is where it was told to be: only then model and robot press alike."""
    return telemetry.status == Status.FOLLOWING and not telemetry.guarded


class Watcher:
    """Listens to both sides, each at its own endpoint: what is between them does not stand between it and them."""

    def __init__(self, *endpoints: str) -> None:
        self.told: deque[Message] = deque()
        self.hellos: dict[str, Hello] = {}
        self.stops: list[Stop] = []
        self.telemetry: Telemetry | None = None
        self.leader: LeaderState | None = None
        self.touched = 0
        self._link = ZenohLink(connect=endpoints, subscribe=WATCHED, watch=self._take)

    def _take(self, message: Message) -> None:
        if isinstance(message, Telemetry):
            self.telemetry = message
            self.touched += follows(message) and message.exact_force > 0.5
        elif isinstance(message, LeaderState):
            self.leader = message
        elif isinstance(message, Hello):
            self.hellos[message.role] = message
            return
        elif isinstance(message, Stop):
            self.stops.append(message)
            return
        self.told.append(message)

    def counts(self, role: str) -> dict[str, int]:
        hello = self.hellos[role]
        return split_texts(dict(zip(hello.names, hello.values, strict=True)))[1]

    def take(self) -> SessionLog:
        return SessionLog.from_messages([self.told.popleft() for _ in range(len(self.told))])

    def close(self) -> None:
        self._link.close()


class Fire:
    """Follower, leader and recorder, a relay between the first two, and a watcher."""

    def __init__(self, folder: Path, *options: object, environment: dict[str, str] | None = None) -> None:
        self.folder = folder
        self.recording = folder / "fire.mcap"
        self._options = [str(option) for option in options]
        self.closed_loop = "--grip" in options
        self._offset = folder / "wall-clock"
        self.step_wall_clock(0.0)
        shim = [str(Path(__file__).with_name("wall_clock")), os.environ.get("PYTHONPATH", "")]
        self._environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, shim)),
            "WALL_CLOCK_OFFSET": str(self._offset),
            **(environment or {}),
        }
        self.follower_endpoint, self.leader_endpoint = free_endpoint(), free_endpoint()
        between = free_endpoint()
        self._arguments = {
            "follower": ["--listen", self.follower_endpoint, *self._options],
            "leader": ["--listen", self.leader_endpoint, "--connect", between, "--name", "anna", *self._options],
            "record": [str(self.recording), "--connect", self.follower_endpoint, "--connect", self.leader_endpoint],
        }
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.heard: list[np.ndarray] = []
        self.footprint: dict[str, int] = {}
        self.watcher = Watcher(self.follower_endpoint, self.leader_endpoint)
        self.relay = Relay(*(int(endpoint.rpartition(":")[2]) for endpoint in (between, self.follower_endpoint)))
        for role in self._arguments:
            self.start(role)

    def start(self, role: str) -> None:
        """Start a process; what it says is appended to a file of its name."""
        command = [sys.executable, "-m", "foretouch", role, *self._arguments[role]]
        with self.said_file(role).open("ab") as output:
            self.processes[role] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=self._environment
            )

    def said_file(self, role: str) -> Path:
        return self.folder / f"{role}.txt"

    def said(self, role: str) -> str:
        return self.said_file(role).read_text()

    def kill(self, role: str) -> None:
        self.processes[role].kill()
        self.processes[role].wait()

    def signal(self, role: str, number: signal.Signals) -> None:
        self.processes[role].send_signal(number)

    def step_wall_clock(self, seconds: float) -> None:
        """From now on every wall clock is wrong by so much, of processes that run and of those to come."""
        beside = self._offset.with_suffix(".new")
        beside.write_text(str(seconds))
        os.replace(beside, self._offset)

    def until(self, condition: Callable[[], object], what: str, seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"not in {seconds:g} s: {what}: {self.state()}"
            for role, process in self.processes.items():
                assert process.poll() in (None, -signal.SIGKILL), f"the {role} has ended:\n{self.said(role)}"
            time.sleep(0.01)

    def state(self) -> str:
        output = [repr(self.watcher.telemetry), repr(self.watcher.leader)]
        now = [f"now {time.monotonic_ns()}"]
        return "\n".join([*now, *output, *(f"{role}: {self.said(role)[-2000:]}" for role in self.processes)])

    def together(self) -> bool:
        telemetry, leader = self.watcher.telemetry, self.watcher.leader
        if telemetry is None or leader is None:
            return False
        now, recent = time.monotonic_ns(), 100_000_000
        return bool(
            telemetry.status in OBEYS
            and (telemetry.epoch, telemetry.run) == (leader.epoch, leader.run)
            and leader.engaged
            and np.isfinite(leader.standard_deviation)
            and now - telemetry.time_ns < recent
            and now - leader.time_ns < recent
        )

    def pressed(self, force: float = 1.0) -> None:
        """Wait until all is well and the robot feels so much [N]."""

        def presses() -> bool:
            telemetry = self.watcher.telemetry
            return self.together() and telemetry is not None and telemetry.exact_force > force

        self.until(presses, "the robot presses")

    @contextmanager
    def fault(self, name: str, *, felt: bool = False, lossless: bool = False) -> Iterator[Outcome]:
        """What is done inside is one fault; once that is over it is waited for what comes of it."""
        self.take()
        outcome = Outcome(name, time.monotonic_ns())
        before = self._lost_between() if lossless else 0
        yield outcome
        outcome.returned_ns = outcome.returned_ns or time.monotonic_ns()
        time.sleep(0.05)
        self.until(self.together, f"resumed after: {name}")
        self.watcher.touched = 0
        time.sleep(AFTERWARDS)
        if felt:
            self.until(lambda: self.watcher.touched > TOUCHED, f"the robot presses after: {name}")
        judge(outcome, self.take(), lossless=lossless)
        if lossless:
            outcome.lost += self._lost_between() - before

    def take(self) -> SessionLog:
        log = self.watcher.take()
        self.heard.append(numbers(log))
        return log

    def not_recorded(self, recording: SessionLog) -> int:
        """Messages that the watcher heard and a recording lacks, of each process from the first that it holds."""
        self.take()
        received, recorded = np.concatenate(self.heard), numbers(recording)
        missing = 0
        for process in np.unique(received[:, :2], axis=0):
            here, there = (rows[(rows[:, :2] == process).all(axis=1), 2] for rows in (received, recorded))
            missing += np.setdiff1d(here[here >= there.min()], there).size
        return missing

    def undecodable(self) -> int:
        return sum(self.watcher.counts(role)[f"{role}_undecodable"] for role in ("follower", "leader"))

    def footprints(self) -> dict[str, int]:
        result = {}
        for role in ("follower", "leader"):
            process = Path(f"/proc/{self.processes[role].pid}")
            status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
            names = [(task / "comm").read_text() for task in (process / "task").iterdir()]
            result[f"{role} memory_kB"] = int(status["VmRSS"].split()[0])
            result[f"{role} threads"] = sum(not POOLED.match(name) for name in names)
            result[f"{role} pooled threads"] = len(names) - result[f"{role} threads"]
            result[f"{role} files"] = len(os.listdir(process / "fd"))
        return result

    def grown(self) -> dict[str, int]:
        return {name: now - self.footprint[name] for name, now in self.footprints().items()}

    def _lost_between(self) -> int:
        follower, leader = self.watcher.counts("follower"), self.watcher.counts("leader")
        return follower["commands_lost"] + leader["models_lost"] + leader["telemetry_lost"]

    def restarted(self, role: str) -> int:
        """Start a process that is gone; returns when it began to speak [ns]."""
        told = "telemetry" if role == "follower" else "leader"
        gone = getattr(self.watcher, told)
        process = "run" if role == "follower" else "epoch"
        self.start(role)
        self.until(
            lambda: getattr(getattr(self.watcher, told), process) != getattr(gone, process), f"the {role} speaks", 60.0
        )
        new = getattr(self.watcher, told)
        return int(new.time_ns) - (new.sequence - 1) * 1_000_000

    def close(self) -> None:
        self.relay.close()
        self.watcher.close()
        for process in self.processes.values():
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()


def numbers(log: SessionLog) -> np.ndarray:
    """Side (0 for the leader), process and number of every message of a session."""
    leader, follower = log.leader, log.follower
    return np.concatenate(
        (
            np.column_stack((np.zeros_like(leader["epoch"]), leader["epoch"], leader["sequence"])),
            np.column_stack((np.ones_like(follower["run"]), follower["run"], follower["sequence"])),
        )
    )


def judge(outcome: Outcome, log: SessionLog, *, lossless: bool = False) -> None:
    leader, follower = log.leader, log.follower
    after = follower["time_ns"] >= outcome.begin_ns
    outcome.resumed = resumed_after(outcome.returned_ns, log)
    outcome.force = float(follower["exact_force"].max())
    outcome.unloaded = _unloaded(outcome.returned_ns, follower)
    outcome.rendered = float(leader["rendered_force"].max())
    outcome.change = largest_change(leader)
    outcome.beyond = float((-leader["energy"] - leader["energy_bound"]).max())
    status = follower["status"][after]
    outcome.statuses = [Status(int(one)) for one in status[np.r_[True, np.diff(status) != 0]]]
    resumed_ns = outcome.returned_ns + round(1e9 * min(outcome.resumed, 60.0))
    calm_ns = outcome.begin_ns if lossless else resumed_ns + round(CALM * 1e9)
    outcome.lost = sum(_lost(rows, calm_ns) for rows in (leader, follower))
    outcome.felt_error = felt_error(log, resumed_ns)


def resumed_after(returned_ns: int, log: SessionLog) -> float:
    """Time from a return until the robot obeys the leader that feels it, through a model, and goes on so [s]."""
    leader, follower = log.leader, log.follower
    epoch, run = leader["epoch"][-1], follower["run"][-1]
    obeys = (follower["epoch"] == epoch) & (follower["run"] == run) & np.isin(follower["status"], OBEYS)
    feels = leader["engaged"] & (leader["epoch"] == epoch) & (leader["run"] == run)
    feels &= np.isfinite(leader["standard_deviation"])
    both = max(_lasting(follower["time_ns"], obeys, returned_ns), _lasting(leader["time_ns"], feels, returned_ns))
    return (both - returned_ns) * 1e-9


def _lasting(time_ns: np.ndarray, good: np.ndarray, from_ns: int) -> float:
    """First time from which on all is good for `STEADY_NS`; infinite without."""
    since = np.flatnonzero(time_ns >= from_ns)
    if not since.size:
        return np.inf
    time_ns, good = time_ns[since], good[since]
    bad = np.r_[-1, np.flatnonzero(~good), good.size]
    for before, after in itertools.pairwise(bad):
        if after - before > 1 and time_ns[after - 1] - time_ns[before + 1] >= STEADY_NS:
            return float(time_ns[before + 1])
    return np.inf


def _unloaded(returned_ns: int, follower: np.ndarray) -> float:
    """Largest force while the robot had to be unloaded for want of commands [N]."""
    silent = np.isin(follower["status"], (Status.HOLDING, Status.UNLOADING)) & (follower["time_ns"] < returned_ns)
    if not silent.any():
        return 0.0
    began = follower["time_ns"][silent][0]
    late = silent & (follower["time_ns"] >= began + UNLOADED_AFTER_NS)
    return float(follower["exact_force"][late].max(initial=0.0))


def largest_change(leader: np.ndarray) -> float:
    """Largest change of the rendered force between two ticks of one process [N]."""
    next_tick = (np.diff(leader["epoch"]) == 0) & (np.diff(leader["sequence"]) == 1)
    lasted = np.maximum(leader["period_ns"][1:], leader["period_ns"][:-1]) * 1e-6
    change = np.diff(leader["rendered_force"]) / np.maximum(lasted, 1.0)
    unpaid = (change < 0.0) & (leader["energy"][1:] < 0.0)
    return float(np.abs(change)[next_tick & ~unpaid].max(initial=0.0))


def _lost(rows: np.ndarray, from_ns: int) -> int:
    """Gaps in the numbers of one process, from a time on."""
    process = "run" if "status" in rows.dtype.names else "epoch"
    rows = rows[rows["time_ns"] >= from_ns]
    return int((np.diff(rows["sequence"]) - 1)[np.diff(rows[process]) == 0].sum())


def felt_error(log: SessionLog, from_ns: int) -> float:
    """Predicted force less the robot's own at the same commands, while it followed them, by the robot's own [%]."""
    leader = log.leader[(log.leader["epoch"] == log.leader["epoch"][-1]) & (log.leader["time_ns"] >= from_ns)]
    follower = log.follower[(log.follower["epoch"] == leader["epoch"][-1]) & (log.follower["time_ns"] >= from_ns)]
    follower = follower[(follower["status"] == Status.FOLLOWING) & ~follower["guarded"]]
    applied, first = np.unique(follower["command_sequence"], return_index=True)
    _, here, there = np.intersect1d(leader["sequence"], applied, assume_unique=True, return_indices=True)
    predicted, true = leader["predicted_force"][here], follower["exact_force"][first[there]]
    touched = np.maximum(predicted, true) > 0.2
    if touched.sum() < 200:
        return np.nan
    return float(100.0 * np.sqrt(np.mean((predicted - true)[touched] ** 2) / np.mean(true[touched] ** 2)))
