"""Reads and finds files that others made: within a budget of memory and time, and in a process that may fail.

`within_budget` runs any reader so; `read_toml` reads the small files of settings; `origins` finds what others
published, and fetches it once. `children` runs processes of our own, of which none is left behind.
"""

from foretouch.files.budget import VARIABLE, Budget, budget_for
from foretouch.files.toml import LARGEST_TOML, decode_toml, read_toml
from foretouch.files.within import within_budget

__all__ = ["LARGEST_TOML", "VARIABLE", "Budget", "budget_for", "decode_toml", "read_toml", "within_budget"]
