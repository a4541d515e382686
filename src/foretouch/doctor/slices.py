"""The slice of time that the kernel lets a loop run at a stretch."""

from __future__ import annotations

import ctypes
import platform
import struct
import sys

__all__ = ["granted_slice_ns"]

GET_ATTRIBUTES = {"x86_64": 315, "aarch64": 275}
"""Number of the system call `sched_getattr`, for which the C library has no function."""

ATTRIBUTES = struct.Struct("<IIQiIQQQ")
"""Its answer: size, policy, flags, nice, priority, then runtime, deadline and period [ns]."""


def granted_slice_ns() -> int:
    """Slice of this thread as the kernel says [ns]; 0 where it does not, as before Linux 6.12 and elsewhere."""
    call = GET_ATTRIBUTES.get(platform.machine())
    if sys.platform != "linux" or call is None:
        return 0
    answer = ctypes.create_string_buffer(ATTRIBUTES.size)
    if ctypes.CDLL(None).syscall(call, 0, answer, ATTRIBUTES.size, 0) != 0:
        return 0
    return int(ATTRIBUTES.unpack(answer.raw)[5])
