"""A wall clock that a test sets: Python imports this by itself where `PYTHONPATH` names this folder.

`WALL_CLOCK_OFFSET` names a file with the seconds by which the wall clock of this process is wrong; it is read at every
look at the clock, so that the clock can be stepped while the process runs. Monotonic clocks are left alone.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

if "WALL_CLOCK_OFFSET" in os.environ:
    _file = Path(os.environ["WALL_CLOCK_OFFSET"])
    _true_time, _true_time_ns = time.time, time.time_ns

    def _seconds() -> float:
        return float(_file.read_text() or 0.0)

    time.time = lambda: _true_time() + _seconds()
    time.time_ns = lambda: _true_time_ns() + round(_seconds() * 1e9)
