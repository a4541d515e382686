"""Commands about maps of what was touched in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import Answer, command, require_writable
from foretouch.errors import ForetouchError, InputError, plural

if TYPE_CHECKING:
    from foretouch.report import TouchedMap

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
