"""Commands that make what programs in other languages are built against."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foretouch.cli.options import Answer, command, say

export = typer.Typer(help="What programs in other languages are built against.", no_args_is_help=True)


@export.command("c")
@command()
def export_c(
    *,
    out: Annotated[Path, typer.Option(help="Folder for the package: a new one, or one of an earlier export.")],
    target: Annotated[
        str, typer.Option(help="Processor: x86_64, aarch64, armv7 or wasm32; without it, this machine's.")
    ] = "",
) -> Answer:
    """Write a package for C and C++: the safety layer as an object file, headers, and a CMake project.

    It is compiled anew from the functions that Python runs, in about half a minute. No compiler of C is needed for
    that, whatever the processor.

    Example: foretouch export c --out foretouch-c --target aarch64
    """
    from foretouch.export import require_place, target_named, write_package

    wanted = target_named(target)
    require_place(out)
    say(f"compiling for {wanted.name}")
    files = write_package(out, wanted)
    return Answer(
        {"folder": str(out), "target": wanted.name, "files": files}, [f"wrote {out} for {wanted.name}", *files]
    )
