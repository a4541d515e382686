"""All laws by all estimators on any recordings, and on simulated ones whose truth is known."""

from foretouch.comparison.cases import SIMULATED, Case, Simulated, file_case, simulate, simulated_case, simulated_cases
from foretouch.comparison.combination import SWEEP, Scoring
from foretouch.comparison.compare import Results, combinations, compare
from foretouch.comparison.figures import Curve, delay_curves, delay_figure, delayed_force_curve, floors
from foretouch.comparison.page import write_comparison_page
from foretouch.comparison.result import LocalStiffness, Prediction, Result, render_table
from foretouch.comparison.truth import Convergence, ParameterError, Truth, convergence, unforeseeable

__all__ = [
    "SIMULATED",
    "SWEEP",
    "Case",
    "Convergence",
    "Curve",
    "LocalStiffness",
    "ParameterError",
    "Prediction",
    "Result",
    "Results",
    "Scoring",
    "Simulated",
    "Truth",
    "combinations",
    "compare",
    "convergence",
    "delay_curves",
    "delay_figure",
    "delayed_force_curve",
    "file_case",
    "floors",
    "render_table",
    "simulate",
    "simulated_case",
    "simulated_cases",
    "unforeseeable",
    "write_comparison_page",
]
