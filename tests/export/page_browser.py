"""The page in a real browser: what its tests and the measuring of it share."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "console"))
from console_driver import chromium  # noqa: E402

__all__ = ["COURSE", "PACE", "PLAIN_MATHEMATICS", "TRIAL", "bits", "chromium", "numbers_of", "opened", "rows_of_python"]

PLAIN_MATHEMATICS = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"}
"""By which the C library computes exp, log and pow without fused multiply-add, as WebAssembly has none."""


@contextmanager
def opened(folder: Path, query: str = "", **context: Any) -> Iterator[Any]:
    """The page in a browser, opened as a file; nothing may be asked for or complained about."""
    from playwright.sync_api import sync_playwright

    said: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(**({"viewport": {"width": 1366, "height": 768}} | context))
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: said.append(request.url) if request.url[:4] == "http" else None)
        page.goto(f"file://{folder}/index.html{query}")
        page.wait_for_function("frames > 2", timeout=20_000)
        yield page
        browser.close()
    assert said == []


COURSE = """([aims, options]) => new Promise((done) => {
  heard.course = (m) => done([Array.from(new BigUint64Array(m.rows.buffer), String), m.up, m.down]);
  tell("course", { aims: Float64Array.from(aims), ...options });
})"""


def bits(rows: np.ndarray) -> np.ndarray:
    """Numbers by their bits; every number that is none is the same."""
    return np.where(np.isnan(rows), np.uint64(0x7FF8000000000000), rows.view(np.uint64))


def numbers_of(words: list[str]) -> NDArray[np.float64]:
    """Rows of a course, of the words of 64 bits that the browser gives."""
    return np.array([int(word) for word in words], np.uint64).view(np.float64).reshape(-1, 10)


def rows_of_python(mathematics: dict[str, str]) -> dict[str, NDArray[np.float64]]:
    """What `page_course.every` gives, in a process with this mathematics."""
    with tempfile.TemporaryDirectory() as folder:
        rows = Path(folder, "rows.npz")
        command = [sys.executable, str(HERE / "page_course.py"), str(rows)]
        subprocess.run(command, env=os.environ | mathematics, check=True)
        with np.load(rows) as read:
            return dict(read)


PACE = """async () => {
  const times = [], before = [state.made, state.spent, performance.now()];
  await new Promise((done) => {
    const next = (now) => (times.push(now) > 300 ? done() : requestAnimationFrame(next));
    requestAnimationFrame(next);
  });
  const passed = (performance.now() - before[2]) / 1000;
  return [times, (state.made - before[0]) / passed, (state.spent - before[1]) / 1000 / passed];
}"""
"""Times of frames [ms], ticks a second, and the ratio of time in which they are computed; while five seconds pass."""

TRIAL = """() => new Promise((done) => {
  const say = () => [Array.from(result.predicted), result.predicted_rms, result.delayed_rms, result.rms];
  const wait = () => (result ? done(say())
    : setTimeout(wait, 50));
  wait();
})"""
