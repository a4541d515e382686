"""The paper, made again: its figures, its tables, and whether its claims hold."""

from foretouch.reproduction.claims import Claim, Verdict
from foretouch.reproduction.page import PAPER, counted
from foretouch.reproduction.registry import SECTIONS, make_section
from foretouch.reproduction.run import reproduce, write_report
from foretouch.reproduction.section import Section, Table

__all__ = [
    "PAPER",
    "SECTIONS",
    "Claim",
    "Section",
    "Table",
    "Verdict",
    "counted",
    "make_section",
    "reproduce",
    "write_report",
]
