"""A small process that starts one, times it and asks for its memory: `launcher.py RESULT COMMAND ...`.

The memory counted for a process includes what its parent held when it was started. So the parent must be small: this
file imports nothing but the standard library, and is run by its path.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time


def main(result: str, *command: str) -> None:
    """Run a command and write seconds, most memory (as the system counts it) and exit code into the file `result`."""
    start = time.perf_counter()
    child = subprocess.Popen(command)
    _, status, used = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    child.returncode = os.waitstatus_to_exitcode(status)
    with open(result, "w") as file:
        json.dump({"seconds": seconds, "peak": used.ru_maxrss, "code": child.returncode}, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
