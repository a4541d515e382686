"""Fresh processes, timed, with what they did to memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from foretouch.bench import launcher
from foretouch.errors import ForetouchError

__all__ = ["ONE_THREAD", "Ended", "environment", "measure_process"]

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""No pool of threads takes a core that another contestant has."""


class Ended(NamedTuple):
    """A process that has ended well.

    Attributes:
        seconds: From its start to its end, start-up included.
        peak: Most memory that it held at once [bytes].
        output: What it printed.
    """

    seconds: float
    peak: int
    output: str


def environment() -> dict[str, str]:
    """That of this process, with one thread a pool."""
    return {**os.environ, **ONE_THREAD}


def measure_process(arguments: Sequence[str]) -> Ended:
    """Run Python with these arguments and wait for its end.

    Raises:
        ForetouchError: It ended otherwise than well.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
    ):
        result = Path(folder) / "result.json"
        command = [sys.executable, "-I", launcher.__file__, str(result), sys.executable, *arguments]
        subprocess.run(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=environment(), check=True)
        measured = json.loads(result.read_text())
        out.seek(0)
        err.seek(0)
        output, said = out.read(), err.read()
    if measured["code"]:
        last = said.strip().splitlines()[-1:] or ["it said nothing"]
        raise ForetouchError(f"{' '.join(arguments)}: exit code {measured['code']}: {last[0]}")
    return Ended(measured["seconds"], measured["peak"] * (1 if sys.platform == "darwin" else 1024), output)
