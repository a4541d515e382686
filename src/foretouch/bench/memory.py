"""How much memory this process holds."""

from __future__ import annotations

from pathlib import Path

__all__ = ["resident_bytes"]

_STATM = Path("/proc/self/statm")


def resident_bytes() -> int:
    """Bytes of this process that are in memory now, in whole pages; 0 where the system does not say.

    All that it holds is in it, whoever asked for it: Python, NumPy, compiled code.
    """
    if not _STATM.exists():
        return 0
    import resource

    return int(_STATM.read_text().split()[1]) * resource.getpagesize()
