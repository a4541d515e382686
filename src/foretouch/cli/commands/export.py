"""Commands that make what programs in other languages are built against."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Answer, command, say, session_settings

if TYPE_CHECKING:
    from foretouch.session import SessionSettings

export = typer.Typer(help="What programs in other languages are built against.", no_args_is_help=True)


@export.command("c")
@command(settings=session_settings())
def export_c(
    *,
    out: Annotated[Path, typer.Option(help="Folder for the package: a new one, or one of an earlier export.")],
    target: Annotated[
        str, typer.Option(help="Processor: x86_64, aarch64, armv7 or wasm32; without it, this machine's.")
    ] = "",
    settings: SessionSettings,
) -> Answer:
    """Write a package for C and C++: leader, follower and safety along a line as code, headers, and a CMake project.

    It is compiled anew from the functions that Python runs, in about a minute. No compiler of C is needed for that,
    whatever the processor. The settings of the leader and the follower are those in the package.

    Example: foretouch export c --out foretouch-c --target aarch64 --first-touch guarded
    """
    from foretouch.export import lowered, require_exportable, require_place, target_named, write_package

    wanted = target_named(target)
    require_exportable(settings)
    require_place(out)
    say(f"compiling for {wanted.name}")
    files = write_package(out, wanted, functools.partial(lowered, settings=settings))
    return Answer(
        {"folder": str(out), "target": wanted.name, "files": files}, [f"wrote {out} for {wanted.name}", *files]
    )


@export.command("page")
@command()
def export_page(
    *, out: Annotated[Path, typer.Option(help="Folder for the page: a new one, or one of an earlier export.")]
) -> Answer:
    """Write a page for a browser: a session with a simulated robot, and predictions of your own recordings.

    It is one file that runs without a server, from a disk or a web site; beside it lies an example of a recording. To
    make it takes about a minute, and needs clang, lld and the C library for WebAssembly.

    Example: foretouch export page --out demo
    """
    from foretouch.export import require_page_place, require_tools, write_page

    require_page_place(out)
    require_tools()
    say("compiling for browsers")
    files = write_page(out)
    return Answer({"folder": str(out), "files": files}, [f"wrote {out}: open {out / 'index.html'}", *files])
