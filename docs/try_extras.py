"""What each extra of a driver or device brings, and whether its library is found, in an empty environment each.

Builds the wheel, installs `WHEEL[EXTRA]` from the package index into a new environment, and lets `foretouch` there use
the library: without one it would name the extra, with one it gets as far as the hardware, which is not here.

Usage: `.venv/bin/python docs/try_extras.py [EXTRA ...]`; all without a word. Some 20 s and 0.5 GB each, which
goes again. Ends with 1 where a library is not found.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PRESS = "".join(f"{k / 100:.2f},{k % 50 / 5000:.4f},{k % 50 / 50:.2f}\n" for k in range(300))
TRIED: Mapping[str, tuple[str, str]] = {
    "franka": ("plugins check franka@127.0.0.1", "port 1337 does not answer"),
    "ur": ("plugins check ur@127.0.0.1", "port 30004 does not answer"),
    "dynamixel": ("plugins check dynamixel@/dev/none,lever=0.06 --group robot", "plugged in"),
    "link": ("plugins check ros2@tcp/127.0.0.1:9 --group robot", "no ROS 2 router"),
    "haply": ("plugins check inverse3@127.0.0.1:9", "no Inverse Service answers"),
    "forcedimension": ("plugins check force-dimension", "libdhd and libdrd"),
    "spacemouse": ("plugins check spacemouse", "no SpaceMouse is connected"),
    "gamepad": ("plugins check gamepad", "no gamepad is connected"),
    "lerobot": ("recordings convert press.csv --to lerobot --output dataset", "dataset"),
}
"""Of each extra a command that uses its library, and a part of what is said only where the library is found."""

INSTALLED = """
import importlib.metadata as metadata, json
sizes = {}
for found in metadata.distributions():
    files = [file for file in found.files or [] if file.suffix != ".pyc"]
    sizes[found.metadata["Name"]] = sum(file.locate().stat().st_size for file in files if file.locate().is_file())
print(json.dumps(sizes))
"""


class Installed(NamedTuple):
    """An environment with the wheel and an extra."""

    sizes: dict[str, int]  # of each package there, as far as it is files of its own [byte]
    seconds: float  # that pip took, with the downloads [s]
    plugins: int  # lines of `foretouch plugins`
    answer: str  # last line that the command of `TRIED` said
    found: bool  # whether the library was


def run(*words: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """A command with its output as text, whatever its exit code."""
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=600, cwd=cwd)


def build(folder: Path) -> Path:
    """The wheel of this checkout.

    Raises:
        RuntimeError: It cannot be built.
    """
    done = run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    if done.returncode:
        raise RuntimeError(done.stderr)
    (wheel,) = folder.glob("*.whl")
    return wheel


def install(wheel: Path, extra: str, folder: Path) -> Installed:
    """A new environment in an empty folder with the wheel and an extra, "" for none.

    Raises:
        RuntimeError: The index has no wheels for it, or cannot be reached.
    """
    venv.create(folder / "env", with_pip=True)
    binaries = folder / "env" / "bin"
    start = time.monotonic()
    what = f"{wheel}[{extra}]" if extra else wheel
    done = run(binaries / "python", "-m", "pip", "install", "--no-compile", "--only-binary", ":all:", what)
    seconds = time.monotonic() - start
    if done.returncode:
        raise RuntimeError(done.stderr)
    sizes = json.loads(run(binaries / "python", "-c", INSTALLED).stdout)
    plugins = run(binaries / "foretouch", "plugins").stdout.count("\n")
    words, said = TRIED.get(extra, ("--version", "foretouch"))
    (folder / "press.csv").write_text("time_s,position_m,force_N\n" + PRESS)
    done = run(binaries / "foretouch", *words.split(), cwd=folder)
    answer = (done.stdout + done.stderr).strip().rpartition("\n")[2]
    return Installed(sizes, seconds, plugins, answer, said in answer and "not installed" not in answer)


def megabytes(sizes: Mapping[str, int]) -> float:
    """Of all packages together [MB]."""
    return sum(sizes.values()) / 1e6


def row(extra: str, base: Installed, one: Installed) -> str:
    """A line of the table: what the extra brings beyond the package without one."""
    brought = {name: size for name, size in one.sizes.items() if name not in base.sizes}
    names = ", ".join(sorted(brought, key=lambda name: -brought[name])) or "nothing"
    return f"| `{extra}` | {names} | {megabytes(brought):.1f} | {one.seconds:.0f} | {'yes' if one.found else 'NO'} |"


def main(extras: list[str]) -> int:
    """Print the table, and what was said."""
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        wheel, base = build(Path(scratch)), None
        for extra in ("", *extras):
            with tempfile.TemporaryDirectory() as folder:
                one = install(wheel, extra, Path(folder))
            base = base or one
            print(row(extra, base, one) if extra else f"without one: {megabytes(one.sizes):.0f} MB")
            print(f"    {one.plugins} plug-ins; {one.answer}", flush=True)
            wrong += not one.found
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or list(TRIED)))
