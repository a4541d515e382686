"""The page for a browser: the kernels as WebAssembly, with a simulated robot, hand and network around them."""

from __future__ import annotations

import base64
import importlib.metadata
import io
import json
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.errors import ForetouchError, SettingError
from foretouch.export.beginnings import PRESSED
from foretouch.export.lowering import Lowered, lowered
from foretouch.export.package import beside, refused, require_folder, write_package
from foretouch.export.targets import TARGETS, Target
from foretouch.messages import STATUS_SENTENCES, Status
from foretouch.robot import make_material
from foretouch.robot.slide import exchange, make_slide
from foretouch.session.settings import SessionSettings

PARTS = Path(__file__).with_name("page")
"""What is written by hand."""

FILES = ("example.csv", "index.html")
"""Files of the page."""

LIBRARY = Path("/usr/lib/wasm32-wasi")
"""Where the C library for WebAssembly lies."""

COMPILER = ("clang", "--target=wasm32-wasi", "-Oz", "-std=c11", "-ffp-contract=off", "-c")
LINKER = ("wasm-ld", "--no-entry", "--gc-sections", "--strip-all", "--compress-relocations", "-z", "stack-size=262144")


def write_page(out: Path, lower: Callable[[Target], list[Lowered]] = lowered) -> list[str]:
    """Write the page, and beside it the recording that is its example; each is there whole, or as it was.

    Args:
        out: A folder that is not there yet, is empty, or holds such a page, which is replaced.
        lower: Makes the code.

    Returns:
        Its files.

    Raises:
        SettingError: The folder cannot be that.
        ForetouchError: A tool is missing, or something cannot be compiled.
    """
    require_page_place(out)
    require_tools()
    example = example_recording()
    page = page_text(web_assembly(lower), example)
    with refused(out), beside(out) as folder:
        for name, text in zip(FILES, (example, page), strict=True):
            Path(folder, name).write_text(text, encoding="utf-8")
        out.mkdir(exist_ok=True)
        for name in FILES:
            Path(folder, name).replace(out / name)
    return list(FILES)


def require_page_place(out: Path) -> None:
    """Refuse a folder that a page cannot be written to, before anything is compiled."""
    with refused(out):
        require_folder(out)
        others = sorted({path.name for path in out.iterdir()} - set(FILES)) if out.exists() else []
        if others:
            what = f"holds something else than such a page ({others[0]}): name another folder"
            raise SettingError("out", str(out), what)


def require_tools() -> None:
    """Refuse to begin without the tools that link WebAssembly."""
    missing = [program for program in ("clang", "wasm-ld") if shutil.which(program) is None]
    missing += [] if (LIBRARY / "libc.a").is_file() else ["the C library for WebAssembly"]
    if missing:
        named, are = " and ".join(missing), "is" if len(missing) == 1 else "are"
        raise ForetouchError(f"page: {named} {are} missing: on Debian, sudo apt-get install clang lld wasi-libc")


def web_assembly(lower: Callable[[Target], list[Lowered]] = lowered) -> bytes:
    """The kernels and what the page's worker calls, as one module that needs nothing of its surroundings."""
    with tempfile.TemporaryDirectory(prefix="foretouch-page-") as folder:
        package = Path(folder, "package")
        write_package(package, TARGETS["wasm32"], lower)
        glue = Path(folder, "page.c")
        glue.write_text(_filled((PARTS / "page.c").read_text(), _constants()))
        objects = [package / "lib" / "foretouch_kernels.o"]
        for source in (glue, package / "src" / "foretouch_session.c", package / "src" / "foretouch_wire.c"):
            objects.append(Path(folder, source.stem + ".o"))
            _run(*COMPILER, f"-I{package}/include", f"-I{package}/src", source, "-o", objects[-1])
        module = Path(folder, "page.wasm")
        _run(*LINKER, *objects, f"-L{LIBRARY}", "-lm", "-lc", "-o", module)
        return module.read_bytes()


def _run(*command: Any) -> None:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise ForetouchError(f"page: {command[0]} failed: {said[0] if said else done.returncode}")


def _constants() -> dict[str, str]:
    device = SessionSettings().device
    begins = ", ".join(f"foretouch_slide_{name.replace('-', '_')}_init" for name in PRESSED)
    numbers = {"DELAY": device.delay, "RESOLUTION": device.resolution, "LARGEST": device.force_limit}
    return {"MATERIALS": begins} | {name: repr(value) for name, value in numbers.items()}


def _filled(text: str, words: dict[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text


def page_text(module: bytes, example: str) -> str:
    """The page, with all that it needs in it, for a page that is opened from a file may fetch nothing."""
    content = {
        "wasm": base64.b64encode(module).decode(),
        "worker": (PARTS / "worker.js").read_text(),
        "materials": [{"name": name, "about": make_material(name).description} for name in PRESSED],
        "statuses": {status.value: STATUS_SENTENCES[status] for status in Status if status.value},
        "example": example,
    }
    words = {
        "STYLE": (PARTS / "page.css").read_text(),
        "VERSION": importlib.metadata.version("foretouch"),
        "SCRIPT": "".join((PARTS / name).read_text() for name in ("page.js", "recording.js")),
        "CONTENT": json.dumps(content).replace("</", "<\\/"),
    }
    return _filled((PARTS / "index.html").read_text(), words)


EXAMPLE_SECONDS = 12  # Length of the example [s]
EXAMPLE_STEP = 4  # Ticks of 1 ms from one of its samples to the next


def example_recording() -> str:
    """Presses of simulated foam, each different, as a CSV."""
    slides, random, move = make_slide("foam-measured"), np.random.default_rng(7), exchange.entry
    lines = io.StringIO()
    lines.write("time_s,position_m,force_N\n")
    for tick in range(1000 * EXAMPLE_SECONDS):
        time = 1e-3 * tick
        depth = (0.0145 + 0.0035 * math.sin(1.3 * time)) * math.sin(math.pi * time / 1.5) ** 2
        sample = move(slides, depth + 0.0015 * math.sin(7.0 * time), *random.standard_normal(3).tolist())
        if tick % EXAMPLE_STEP == 0:
            lines.write(f"{time:.3f},{sample[0]:.6f},{sample[1] + 0.981:.4f}\n")
    return lines.getvalue()
