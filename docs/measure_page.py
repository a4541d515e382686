"""What the browser page is: its bits beside those of Python, its pace and its size, for `docs/demo.md`, and a picture.

Usage: `.venv/bin/python docs/measure_page.py [FOLDER]`; the folder is that of a page that is there already.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "export"))  # the browser and the courses are the tests' own

from page_browser import COURSE, PACE, PLAIN_MATHEMATICS, bits, numbers_of, opened, rows_of_python  # noqa: E402
from page_course import COURSES, aims  # noqa: E402

from foretouch.export import write_page  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "demo.png"

HELD = 6000
"""Ticks for which the last aim of a course is held, where it is measured how the handle swings."""


def compare(page: Any) -> None:
    """How many numbers of each course differ from Python's, and by how much."""
    for name, mathematics in {"without fused multiply-add": PLAIN_MATHEMATICS, "as this machine has it": {}}.items():
        python = rows_of_python(mathematics)
        print(f"numbers that differ from Python's, exp, log and pow {name}:")
        for course, options in COURSES.items():
            rows = numbers_of(page.evaluate(COURSE, [aims(), options])[0])
            differing = int(np.count_nonzero(bits(rows) != bits(python[course])))
            farthest = float(np.nanmax(np.abs(rows - python[course])))
            print(f"  {course:16s} {differing:6d} of {rows.size}, by at most {farthest:.1e}")


def swing(page: Any) -> None:
    """By how much the handle swings while nobody moves the aim."""
    held = aims() + [aims()[-1]] * HELD
    for name, delayed in {"model": False, "delayed force": True}.items():
        rows = numbers_of(page.evaluate(COURSE, [held, COURSES["foam"] | {"delayed": delayed}])[0])
        print(
            f"swing of a handle that is held in foam, 150 ms each way, {name}: {1e3 * np.ptp(rows[-3000:, 2]):.2f} mm"
        )


def pace(page: Any) -> None:
    """Frames and ticks in a second."""
    page.get_by_role("button", name="Press for me").click()
    page.wait_for_timeout(1000)
    frames, ticks, computing = page.evaluate(PACE)
    steps = np.diff(frames)
    print(f"a frame in {np.median(steps):.1f} ms, 99 % within {np.percentile(steps, 99):.1f} ms")
    print(f"{ticks:.0f} ticks a second, computed in {100 * computing:.1f} % of the time")


def picture(page: Any) -> None:
    """The page while a force is felt that has not arrived yet; 256 colours look the same in fewer bytes."""
    page.wait_for_function("latest[FELT] > 2 && latest[ARRIVED] < 0.5", timeout=20_000)
    taken = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    taken.quantize(256, method=Image.Quantize.MAXCOVERAGE).save(PICTURE, optimize=True)


def sizes(folder: Path) -> None:
    """Bytes of the page and of the module in it."""
    text = (folder / "index.html").read_text()
    module = base64.b64decode(json.loads(re.findall(r"const CONTENT = (\{.*\});\n", text)[0])["wasm"])
    packed = len(gzip.compress(text.encode(), 9))
    print(f"index.html {len(text.encode()) / 1e3:.0f} kB, {packed / 1e3:.0f} kB as a server compresses it")
    print(f"the module in it {len(module) / 1e3:.0f} kB, {len(gzip.compress(module, 9)) / 1e3:.0f} kB compressed")


def main(folder: Path) -> None:
    with opened(folder, "?clock=off") as page:
        compare(page)
        swing(page)
    with opened(folder) as page:
        pace(page)
        picture(page)
    sizes(folder)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]).resolve())
    else:
        with tempfile.TemporaryDirectory() as made:
            write_page(Path(made, "page"))
            main(Path(made, "page"))
