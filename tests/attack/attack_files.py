"""Hostile files against every reader: damaged ones, and small ones that ask for much.

    python tests/attack/attack_files.py [--files 400] [--seed 1] [--quick] [--commands]

Each is to be read, or refused in one line, without a traceback, within 20 s, and within a gigabyte or four times its
size. It prints what was tried, how often, and what failed, and ends with 1 where something did.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import bombs
import honest_files

from foretouch.errors import ForetouchError
from foretouch.files import within
from foretouch.recordings import (
    inspect_recording,
    read_calibration,
    read_mapping,
    read_poses,
    read_session,
    read_with_notes,
    repair_session,
)
from foretouch.rendering import read_mesh
from foretouch.vision import CameraModel

LONGEST = 20.0
"""A file may keep one busy for so long [s], where nobody else wants the processor."""

MOST_MEMORY = 1e9
"""Any file may take so much [bytes], and a large one four times its size."""

BAG_MAP = '[position]\ntopic = "/a"\nfield = "b"\nunit = "m"\n\n[force]\ntopic = "/a"\nfield = "q"\nunit = "N"\n'
TOKENS = (
    b"nan", b"inf", b"1e400", b"-1", b"0", b"9" * 30, b"", b'"', b"\0", b"\xff\xfe", b"\n", b"[", b"]", b"{", b"=",
    b";", b"\t", b"1,5", b"0x10", b"1_000",
)  # fmt: skip


# --- damage -----------------------------------------------------------------------------------------------------------


def damaged(content: bytes, rng: random.Random, *, text: bool) -> bytes:
    if text and rng.random() < 0.5:
        parts = re.split(rb"([^A-Za-z0-9_.+-]+)", content)
        for _ in range(rng.randint(1, 8)):
            parts[rng.randrange(len(parts))] = rng.choice(TOKENS)
        return b"".join(parts)
    damage = rng.choice((_flipped, _flipped, _cut, _number, _again, _filled, _inserted, _left_out, _swapped))
    result = bytearray(content)
    damage(result, rng)
    return bytes(result)


def _place(found: bytearray, rng: random.Random) -> int:
    size, kind = len(found), rng.random()
    if kind < 0.35:
        return rng.randrange(min(size, 512))
    return size - 1 - rng.randrange(min(size, 4096)) if kind < 0.6 else rng.randrange(size)


def _flipped(found: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 5, 20))):
        found[_place(found, rng)] ^= 1 << rng.randrange(8)


def _cut(found: bytearray, rng: random.Random) -> None:
    del found[rng.randrange(len(found)) :]


def _number(found: bytearray, rng: random.Random) -> None:
    number = rng.choice((0, 1, 2**28, 2**31 - 8, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1))
    packed = struct.pack("<Q", number)[: 8 if number >= 2**32 else rng.choice((4, 8))]
    place = min(_place(found, rng), max(0, len(found) - 8))
    found[place : place + len(packed)] = packed


def _again(found: bytearray, rng: random.Random) -> None:
    place = _place(found, rng)
    found[place:place] = found[place : place + rng.randrange(1, 5000)]


def _filled(found: bytearray, rng: random.Random) -> None:
    place = _place(found, rng)
    part = len(found[place : place + rng.randrange(1, 3000)])
    found[place : place + part] = rng.choice((b"\0", b"\xff")) * part


def _inserted(found: bytearray, rng: random.Random) -> None:
    place = _place(found, rng)
    found[place:place] = rng.randbytes(rng.randint(1, 64))


def _left_out(found: bytearray, rng: random.Random) -> None:
    place = _place(found, rng)
    del found[place : place + rng.randint(1, 64)]


def _swapped(found: bytearray, rng: random.Random) -> None:
    one, other, length = _place(found, rng), _place(found, rng), rng.randint(1, 200)
    found[one : one + length], found[other : other + length] = (
        found[other : other + length],
        found[one : one + length],
    )


# --- readers ----------------------------------------------------------------------------------------------------------


def readers(path: Path, aside: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    ending = path.suffix
    if ending in (".stl", ".obj", ".ply"):
        yield "mesh", lambda: read_mesh(path)
    elif ending == ".toml":
        yield "map", lambda: read_mapping(path)
        yield "calibration", lambda: read_calibration(path)
        yield "camera", lambda: CameraModel.read(path)
    else:
        yield "inspect", lambda: inspect_recording(path, "/a" if ending in (".mcap", ".db3") else None)
        yield "read", lambda: read_with_notes(path)
        if ending == ".csv":
            yield "poses", lambda: read_poses(path)
        if ending == ".mcap":
            for name, text in (("bomb's map", BAG_MAP), ("bag's map", honest_files.made_bags.MAP)):
                (aside / name).write_text(text)
                yield name, partial(read_with_notes, path, map_file=aside / name)
            yield "session", lambda: read_session(path)
            yield "repair", lambda: repair_session(path, aside / "repaired.mcap")


class Attack:
    def __init__(self, aside: Path) -> None:
        self.aside = aside
        self.tried: Counter[str] = Counter()
        self.read: Counter[str] = Counter()
        self.failures: list[str] = []
        self.slowest = (0.0, "")
        self.largest = 0
        self.memory = ""

    def file(self, path: Path, label: str) -> None:
        self.largest = max(self.largest, path.stat().st_size)
        for name, read in readers(path, self.aside):
            begun = time.perf_counter()
            try:
                read()
                self.read[name] += 1
            except ForetouchError as error:
                if len(str(error).splitlines()) != 1:
                    self.failures.append(f"{label}, {name}: more than one line: {error}")
            except Exception as error:
                self.failures.append(f"{label}, {name}: {type(error).__name__}: {error}")
            took = time.perf_counter() - begun
            self.slowest = max(self.slowest, (took, f"{label}, {name}"))
            self.tried[name] += 1
            if took > LONGEST * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)):
                self.failures.append(f"{label}, {name}: {took:.1f} s")

    def command(self, path: Path) -> None:
        command = ["recordings", "inspect", str(path)]
        if path.suffix in (".stl", ".obj", ".ply"):
            command = ["simulate", "--scene", str(path), "--duration", "0.05", "--json"]
        elif path.suffix == ".toml":
            command = ["identify", str(self.aside / "a.csv"), "--map", str(path)]
        self.tried["command"] += 1
        done = subprocess.run([sys.executable, "-m", "foretouch", *command], capture_output=True, text=True)
        if "Traceback" in done.stderr + done.stdout or done.returncode not in (0, 2):
            self.failures.append(f"{path.name}, command: exit code {done.returncode}: {done.stderr[-200:]}")
        if done.returncode == 2 and len(done.stderr.strip().splitlines()) != 1:
            self.failures.append(f"{path.name}, command: not one line: {done.stderr[-300:]}")

    def weigh(self) -> None:
        """See how much memory the processes took that read all files so far; none of another kind has run before."""
        within.close()
        most = 1024.0 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        allowed = max(MOST_MEMORY, 4.0 * self.largest)
        self.memory = f"most memory of a process that reads: {most / 1e6:.0f} MB"
        if most > allowed:
            self.failures.append(f"{most / 1e6:.0f} MB taken, where {allowed / 1e6:.0f} are allowed")

    def told(self) -> bool:
        for name, times in sorted(self.tried.items()):
            print(f"{name:<14} {times:5d} tried, {self.read[name]:4d} read, the others refused in one line")
        print(f"slowest: {self.slowest[0]:.1f} s ({self.slowest[1]}); {self.memory}")
        for failure in self.failures:
            print(f"FAILED {failure}")
        print("nothing failed" if not self.failures else f"{len(self.failures)} failed")
        return not self.failures


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=400, help="damaged files")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="leave out what takes longer than a second or two")
    parser.add_argument("--commands", action="store_true", help="give the bombs to the commands, too")
    given = parser.parse_args(arguments)
    rng = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        honest = honest_files.write_all(folder / "honest")
        attack = Attack(folder)
        (folder / "a.csv").write_bytes(honest["a.csv"].read_bytes())
        for file in honest.values():
            attack.file(file, f"honest {file.name}")
        unread = [
            name
            for name in ("inspect", "read", "bag's map", "mesh", "map", "camera", "session")
            if not attack.read[name]
        ]
        attack.failures += [f"{name}: not even the honest file is read" for name in unread]
        for number in range(given.files):
            file = list(honest.values())[number % len(honest)]
            text = file.suffix in (".csv", ".ddf", ".toml", ".obj") or file.name == "text.stl"
            path = folder / f"damaged{file.suffix}"
            path.write_bytes(damaged(file.read_bytes(), rng, text=text))
            attack.file(path, f"damage {number} to {file.name}, seed {given.seed}")
        for bomb, write in bombs.BOMBS.items():
            if given.quick and bomb in bombs.SLOW:
                continue
            path = folder / bomb
            write(path)
            attack.file(path, bomb)
        attack.weigh()
        for bomb in bombs.BOMBS if given.commands else ():
            attack.command(folder / bomb)
        count = len(bombs.BOMBS) - given.quick * len(bombs.SLOW)
        print(f"{len(honest)} honest files, {given.files} damaged ones, {count} bombs")
        return 0 if attack.told() else 1


if __name__ == "__main__":
    sys.exit(main())
