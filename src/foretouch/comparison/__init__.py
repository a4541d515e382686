"""All laws by all estimators on any recordings, and on simulated ones whose truth is known."""

from foretouch.comparison.cases import Case, file_case, simulated_case, simulated_cases
from foretouch.comparison.combination import LocalStiffness, Prediction, Result, Scoring
from foretouch.comparison.compare import combinations, compare
from foretouch.comparison.page import write_comparison_page
from foretouch.comparison.simulated import SIMULATED, Simulated, simulate
from foretouch.comparison.table import render_table
from foretouch.comparison.truth import Convergence, ParameterError, Truth, convergence, unforeseeable

__all__ = [
    "SIMULATED",
    "Case",
    "Convergence",
    "LocalStiffness",
    "ParameterError",
    "Prediction",
    "Result",
    "Scoring",
    "Simulated",
    "Truth",
    "combinations",
    "compare",
    "convergence",
    "file_case",
    "render_table",
    "simulate",
    "simulated_case",
    "simulated_cases",
    "unforeseeable",
    "write_comparison_page",
]
