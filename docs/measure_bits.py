"""Measure the leader and the follower in C, and write it into their page: bits that differ from Python's, and ticks.

Usage: `.venv/bin/python docs/measure_bits.py [interpreted]`; it takes some twelve minutes, and needs gcc, clang,
qemu-aarch64 and aarch64-linux-gnu-gcc. With `interpreted` it compares with Python in which nothing is compiled instead,
which takes as long. Times hold for the machine, and for one that does nothing else meanwhile.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from measured_blocks import fill
from measuring import table

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "export"))
from packages import build  # noqa: E402
from session_log import SESSIONS, SOURCE, differing, given_by, logged  # noqa: E402
from session_ticks import Player, plain, random_ticks, randomly  # noqa: E402

from foretouch.export import TARGETS, lowered, write_package  # noqa: E402

PAGE = ROOT / "docs" / "export.md"
SECONDS, RANDOM, REPEATS = 20.0, 1_000_000, 50
LEARNT, SEED = "foam, normal grip", 26
COMPILERS = {
    "gcc": ("x86_64", ("gcc", "-std=c11", "-O2"), ()),
    "clang": ("x86_64", ("clang", "-std=c11", "-O2"), ()),
    "gcc for aarch64, emulated": (
        "aarch64",
        ("aarch64-linux-gnu-gcc", "-std=c11", "-O2", "-static"),
        ("qemu-aarch64",),
    ),
}


def programs(folder: Path) -> dict[str, list[object]]:
    """The command of a program for each compiler."""
    names = ("x86_64", "aarch64")
    for name, made in zip(names, lowered(*(TARGETS[name] for name in names)), strict=True):
        write_package(folder / name, TARGETS[name], lambda _, made=made: [made])
    return {
        name: [*before, build(folder / target, folder, *compiler, source=SOURCE)]
        for name, (target, compiler, before) in COMPILERS.items()
    }


def bits(commands: dict[str, list[object]]) -> str:
    """In how many ticks what C gives is not what Python gives, messages among it."""
    rows = []
    for name in SESSIONS:
        log = logged(name, SECONDS)
        counts = [str(differing(given_by(command, log), log.given)) for command in commands.values()]
        rows.append([name, f"{len(log.given):,}", *counts])
    taken = random_ticks(logged(LEARNT, 5.0), RANDOM, SEED)
    python = plain(Player().play(taken))
    counts = []
    for command in commands.values():
        words = randomly(command, taken)
        counts.append(str(np.count_nonzero(words != python)) if words.size == python.size else "other length")
    rows.append(["whatever comes: numbers, not ticks", f"{RANDOM:,}", *counts])
    return table(("Session", "Ticks", *commands), rows)


def interpreted(command: list[object]) -> str:
    """In how many numbers what C gives is not what Python gives when nothing of it is compiled."""
    python = ["env", "NUMBA_DISABLE_JIT=1", sys.executable, SOURCE.with_suffix(".py")]
    golden = b"".join(bytes(logged(name, SECONDS).taken) for name in SESSIONS)
    random = random_ticks(logged(LEARNT, 5.0), RANDOM, SEED)
    with ThreadPoolExecutor(2) as pool:
        given = list(pool.map(lambda taken: (randomly(python, taken), randomly(command, taken)), (golden, random)))
    names = "all sessions above", f"whatever comes, {RANDOM:,} ticks"
    return table(
        ("What came", "Numbers", "Of them others than interpreted Python's"),
        [[name, f"{a.size:,}", str(np.count_nonzero(a != b))] for name, (a, b) in zip(names, given, strict=True)],
    )


def ticks(command: list[object]) -> str:
    """How long a tick of the leader takes."""
    taken = bytes(logged(LEARNT, SECONDS).taken)
    runs = [
        np.frombuffer(subprocess.run([*map(str, command), "times"], input=taken, stdout=subprocess.PIPE).stdout, "<i8")
        for _ in range(REPEATS)
    ]
    times = np.array(runs) * 1e-3
    figures = [np.median(times), *np.percentile(times, [99, 99.9]), times.max(), times.min(axis=0).max()]
    shown = [f"{value:.1f}" for value in figures]
    heads = ("Ticks", "Median [us]", "99 of 100", "999 of 1,000", "Largest", "Largest of each tick's quickest")
    return table(heads, [[f"{times.size:,}", *shown]])


def main() -> None:
    """Measure both, or what is asked for."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as name:
        commands = programs(Path(name))
        if sys.argv[1:] == ["interpreted"]:
            measured = {"interpreted": interpreted(commands["gcc"])}
        else:
            measured = {"ticks": ticks(commands["gcc"]), "bits": bits(commands)}
    fill(PAGE, measured)


if __name__ == "__main__":
    main()
