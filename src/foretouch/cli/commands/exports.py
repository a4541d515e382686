"""Commands that make files for elsewhere: maps of what was touched, and what other languages are built against."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import Answer, command, require_writable, say, session_settings
from foretouch.errors import ForetouchError, InputError, plural

if TYPE_CHECKING:
    from foretouch.report import TouchedMap
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


maps = typer.Typer(help="Maps of the stiffness of what was touched in a scene.", no_args_is_help=True)

TOUCHED_HELP = "Recordings of different sessions with one specimen (.mcap), or maps of them (.ply)."


@maps.command("merge")
@command()
def merge_maps(
    touched: Annotated[list[Path], typer.Argument(help=TOUCHED_HELP)],
    out: Annotated[Path, typer.Option(help="PLY file for the map: a mesh with colours, and numbers at each vertex.")],
) -> Answer:
    """Merge what sessions in one scene have learnt into one map of its stiffness, a mesh that other programs open too.

    Places that several have touched get the mean of their logarithms, by how sure each is; of one session it is that
    session's map. A session that would count twice is refused. `--scene` takes the file as a shape.

    Example: foretouch map merge monday.mcap tuesday.mcap --out specimen.ply
    """
    from foretouch.recordings import atomic_path
    from foretouch.report import map_file, merged

    if out.suffix.lower() != ".ply":
        raise InputError(f"{out}: a map is a .ply file")
    require_writable(out.parent)
    _require_map(out)
    maps = [_opened(path) for path in touched]
    whole = merged(maps, [str(path) for path in touched])
    content = map_file(whole)
    with atomic_path(out) as part:
        part.write_bytes(content)
    apart = len(maps) > 1 and sum(len(each.points) for each in maps) == len(whole.points)
    alone = ["  in common  no place: nothing shows that they are of one specimen"] * apart
    return Answer({"file": str(out), **_figures(whole)}, [f"wrote {out}", *_lines(whole), *alone])


@maps.command("show")
@command()
def show_map(
    touched: Annotated[Path, typer.Argument(help="A recording of a session in a scene (.mcap), or a map (.ply).")],
) -> Answer:
    """What a map holds: how many places, where, how stiff, and how sure.

    Example: foretouch map show specimen.ply
    """
    whole = _opened(touched)
    return Answer(_figures(whole), _lines(whole))


def _require_map(out: Path) -> None:
    """Raise `InputError` where something else than a map would be written over."""
    from foretouch.report import read_map

    if not out.exists():
        return
    try:
        read_map(out)
    except InputError:
        raise InputError(f"{out}: is there and no map of touches: name another file, or remove it first") from None


def _opened(path: Path) -> TouchedMap:
    """A map from its own file, or from a session's recording.

    Raises:
        ForetouchError: It is neither; the line begins with the file's name.
    """
    from foretouch.recordings import is_session, read_session
    from foretouch.recordings.session.reader import NOTHING
    from foretouch.report import read_map, touched_map

    if path.suffix.lower() == ".ply":
        return read_map(path)
    if not path.is_file():
        raise InputError(f"{path}: {'this is no file' if path.exists() else 'no such file'}")
    if not path.stat().st_size:
        raise InputError(f"{path}: is empty: its recorder wrote nothing: give another session's recording")
    if not is_session(path):
        raise InputError(f"{path}: neither a session's recording (.mcap) nor a map (.ply)")
    try:
        return touched_map(read_session(path))
    except ForetouchError as error:
        text = str(error)
        if text.endswith(NOTHING):
            text += ": nothing in it can be read or repaired: give another session's recording"
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def _figures(whole: TouchedMap) -> dict[str, Any]:
    import numpy as np

    low, high = whole.points.min(axis=0), whole.points.max(axis=0)
    least, median, most = (float(value) for value in np.percentile(whole.stiffness, [0.0, 50.0, 100.0]))
    return {
        "sessions": len(whole.sessions),
        "unnamed_sessions": sum(not scene for scene in whole.sessions.values()),
        "scenes": sorted({scene for scene in whole.sessions.values() if scene}),
        "places": len(whole.points),
        "from_mm": (1e3 * low).tolist(),
        "to_mm": (1e3 * high).tolist(),
        "stiffness_N_per_m": {"least": least, "median": median, "largest": most},
        "stiffest_at_mm": (1e3 * whole.points[int(whole.stiffness.argmax())]).tolist(),
        "median_deviation_percent": 100.0 * float(np.median(whole.deviation)),
    }


def _lines(whole: TouchedMap) -> list[str]:
    figures = _figures(whole)
    stiffness, at = figures["stiffness_N_per_m"], figures["stiffest_at_mm"]
    (a, b, _), (c, d, _) = figures["from_mm"], figures["to_mm"]
    scenes = figures["scenes"]
    named = f", in {' and '.join(scenes)}" * bool(scenes)
    doubtful = ": only their heights were compared; merge them if they are one specimen" * (len(scenes) > 1)
    unnamed, alone = figures["unnamed_sessions"], figures["sessions"] == 1
    unsure = "; its file names none" if alone else f"; {unnamed} of a map that names none: see that none counts twice"
    return [
        f"  sessions   {figures['sessions']}{named}{doubtful}{unsure * bool(unnamed)}",
        f"  places     {plural(figures['places'], 'place')}, 3 mm apart; x {a:.0f} to {c:.0f}, y {b:.0f} to {d:.0f} mm",
        f"  stiffness  {stiffness['least']:,.0f} to {stiffness['largest']:,.0f} N/m, {stiffness['median']:,.0f} at the "
        f"median, 2 mm deep; stiffest at ({at[0]:.0f}, {at[1]:.0f}) mm",
        f"  uncertain  by {figures['median_deviation_percent']:.0f} % at the median (one standard deviation)",
    ]
