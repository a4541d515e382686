"""Draw the memory of a recorder over ten hours of session again, into `docs/images`.

Usage: `.venv/bin/python docs/draw_recorder_memory.py [CURVE]`. Without the output of
`tests/session/recorder_memory.py` it runs that first, which takes 20 minutes and 9 GB of disk.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

DOCS = Path(__file__).parent
SCRIPT = DOCS.parent / "tests" / "session" / "recorder_memory.py"
HOURS = 10


def measured() -> str:
    """What the script prints."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(SCRIPT), str(Path(folder) / "session.mcap"), str(HOURS)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def draw(text: str) -> None:
    """Memory and size of the file over messages."""
    _, messages, memory, size = np.array([line.split() for line in text.splitlines()], dtype=float).T
    figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    axes.plot(messages / 1e6, memory / 1024, "o-", color="#0b6e99", label="memory of the recorder [MB]")
    axes.set(xlabel="messages recorded [million]", ylabel="resident memory [MB]", xlim=(0, None))
    axes.set_ylim(0, 1.4 * memory.max() / 1024)
    beside = axes.twinx()
    beside.plot(messages / 1e6, size / 1e9, "--", color="#b5651d", label="file [GB]")
    beside.set(ylabel="file [GB]", ylim=(0, 1.2 * size.max() / 1e9))
    lines = [*axes.get_lines(), *beside.get_lines()]
    axes.legend(lines, [str(line.get_label()) for line in lines], loc="lower right", frameon=False)
    figure.savefig(DOCS / "images" / "recorder-memory.png", dpi=150)


if __name__ == "__main__":
    draw(Path(sys.argv[1]).read_text() if len(sys.argv) > 1 else measured())
