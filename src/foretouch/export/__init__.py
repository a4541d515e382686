"""What other programs are built against: kernels in C, compiled from the functions that Python runs.

The guide is `docs/export.md`. `write_package` writes the folder; `lowered` makes the code in it.
"""

from foretouch.export.lowering import Function, Lowered, lowered
from foretouch.export.package import require_place, write_package
from foretouch.export.targets import TARGETS, Target, target_named

__all__ = ["TARGETS", "Function", "Lowered", "Target", "lowered", "require_place", "target_named", "write_package"]
