"""The paper, made again: its figures, its tables, and whether its claims hold."""

from foretouch.reproduction.run import PAPER, SECTIONS, counted, make_section, reproduce, write_report
from foretouch.reproduction.section import Claim, Section, Table, Verdict

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
