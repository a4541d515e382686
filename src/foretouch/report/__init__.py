"""What a session or a recording shows: scores, the report of a session, figures and the page."""

from foretouch.report.page import write_page, write_prediction_page
from foretouch.report.pairs import Pairs, force_at_follower, pair
from foretouch.report.scores import STATUSES, Scores, delayed, lowest_mean, score
from foretouch.report.session import CONTACT_FLOOR, session_report
from foretouch.report.text import findings, render_text

__all__ = [
    "CONTACT_FLOOR",
    "STATUSES",
    "Pairs",
    "Scores",
    "delayed",
    "findings",
    "force_at_follower",
    "lowest_mean",
    "pair",
    "render_text",
    "score",
    "session_report",
    "write_page",
    "write_prediction_page",
]
