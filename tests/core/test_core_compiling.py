"""Compiled code is that of the sources as they are."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from numba import config
from numba.core import caching
from numpy.typing import NDArray

from foretouch.core import compiling
from foretouch.core.compiling import interpreted, kernel
from foretouch.session.safety import kernel as safety_kernel
from foretouch.session.safety.force_guard import ForceGuard, allowed_speed

PACKAGE = compiling.PACKAGE

SPEED = """
from foretouch.core.compiling import Kernel, complete_mark
from foretouch.session.safety.force_guard import ForceGuard, allowed_speed

speed = Kernel(allowed_speed, "f8(ForceGuard, f8, f8)")(ForceGuard.new(force=1.0)[0], 15.0, 0.0)
print(speed, sum(allowed_speed.stats.cache_hits.values()), complete_mark())
"""
"""The guard's speed far from anything: a force over 50 N/m times 10 ms, the latter a constant of another file."""


@kernel("f8(ForceGuard[::1], f8, f8)")
def speed_of(guards: NDArray[np.void], limit: float, damping: float) -> float:
    return allowed_speed(guards[0], limit, damping)


def half(number: float) -> float:
    return 0.5 * number


def copy_of_the_package(folder: Path) -> Path:
    copytree(PACKAGE, folder / "foretouch")
    return folder


def run_in(folder: Path, kept: Path) -> tuple[float, int, str]:
    """What the guard says in a process of its own that imports this copy, how much it found compiled, and its mark."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(kept), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run([sys.executable, "-c", SPEED], env=environment, capture_output=True, text=True, check=True)
    speed, result, mark = done.stdout.split()
    return float(speed), int(result), mark


@pytest.mark.long  # the digest itself is tried below
def test_a_constant_that_changes_in_another_file_is_compiled_anew_and_a_second_clone_compiles_nothing(
    tmp_path: Path,
) -> None:
    first, second, kept = copy_of_the_package(tmp_path / "first"), tmp_path / "second", tmp_path / "kept"
    speed, result, mark = run_in(first, kept)
    assert (speed, result) == (pytest.approx(14.0 / (50.0 * 0.01)), 0)
    assert mark.startswith(str(kept / "complete-"))
    copy_of_the_package(second)
    rules = second / "foretouch" / "session" / "safety" / "force_guard.py"
    sources = rules.read_text()
    rules.write_text(sources.replace("PATIENCE = 0.01\n", "PATIENCE = 0.04\n"))
    speed, result, changed = run_in(second, kept)
    assert (speed, result) == (pytest.approx(14.0 / (50.0 * 0.04)), 0)
    assert changed != mark
    # Another copy of the same sources, as of a second clone, finds what was compiled of the first, and still does.
    rules.write_text(sources)
    assert run_in(second, kept) == (pytest.approx(14.0 / (50.0 * 0.01)), 1, mark)


def test_the_digest_follows_imports_through_other_modules() -> None:
    sources = [PACKAGE / f"{name}.py" for name in ("session/safety/kernel", "session/safety/motion", "quantities/pose")]
    assert {sources[1], PACKAGE / "messages" / "__init__.py"} <= compiling.imported(sources[0])
    assert sources[2] in compiling.imported(sources[1])
    assert len({compiling.digest_of(source) for source in sources}) == 3


def test_a_module_that_is_moved_has_another_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code names the modules that it needs, and would not find them."""
    monkeypatch.setattr(compiling, "PACKAGE", tmp_path)
    for folder in ("before", "after"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "kernel.py").write_text("STEP = 1.0\n")
    before, after = (compiling.digest_of(tmp_path / folder / "kernel.py") for folder in ("before", "after"))
    assert before != after


def test_a_module_of_kernels_imports_at_its_margin_alone() -> None:
    """The digest sees no other imports."""
    for path in PACKAGE.rglob("*.py"):
        if compiling.has_kernels(path):
            lines = path.read_text().splitlines()
            assert not [line for line in lines if line.startswith(" ") and "from foretouch" in line], path


def test_all_kernels_are_compiled_in_the_one_way() -> None:
    others = [path for path in PACKAGE.rglob("*.py") if "njit" in path.read_text() and path != Path(compiling.__file__)]
    assert others == []


def test_numba_keeps_what_is_compiled_of_us_where_we_say_and_of_others_where_it_likes() -> None:
    if config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    folder = compiling.compiled_folder(safety_kernel.__file__)
    assert folder is not None
    assert folder.name == f"session.safety.kernel-{compiling.digest_of(Path(safety_kernel.__file__))}"
    assert safety_kernel.keep_safe.function._cache.cache_path == str(folder)
    assert safety_kernel.keep_safe.entry is not None  # compiled from here on
    assert list(folder.glob("kernel.keep_safe-*.nbi"))
    assert caching.CacheImpl._locator_classes[0].from_function(np.sum, np.__file__) is None


def test_where_nothing_can_be_kept_it_is_compiled_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file, not a folder")
    monkeypatch.setattr(config, "CACHE_DIR", str(taken))
    compiling.compiled_folder.cache_clear()
    try:
        assert compiling.compiled_folder(__file__) is None
        halved = compiling.compiled(half)
        assert halved(15.0) == 7.5
    finally:
        compiling.compiled_folder.cache_clear()


def test_versions_before_the_newest_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    for number in range(12):
        folder = tmp_path / f"session.safety.safety-{number:016x}"
        folder.mkdir()
        os.utime(folder, (number, number))
    (tmp_path / "session.safety.kernel-0000000000000000").mkdir()
    compiling.compiled_folder.cache_clear()
    try:
        folder = compiling.compiled_folder(str(PACKAGE / "session" / "safety" / "safety.py"))
    finally:
        compiling.compiled_folder.cache_clear()
    assert folder is not None
    left = sorted(tmp_path.glob("session.safety.safety-*"))
    assert folder in left
    assert len(left) == compiling.KEPT
    assert (tmp_path / "session.safety.kernel-0000000000000000").is_dir()


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("whose", ["another user's", "can be written by others"])
def test_what_others_may_have_written_is_not_loaded(
    whose: str, within: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "kept"
    source = PACKAGE / "session" / "safety" / "safety.py"
    folder = root / f"session.safety.safety-{compiling.digest_of(source)}"
    folder.mkdir(parents=True)
    root.chmod(0o700)
    folder.chmod(0o700)
    spoilt = folder if within else root
    if whose == "another user's":
        if os.geteuid() == 0:
            os.chown(spoilt, 12345, 12345)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: 12345)
    else:
        spoilt.chmod(0o770)
    monkeypatch.setattr(config, "CACHE_DIR", str(root))
    for kept in (compiling.compiled_folder, compiling._say_once):
        kept.cache_clear()
    try:
        assert compiling.compiled_folder(str(source)) is None
        assert compiling.compiled_folder(str(PACKAGE / "session" / "safety" / "safety.py")) is None
        told = capsys.readouterr().err
        assert whose in told
        assert len(told.splitlines()) == 1
        assert list(folder.iterdir()) == []
    finally:
        compiling.compiled_folder.cache_clear()


def test_a_kernel_takes_integers_as_numbers_and_refuses_what_is_no_array_of_records() -> None:
    guards = ForceGuard.new(force=1.0)
    as_floats = speed_of(guards, 15.0, 0.0)
    assert speed_of.entry(guards, 15, 0) == as_floats
    if not config.DISABLE_JIT:
        assert len(speed_of.function.overloads) == 1  # type: ignore[attr-defined]
        with pytest.raises(TypeError):
            speed_of(np.zeros(3), 15.0, 0.0)
    assert interpreted(speed_of)(guards, 15.0, 0.0) == as_floats  # type: ignore[arg-type]


def test_no_kernel_takes_a_square_as_a_power_whose_last_bits_are_those_of_the_c_library() -> None:
    powers = [
        f"{path}:{power.lineno}: {ast.unparse(power)}"
        for path in PACKAGE.rglob("*.py")
        if compiling.has_kernels(path)
        for function in ast.walk(ast.parse(path.read_text()))
        if isinstance(function, ast.FunctionDef) and compiling.DECORATED.search(decorators_of(function))
        for power in ast.walk(function)
        if isinstance(power, ast.BinOp) and isinstance(power.op, ast.Pow)
        if isinstance(power.right, ast.Constant) and isinstance(power.right.value, int)
    ]
    assert not powers, "`squared` rounds alike everywhere"


def decorators_of(function: ast.FunctionDef) -> str:
    return "\n".join(f"@{ast.unparse(one)}" for one in function.decorator_list)
