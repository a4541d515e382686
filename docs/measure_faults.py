"""Let faults come at random moments into sessions in real time, and write the table of `docs/faults.md`.

Usage: `.venv/bin/python docs/measure_faults.py [MINUTES]`; 13 without, of which the page has its figures.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from measured_blocks import fill

PAGE = Path(__file__).parent / "faults.md"
ROOT = PAGE.parents[1]
TEST = "tests/session/test_session_soak_fire.py"


def main(minutes: str) -> None:
    """Run the test that prints the table, and fill the page with it."""
    command = [sys.executable, "-m", "pytest", "-m", "soak", "-s", "-q", TEST]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "FIRE_MINUTES": minutes}, stdout=subprocess.PIPE, text=True
    )
    print(done.stdout)
    rows = [line for line in done.stdout.splitlines() if line.startswith("| ")]
    if not rows:
        raise SystemExit(f"{TEST} printed no table")
    fill(PAGE, {"faults": "\n".join(rows) + "\n"})


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "13")
