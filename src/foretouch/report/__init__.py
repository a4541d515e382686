"""What a session or a recording shows: scores, the report of a session, figures and the page."""

from foretouch.identification.force_calibration import lowest_mean
from foretouch.quantities import new_figure
from foretouch.report.energy import energy_account, energy_figures, exact_energy
from foretouch.report.forces import Forces, forces_under_delay, remarks, require_delay_within
from foretouch.report.hand import free_hand, hand_figures, oscillation, swings, turning_points
from foretouch.report.pairs import Pairs, force_at_follower, pair
from foretouch.report.perception import LargestJump, largest_jump, rendered_jump, time_to_accuracy, update_jumps
from foretouch.report.replay import Contact, compare_replay, contacts, render_replay
from foretouch.report.scene.drawing import map_figure, pose_figure
from foretouch.report.scene.scene import SceneFindings, look_at_scene, scene_figures
from foretouch.report.scores import STATUSES, Scores, delayed, score
from foretouch.report.session import CONTACT_FLOOR, session_report
from foretouch.report.statuses import guarded_runs
from foretouch.report.writing.calibration_page import write_calibration_page
from foretouch.report.writing.drawing import COLOURS, finished, legend
from foretouch.report.writing.html import embedded, named_values, table, tiles, write_html
from foretouch.report.writing.page import write_page, write_prediction_page
from foretouch.report.writing.replay_page import replay_figure, write_replay_page
from foretouch.report.writing.safety_text import left_out
from foretouch.report.writing.text import IDLE_LAW, findings, law_is_idle, map_lines, render_text

__all__ = [
    "COLOURS",
    "CONTACT_FLOOR",
    "IDLE_LAW",
    "STATUSES",
    "Contact",
    "Forces",
    "LargestJump",
    "Pairs",
    "SceneFindings",
    "Scores",
    "compare_replay",
    "contacts",
    "delayed",
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
    "map_lines",
    "named_values",
    "new_figure",
    "oscillation",
    "pair",
    "pose_figure",
    "remarks",
    "render_replay",
    "render_text",
    "rendered_jump",
    "replay_figure",
    "require_delay_within",
    "scene_figures",
    "score",
    "session_report",
    "swings",
    "table",
    "tiles",
    "time_to_accuracy",
    "turning_points",
    "update_jumps",
    "write_calibration_page",
    "write_html",
    "write_page",
    "write_prediction_page",
    "write_replay_page",
]
