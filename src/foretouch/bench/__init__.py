"""How fast everything is on the user's machine, beside peers and beside what is asked for."""

from foretouch.bench.benchmarks import BENCHMARKS, benchmark, run_benchmarks
from foretouch.bench.check import Checked, check, read_baseline
from foretouch.bench.timing import Row, Scope, render_table

__all__ = [
    "BENCHMARKS",
    "Checked",
    "Row",
    "Scope",
    "benchmark",
    "check",
    "read_baseline",
    "render_table",
    "run_benchmarks",
]
