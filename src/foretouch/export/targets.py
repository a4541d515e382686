"""The processors that code is emitted for."""

from __future__ import annotations

import platform
from dataclasses import dataclass

from foretouch.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class Target:
    """A processor and its calling convention.

    Attributes:
        name: For a user to choose.
        triple: What LLVM calls it; ``-linux-gnu`` also fits a system without an operating system of that convention.
        processor: The least of its kind that the code runs on; "" for the family's common ground.
        features: Of the processor, as LLVM names them.
        compilers: Names of C compilers for it on a machine of another kind, the usual one first.
        simulates: Whether robots and hands are simulated there: what does that is in its code, too.
    """

    name: str
    triple: str
    processor: str = ""
    features: str = ""
    compilers: tuple[str, ...] = ()
    simulates: bool = False


TARGETS = {
    target.name: target
    for target in (
        Target("x86_64", "x86_64-unknown-linux-gnu", "x86-64", compilers=("x86_64-linux-gnu-gcc",)),
        Target("aarch64", "aarch64-unknown-linux-gnu", "generic", compilers=("aarch64-linux-gnu-gcc",)),
        # With single precision alone, a double would be computed by calls of the compiler's own library.
        Target("armv7", "armv7-unknown-linux-gnueabihf", "generic", "+vfp3d16", ("arm-linux-gnueabihf-gcc",)),
        Target("wasm32", "wasm32-unknown-unknown", "generic", simulates=True),
    )
}
"""By name."""


def target_named(name: str) -> Target:
    """The target of a name, or of this machine where it is "".

    Raises:
        UnknownNameError: There is none of that name.
    """
    wanted = name or platform.machine()
    if wanted not in TARGETS:
        raise UnknownNameError("target", wanted, TARGETS)
    return TARGETS[wanted]
