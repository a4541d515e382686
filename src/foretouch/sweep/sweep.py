"""All sessions of a sweep, side by side, and one of them again.

The rows are kept in its folder as they come, so that a sweep that was ended goes on where it was.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from foretouch import __version__
from foretouch.comparison.parallel import run_all
from foretouch.errors import InputError, SettingError, UnknownNameError
from foretouch.errors.checks import require
from foretouch.link import network_trace
from foretouch.robot import read_arm
from foretouch.session import SessionSettings
from foretouch.settings import ARMS, BASELINES, SIMULATED, is_arm, is_simulated
from foretouch.sweep.cases import Case, baseline_numbers, draw_case
from foretouch.sweep.outcome import Outcome, failed, run_case

FILE_NAME = "sessions.jsonl"  # Name of the file: a header, then one row a line

ROOMS = (
    *("quantities", "models", "messages", "identification", "rendering", "robot", "devices", "link", "recordings"),
    *("session", "report", "sweep"),
)
"""Folders whose code decides the outcome of a session."""

SHOWING = (
    "report/writing",
    "report/forces.py",
    "report/networks.py",
    "report/scene/touched.py",
    *(f"report/sections/{name}.py" for name in ("forces", "latency", "model", "robot", "scene")),
    "sweep/curves.py",
    "sweep/page.py",
)
"""Files and folders of these that only show it, or other things."""


KINDS = ("robot", "network", "budget", "protection")
"""What a plan may choose for all of its sessions, beside seed and duration."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings that all rows of a folder have in common."""

    version: str  # version of foretouch
    code: str  # digest of the code that ran the sessions
    seed: int  # seed of the sweep
    duration_s: float  # duration of sessions without delay [s]
    robot: str = SIMULATED  # of all sessions
    network: str = ""  # likewise
    budget: float = 0.0  # likewise
    protection: str = "parity"  # likewise


@functools.cache
def code_digest() -> str:
    """SHA-256 over the source that decides what a row is, from the materials to its figures."""
    root = Path(__file__).resolve().parents[1]
    sum_ = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if not name.startswith(SHOWING):
                sum_.update(name.encode() + path.read_bytes())
    return sum_.hexdigest()[:16]


class Store:
    """The rows in a folder, which is made if it is not there, of a plan.

    An InputError says that the folder cannot be used, or holds the rows of another sweep.
    """

    def __init__(self, folder: str | Path, plan: Plan) -> None:
        self.path = Path(folder) / FILE_NAME
        # It is, or will be, in the first line.
        kinds = (getattr(plan, name) for name in KINDS)
        self.header = Header(__version__, code_digest(), plan.seed, plan.duration, *kinds)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.exists():
                self._cut()
            if not self.path.exists() or not self.path.stat().st_size:
                self._append(msgspec.json.encode(self.header))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        header, rows = read_store(self.path)
        if header != self.header:
            differs = f"was made with --seed {header.seed} --duration {header.duration_s:g} --robot {header.robot}"
            differs += f" --network {header.network}" * bool(header.network)
            differs += f" --budget {header.budget:g} --protection {header.protection}" * bool(header.budget)
            if (header.version, header.code) != (self.header.version, self.header.code):
                differs = "was made by other code, whose sessions are not comparable"
            raise InputError(f"{self.path}: {differs}; give another --out, or remove the file")
        self.rows = rows  # by number and baseline, as many as there are

    def add(self, row: Outcome) -> None:
        """Append one row."""
        self._append(msgspec.json.encode(row))
        self.rows[row.number, row.baseline] = row

    def _append(self, line: bytes) -> None:
        with self.path.open("ab") as file:
            file.write(line + b"\n")

    def _cut(self) -> None:
        """A line that was not written to its end is no line."""
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            with self.path.open("r+b") as file:
                file.truncate(whole)


def read_store(path: Path) -> tuple[Header, dict[tuple[int, str], Outcome]]:
    """The header and all rows of a file; an InputError says that it is not there, or that a line in it is not ours."""
    try:
        first, *lines = path.read_bytes().splitlines()
    except (OSError, ValueError):
        raise InputError(f"{path}: there is no sweep: run `foretouch sweep --out {path.parent}` first") from None
    rows = {}
    decoder = msgspec.json.Decoder(Outcome)
    try:
        header = msgspec.json.decode(first, type=Header)
        for line in lines:
            row = decoder.decode(line)
            rows[row.number, row.baseline] = row
    except msgspec.DecodeError as error:
        where = f"line {len(rows) + 2}" if rows else "at its beginning"
        raise InputError(f"{path}, {where}: is no line of a sweep ({error}); give another --out") from None
    return header, rows


Progress = Callable[[int, int, Outcome], None]


@dataclass(frozen=True)
class Plan:
    """The sessions of a sweep.

    Args:
        sessions: Number of our sessions.
        baselines: Number of them that are run with each baseline too.
        duration: Duration of a session without delay [s], from 2 on.
        seed: Seed of all sessions.
        robot: Simulated robot of all sessions.
        network: Network of all sessions in the place of delays and faults that are drawn: a name, or a file; "" for
            none.
        budget: Bytes a second that each side of a session may send; 0 for all messages as they are.
        protection: What it sends against loss, then.

    Raises:
        SettingError: A number out of range, a robot that is not simulated, or a file that is no network's.
        UnknownNameError: There is no such network.
        InputError: No such description of an arm, or one that breaks a rule.
        MissingExtraError: MuJoCo is not installed, and the robot is an arm.
    """

    sessions: int = 1000
    baselines: int = 100
    duration: float = 30.0
    seed: int = 0
    robot: str = SIMULATED
    network: str = ""
    budget: float = 0.0
    protection: str = "parity"

    def __post_init__(self) -> None:
        require("sessions", self.sessions, at_least=1)
        require("baselines", self.baselines, at_least=0, at_most=self.sessions)
        require("duration", self.duration, at_least=2.0)
        require("seed", self.seed, at_least=0)
        if not is_simulated(self.robot):
            rule = f"must be simulated, {', '.join(ARMS)}, or the .xml of an arm's description"
            raise SettingError("robot", self.robot, rule)
        if self.network:
            network_trace(self.network)
        SessionSettings(budget=self.budget, protection=self.protection)  # refused here, and not in each session
        if is_arm(self.robot):
            read_arm(self.robot)  # one line here, and not one in each session

    def cases(self) -> list[Case]:
        """All sessions; a baseline's follow ours of the same number, so that a partial sweep can be compared."""
        same: Any = {name: getattr(self, name) for name in ("seed", "duration", *KINDS)}
        ours = [draw_case(number, **same) for number in range(self.sessions)]
        both = set(baseline_numbers(ours, self.baselines))
        return [
            case.rendering(baseline) for case in ours for baseline in (BASELINES if case.number in both else ("none",))
        ]


def run_sweep(
    folder: str | Path,
    plan: Plan,
    *,
    processes: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> list[Outcome]:
    """Run all sessions of a plan that the folder, which is made if it is not there, does not have yet.

    Each row is in its file as soon as it is known, and `progress` is then called with the number of rows there are, the
    total, and the row. Processes, cluster and `say` are those of `foretouch.comparison.compare`, and so are its errors.

    Returns:
        One row for each session of the plan, those that failed too, in its order.

    Raises:
        InputError: The folder cannot be used, or holds the rows of another sweep.
    """
    cases = plan.cases()
    store = Store(folder, plan)
    missing = [case for case in cases if (case.number, case.baseline) not in store.rows]
    done = len(cases) - len(missing)
    for _, row in run_all(run_case, missing, processes=processes, cluster=cluster, lost=failed, say=say):
        store.add(row)
        done += 1
        if progress is not None:
            progress(done, len(cases), row)
    return [store.rows[case.number, case.baseline] for case in cases]


@dataclass(frozen=True)
class Replayed:
    """A session that was run again.

    Attributes:
        stored: The row of the sweep.
        again: Its row now.
        same_code: Whether the code is that of the sweep.
    """

    stored: Outcome
    again: Outcome
    same_code: bool

    @property
    def identical(self) -> bool:
        """Whether both sessions are the same, bit by bit."""
        return self.stored.same_as(self.again)

    @property
    def sentence(self) -> str:
        """Whether, and where not why perhaps not."""
        name = f"session {self.stored.number}"
        if self.identical:
            return f"{name}: the same, bit by bit"
        why = "which other code explains" if not self.same_code else "with the same code: a fault, or another machine"
        return f"{name}: differs in {', '.join(self.differing)}, {why}"

    @property
    def differing(self) -> list[str]:
        """Names of the columns that differ."""
        before, now = msgspec.structs.asdict(self.stored), msgspec.structs.asdict(self.again)
        return [name for name in before if name != "elapsed_s" and before[name] != now[name]]

    def as_row(self) -> dict[str, Any]:
        """The report as plain values for JSON."""
        return {
            "identical": self.identical,
            "same_code": self.same_code,
            "differing": self.differing,
            "command": self.stored.command,
            "stored": msgspec.to_builtins(self.stored),
            "again": msgspec.to_builtins(self.again),
        }


def replay_session(folder: str | Path, number: int, *, baseline: str = "none") -> Replayed:
    """Run one session of a sweep again, by its number and the baseline that was rendered.

    An InputError says that there is no sweep in the folder, or no such session in it, an UnknownNameError no baseline.
    """
    if baseline not in BASELINES:
        raise UnknownNameError("baseline", baseline, BASELINES)
    header, rows = read_store(Path(folder) / FILE_NAME)
    stored = rows.get((number, baseline))
    if stored is None:
        of = "" if baseline == "none" else f" with the baseline {baseline}"
        raise InputError(f"{Path(folder) / FILE_NAME}: has no session {number}{of}, but {len(rows)} others")
    same: Any = {name: getattr(header, name) for name in ("seed", *KINDS)}
    case = draw_case(number, duration=header.duration_s, **same).rendering(baseline)
    return Replayed(stored, run_case(case), header.code == code_digest())
