"""The benchmarks, those of one kind in a file: `measure_NAME(scope)` returns the rows of one."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from foretouch.bench.rows import Row, Scope
from foretouch.errors import UnknownNameError

__all__ = ["BENCHMARKS", "Measure", "benchmark"]

Measure = Callable[[Scope], list[Row]]
"""What a benchmark is."""

BENCHMARKS: dict[str, tuple[str, str]] = {
    "fprls": ("updates", "the paper's estimator over one recording, beside peers"),
    "batch": ("streams", "the paper's estimator over thousands of recordings at once"),
    "call": ("updates", "one call a sample from Python, and what it leaves in memory"),
    "map": ("updates", "the contact map over one recording, and against its cells"),
    "mesh": ("updates", "the proxy on a mesh, against its triangles"),
    "steps": ("steps", "the steps of leader and follower"),
    "profile": ("profile", "where the time of both steps goes, part by part"),
    "simulate": ("steps", "a session in simulated time"),
    "loops": ("loops", "a session in real time with console and recorder, beside a bare loop"),
    "link": ("link", "one-way times between two processes, over TCP, TLS and QUIC"),
    "identify": ("commands", "an hour of samples through `foretouch identify`"),
    "compare": ("commands", "many recordings through `foretouch compare`, two at a time"),
    "growth": ("streams", "time and memory of ever longer streams"),
    "startup": ("commands", "fresh processes"),
}
"""Names, the module of each and what it measures, in the order in which they run."""


def benchmark(name: str) -> Measure:
    """What measures a benchmark; imported only now.

    Raises:
        UnknownNameError: There is none of that name.
    """
    if name not in BENCHMARKS:
        raise UnknownNameError("benchmark", name, BENCHMARKS)
    measure: Measure = getattr(importlib.import_module(f"{__name__}.{BENCHMARKS[name][0]}"), f"measure_{name}")
    return measure
