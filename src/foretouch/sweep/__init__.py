"""Many simulated sessions over all that a network, a hand and a material may do, and what became of them."""

from foretouch.sweep.cases import NETWORKS, Case, baseline_numbers, draw_case
from foretouch.sweep.curves import Curve, crossover, crossovers, curve, render_table, summary
from foretouch.sweep.outcome import LARGEST_JUMP, Outcome, run_case, totals
from foretouch.sweep.page import write_sweep_page
from foretouch.sweep.sweep import Plan, Replayed, replay_session, run_sweep

__all__ = [
    "LARGEST_JUMP",
    "NETWORKS",
    "Case",
    "Curve",
    "Outcome",
    "Plan",
    "Replayed",
    "baseline_numbers",
    "crossover",
    "crossovers",
    "curve",
    "draw_case",
    "render_table",
    "replay_session",
    "run_case",
    "run_sweep",
    "summary",
    "totals",
    "write_sweep_page",
]
