"""The paper, made again: its figures, its tables, and whether its claims hold."""

from foretouch.reproduction.claims import Claim, Verdict
from foretouch.reproduction.registry import SECTIONS, make_section
from foretouch.reproduction.run import reproduce, write_report
from foretouch.reproduction.section import Section, Table

__all__ = ["SECTIONS", "Claim", "Section", "Table", "Verdict", "make_section", "reproduce", "write_report"]
