"""A small process that starts one, times it and asks for its memory: `launcher.py RESULT COMMAND ...`.

A process counts as its own what whoever started it held at that moment. So whoever starts it must be small: this file
imports nothing but Python's own, and is run by its path.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time


def main(result: str, *command: str) -> None:
    """Run a command and write seconds, most memory (as the system counts it) and exit code into a file.

    Args:
        result: The file.
        *command: To run.
    """
    start = time.perf_counter()
    child = subprocess.Popen(command)
    _, status, used = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    child.returncode = os.waitstatus_to_exitcode(status)
    with open(result, "w") as file:
        json.dump({"seconds": seconds, "peak": used.ru_maxrss, "code": child.returncode}, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
