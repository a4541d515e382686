"""Packages of C for the tests, and programs built against them."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

Packages = dict[str, Path]
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
NATIVE = pytest.mark.skipif(os.uname().machine != "x86_64", reason="the program is for x86_64")


def needs(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: make system installs it")


@functools.cache
def sanitizes(compiler: str) -> bool:
    """Whether a compiler is here, and its sanitizers are, which clang has in a package of their own."""
    if shutil.which(compiler) is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        command = [compiler, "-x", "c", "-", "-fsanitize=address,undefined", "-o", f"{folder}/empty"]
        return subprocess.run(command, input=b"int main(void) {}", capture_output=True, check=False).returncode == 0


def build(package: Path, into: Path, *compiler: str, source: Path) -> Path:
    """A program of one source and the package."""
    needs(compiler[0])
    if any("-fsanitize" in word for word in compiler) and not sanitizes(compiler[0]):
        pytest.skip(f"the sanitizers of {compiler[0]} are not installed: make system installs them")
    program = into / "-".join(word.strip("-=") for word in compiler if "/" not in word).replace(",", "")
    own = [package / "src" / f"foretouch_{name}.c" for name in ("session", "wire")]
    kernels = package / "lib" / "foretouch_kernels.o"
    objects = [*own, kernels, "-pthread", "-lm", "-o", program]
    if source.suffix == ".cpp":  # of what is C, nothing is needed there
        objects = objects[2:]
    command = [*compiler, *STRICT, f"-I{package}/include", source, *objects]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program
