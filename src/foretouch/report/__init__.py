"""Evaluation of a session or a recording: scores, the report of a session, figures and the page."""

from foretouch.identification.force_calibration import lowest_mean
from foretouch.quantities import new_figure
from foretouch.report.drawing import COLOURS, finished, legend
from foretouch.report.energy import energy_account, energy_figures, exact_energy
from foretouch.report.forces import Forces, forces_under_delay, remarks, require_delay_within
from foretouch.report.networks import LIST_HEAD, network_figure, network_figures, network_lines, network_row
from foretouch.report.perception import (
    LargestJump,
    free_hand,
    largest_jump,
    oscillation,
    rendered_jump,
    swings,
    time_to_accuracy,
    turning_points,
    update_jumps,
)
from foretouch.report.rows import Pairs, force_at_follower, guarded_runs, pair
from foretouch.report.scene import SceneFindings, look_at_scene, scene_figures
from foretouch.report.scene.touched import TouchedMap, map_file, merged, read_map, touched_map
from foretouch.report.scores import STATUSES, Scores, delayed_force, score_prediction
from foretouch.report.sections.hand import hand_figures
from foretouch.report.sections.model import IDLE_LAW, law_is_idle, map_lines
from foretouch.report.sections.scene import map_figure, pose_figure
from foretouch.report.sections.session import left_out
from foretouch.report.session import CONTACT_FLOOR, session_figures
from foretouch.report.writing.pages import (
    embedded,
    named_values,
    table,
    tiles,
    write_calibration_page,
    write_html,
    write_page,
    write_prediction_page,
    write_weight_figure,
)
from foretouch.report.writing.replay import (
    Contact,
    compare_replay,
    contacts,
    render_replay,
    replay_figure,
    write_replay_page,
)
from foretouch.report.writing.session_report import Figures, SessionReport, findings, render_text, session_report

__all__ = [
    "COLOURS",
    "CONTACT_FLOOR",
    "IDLE_LAW",
    "LIST_HEAD",
    "STATUSES",
    "Contact",
    "Figures",
    "Forces",
    "LargestJump",
    "Pairs",
    "SceneFindings",
    "Scores",
    "SessionReport",
    "TouchedMap",
    "compare_replay",
    "contacts",
    "delayed_force",
    "embedded",
    "energy_account",
    "energy_figures",
    "exact_energy",
    "findings",
    "finished",
    "force_at_follower",
    "forces_under_delay",
    "free_hand",
    "guarded_runs",
    "hand_figures",
    "largest_jump",
    "law_is_idle",
    "left_out",
    "legend",
    "look_at_scene",
    "lowest_mean",
    "map_figure",
    "map_file",
    "map_lines",
    "merged",
    "named_values",
    "network_figure",
    "network_figures",
    "network_lines",
    "network_row",
    "new_figure",
    "oscillation",
    "pair",
    "pose_figure",
    "read_map",
    "remarks",
    "render_replay",
    "render_text",
    "rendered_jump",
    "replay_figure",
    "require_delay_within",
    "scene_figures",
    "score_prediction",
    "session_figures",
    "session_report",
    "swings",
    "table",
    "tiles",
    "time_to_accuracy",
    "touched_map",
    "turning_points",
    "update_jumps",
    "write_calibration_page",
    "write_html",
    "write_page",
    "write_prediction_page",
    "write_replay_page",
    "write_weight_figure",
]
