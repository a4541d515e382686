"""The package for C: the same bits as in Python, whatever compiles it, and no more than it says."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from packages import NATIVE, Packages, build, needs
from safety_ticks import COLUMNS, random_ticks, run
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.export import TARGETS, Lowered, write_package
from foretouch.export.entries import ENTRIES
from foretouch.export.structs import comments
from foretouch.session.safety.kernel import Memory

HERE = Path(__file__).parent
MATHEMATICS = {"ceil", "exp", "expm1", "floor", "fabs", "frexp", "hypot", "log", "pow", "sqrt"}
MEMORY = {"memcpy", "memset"}


def build_safety(package: Path, into: Path, *compiler: str, source: Path = HERE / "safety_ticks.c") -> Path:
    return build(package, into, *compiler, source=source)


def fed(command: list[object], rows: np.ndarray) -> bytes:
    done = subprocess.run(list(map(str, command)), input=rows.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return done.stdout


@NATIVE
@pytest.mark.parametrize(
    "compiler", ["gcc -std=c11 -O2", "clang -std=c11 -O2", "gcc -std=c11 -fsanitize=address,undefined"]
)
@pytest.mark.first
def test_the_same_bits_as_compiled_python(package: Path, tmp_path: Path, compiler: str) -> None:
    program, rows = build_safety(package, tmp_path, *compiler.split()), random_ticks(100_000, 1)
    assert fed([program], rows) == run(rows)


@NATIVE
@pytest.mark.long
def test_the_same_bits_for_long(package: Path, tmp_path: Path) -> None:
    program, rows = build_safety(package, tmp_path, "gcc", "-std=c11", "-O2"), random_ticks(1_000_000, 2)
    assert fed([program], rows) == run(rows)


def interpreted_run(rows: np.ndarray) -> bytes:
    surroundings = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, str(HERE / "safety_ticks.py")]
    done = subprocess.run(command, input=rows.tobytes(), capture_output=True, env=surroundings, check=True)
    return done.stdout


@NATIVE
@pytest.mark.parametrize("count", [10_000, pytest.param(100_000, marks=pytest.mark.long)])
@pytest.mark.long
def test_the_same_bits_as_interpreted_python(package: Path, tmp_path: Path, count: int) -> None:
    program, rows = build_safety(package, tmp_path, "gcc", "-std=c11", "-O2"), random_ticks(count, 3)
    assert fed([program], rows) == interpreted_run(rows) == run(rows)


def test_the_ticks_reach_every_status() -> None:
    rows = random_ticks(100_000, 3)
    results = np.frombuffer(run(rows)[: 24 * len(rows)]).reshape(-1, 3)
    assert set(results[:, 1]) == {0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0}  # retreating is asked for, the rest are others'
    assert len(COLUMNS) == rows.shape[1]


@NATIVE
def test_two_states_in_two_threads(package: Path, tmp_path: Path) -> None:
    program, rows = build_safety(package, tmp_path, "gcc", "-std=c11", "-O2"), random_ticks(20_000, 4)
    first, second = run(rows[:10_000]), run(rows[10_000:])
    size = 24 * 10_000
    both = first[:size] + first[size:] + second[:size] + second[size:]
    assert fed([program, "threads"], rows) == both


@pytest.mark.long
def test_the_same_bits_on_aarch64(packages: Packages, tmp_path: Path) -> None:
    needs("qemu-aarch64")
    program = build_safety(packages["aarch64"], tmp_path, "aarch64-linux-gnu-gcc", "-std=c11", "-O2", "-static")
    rows = random_ticks(20_000, 5)
    assert fed(["qemu-aarch64", program], rows) == run(rows)


@NATIVE
@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_wrapper_of_cpp(package: Path, tmp_path: Path, compiler: str) -> None:
    program = build_safety(package, tmp_path, compiler, "-std=c++17", source=HERE / "safety_wrapper.cpp")
    assert subprocess.run([program], capture_output=True, text=True, check=True).stdout == "0 1 0.001 2\n"


@pytest.mark.parametrize("target", ["x86_64", "aarch64"])
@pytest.mark.long
def test_the_code_needs_mathematics_and_memory_alone(packages: Packages, target: str) -> None:
    needs("nm")
    kernels = packages[target] / "lib" / "foretouch_kernels.o"
    listed = subprocess.run(["nm", str(kernels)], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r" U (\w+)", listed)) <= MATHEMATICS | MEMORY
    exported = set(re.findall(r" T (\w+)", listed))
    begins = "leader_init", "leader_unfelt_init", "follower_init", "safety_init", "safety_limits_init"
    assert exported == {f"foretouch_{name}" for name in (*begins, *(entry.name for entry in ENTRIES))}
    assert not re.findall(r" [BbDdC] ", listed), "nothing is kept outside of the structs"


@pytest.mark.long
def test_every_target_has_code_of_its_kind(made: dict[str, Lowered]) -> None:
    begins = {"x86_64": (b"\x7fELF\x02", 62), "aarch64": (b"\x7fELF\x02", 183), "armv7": (b"\x7fELF\x01", 40)}
    for name, (begin, machine) in begins.items():
        assert made[name].content.startswith(begin)
        assert int.from_bytes(made[name].content[18:20], "little") == machine
    assert made["wasm32"].content.startswith(b"\0asm")


def test_the_header_says_what_python_says(package: Path) -> None:
    header = (package / "include" / "foretouch.h").read_text()
    assert "double impedance; /* Z [N s/m] */" in header
    assert "/* Largest speed inwards on the return to the commands after a hold [m/s] */" in header
    assert "FORETOUCH_OBSTRUCTED = 10" in header
    assert all(said in header.replace("\n       ", " ") for said in comments(Memory).values())


@NATIVE
def test_it_is_found_by_cmake(package: Path, tmp_path: Path) -> None:
    needs("cmake")
    installed, user = tmp_path / "installed", tmp_path / "user"
    user.mkdir()
    (user / "main.c").write_text((HERE / "safety_ticks.c").read_text())
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(user C)\nfind_package(foretouch 0.1 REQUIRED)\n"
        "find_package(Threads REQUIRED)\nadd_executable(ticks main.c)\n"
        "target_link_libraries(ticks foretouch::foretouch Threads::Threads)\n"
    )
    for command in (
        ["cmake", "-S", package, "-B", tmp_path / "b", f"-DCMAKE_INSTALL_PREFIX={installed}"],
        ["cmake", "--build", tmp_path / "b", "--target", "install"],
        ["cmake", "-S", user, "-B", tmp_path / "u", f"-DCMAKE_PREFIX_PATH={installed}"],
        ["cmake", "--build", tmp_path / "u"],
    ):
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    rows = random_ticks(1_000, 6)
    assert fed([tmp_path / "u" / "ticks"], rows) == run(rows)


Refused = Callable[[Path], list[str]]


def a_file(folder: Path) -> list[str]:
    (folder / "there").write_text("")
    return ["--out", str(folder / "there")]


def something_else(folder: Path) -> list[str]:
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("")
    return ["--out", str(folder / "mine")]


def a_program_beside_a_package(folder: Path) -> list[str]:
    """What somebody has written into a package."""
    for name in ("lib/foretouch_kernels.o", "include/foretouch.h", "build/mine.c"):
        (folder / "package" / name).parent.mkdir(parents=True)
        (folder / "package" / name).write_text("")
    return ["--out", str(folder / "package")]


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (lambda folder: ["--out", str(folder / "x"), "--target", "z80"], "unknown target 'z80': choose one of aarch64"),
        (a_file, "is there and is no folder"),
        (something_else, "holds something else than such a package"),
        (a_program_beside_a_package, "holds something else than such a package (build/mine.c)"),
        (lambda folder: ["--out", str(folder / "no" / "x")], "there is no folder"),
        (lambda folder: ["--out", str(folder / ("x" * 300))], "cannot be written: File name too long"),
        (lambda _: ["--out", "."], "is the folder that you are in"),
        (lambda _: ["--out", "/sys/foretouch-c"], "cannot be written"),
        (lambda _: ["--out", "/proc/foretouch-c"], "cannot be written"),
        (lambda folder: ["--out", str(folder / "x"), "--scene", "plane"], "sessions along a line alone are exported"),
        (
            lambda folder: ["--out", str(folder / "x"), "--model", "kelvin-voigt"],
            "the follower of C learns contact-map",
        ),
        (lambda folder: ["--out", str(folder / "x"), "--estimator", "offline"], "the follower of C learns by bank"),
        (lambda folder: ["--out", str(folder / "x"), "--calibration", "arm.toml"], "reads no calibration"),
        (lambda folder: ["--out", str(folder / "x"), "--budget", "4000"], "are each sent whole"),
        (lambda folder: ["--out", str(folder / "x"), "--robot", "franka@192.0.2.1"], "name a simulated one"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_compiled(tmp_path: Path, given: Refused, line: str) -> None:
    words = given(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    done = CliRunner().invoke(app, ["export", "c", *words])
    assert line in str(done.exception)
    assert sorted(tmp_path.rglob("*")) == before


def test_what_fails_leaves_the_earlier_package(package: Path, tmp_path: Path) -> None:
    def fails(_: object) -> list[Lowered]:
        raise OSError(28, "No space left on device")

    shutil.copytree(package, tmp_path / "p")
    before = {path: path.read_bytes() for path in (tmp_path / "p").rglob("*") if path.is_file()}
    with pytest.raises(OSError, match="No space"):
        write_package(tmp_path / "p", TARGETS["aarch64"], fails)
    assert {path: path.read_bytes() for path in (tmp_path / "p").rglob("*") if path.is_file()} == before


@pytest.mark.long
def test_the_command_writes_the_same_bytes_again(package: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["export", "c", "--out", str(tmp_path / "p"), "--target", "x86_64", "--json"])
    files = json.loads(done.stdout)["files"]
    assert files == sorted(str(path.relative_to(package)) for path in package.rglob("*") if path.is_file())
    for name in files:
        assert (tmp_path / "p" / name).read_bytes() == (package / name).read_bytes()
