"""What other programs are built against: messages in C, and kernels compiled from the functions that Python runs.

The guide is `docs/export.md`, and the wire format `docs/wire.md`. `write_package` writes the folder, `lowered` makes
the code in it, and `wire_sources` the messages.
"""

from foretouch.export.demo import require_page_place, require_tools, write_page
from foretouch.export.lowering import Function, Lowered, lowered, require_exportable
from foretouch.export.package import require_place, write_package
from foretouch.export.targets import TARGETS, Target, target_named
from foretouch.export.wire import sources as wire_sources

__all__ = [
    "TARGETS",
    "Function",
    "Lowered",
    "Target",
    "lowered",
    "require_exportable",
    "require_page_place",
    "require_place",
    "require_tools",
    "target_named",
    "wire_sources",
    "write_package",
    "write_page",
]
