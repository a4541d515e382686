"""The benchmarks, one a file: each has `measure(scope)`, which returns its rows."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from foretouch.bench.rows import Row, Scope
from foretouch.errors import UnknownNameError

__all__ = ["BENCHMARKS", "Measure", "benchmark"]

Measure = Callable[[Scope], list[Row]]
"""What a benchmark is."""

BENCHMARKS: dict[str, str] = {
    "fprls": "the paper's estimator over one recording, beside peers",
    "batch": "the paper's estimator over thousands of recordings at once",
    "call": "one call a sample from Python, and what it leaves in memory",
    "map": "the contact map over one recording, and against its cells",
    "mesh": "the proxy on a mesh, against its triangles",
    "steps": "the steps of leader and follower",
    "profile": "where the time of both steps goes, part by part",
    "simulate": "a session in simulated time",
    "loops": "a session in real time with console and recorder, beside a bare loop",
    "link": "one-way times between two processes, over TCP, TLS and QUIC",
    "identify": "an hour of samples through `foretouch identify`",
    "compare": "many recordings through `foretouch compare`, two at a time",
    "growth": "time and memory of ever longer streams",
    "startup": "fresh processes",
}
"""Names and what each measures, in the order in which they run."""


def benchmark(name: str) -> Measure:
    """What measures a benchmark; imported only now.

    Raises:
        UnknownNameError: There is none of that name.
    """
    if name not in BENCHMARKS:
        raise UnknownNameError("benchmark", name, BENCHMARKS)
    measure: Measure = importlib.import_module(f"{__name__}.{name}").measure
    return measure
