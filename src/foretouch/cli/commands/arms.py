"""Commands about the simulated arms."""

from __future__ import annotations

from typing import Annotated

import typer

from foretouch.cli.options import Answer, command
from foretouch.cli.progress import progress_bar
from foretouch.errors import UnknownNameError

ALL = "all"

arms = typer.Typer(help="Simulated arms: meshes for their picture in the console.", no_args_is_help=True)


@arms.callback()
def _root() -> None:
    """Keep `meshes` a word of its own while it is the only command."""


@arms.command("meshes")
@command()
def meshes(name: Annotated[str, typer.Argument(help="fr3, ur5e, so101 or all.")]) -> Answer:
    """Make the meshes of a simulated arm available here, and print where they lie; the console draws it with them.

    They come from the folder that FORETOUCH_DATA_DIR names, from the cache, or from MuJoCo Menagerie at one commit. No
    checksum of them is known: they are read, and compared with the arm.

    Example: foretouch arms meshes fr3
    """
    from foretouch.robot import ARM_MESHES, fetch_arm_meshes

    if name not in (*ARM_MESHES, ALL):
        raise UnknownNameError("arm with meshes", name, (*ARM_MESHES, ALL))
    names = list(ARM_MESHES) if name == ALL else [name]
    content, lines = {}, []
    with progress_bar(f"fetching meshes of {name}") as bar:
        bar.pulse()
        for done, each in enumerate(names):
            bar.update(done, len(names), f"fetching meshes of {each}")
            path, licence = fetch_arm_meshes(each), ARM_MESHES[each].licence
            content[each] = {"file": str(path), "licence": licence}
            lines.append(f"{path}   {licence}")
    return Answer(content, lines)
