"""Commands about measured files and materials."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from foretouch.cli.options import Json, print_json, require_writable, say, show
from foretouch.cli.progress import progress_bar, pulsing

__all__ = ["datasets", "materials"]

datasets = typer.Typer(help="Measured recordings: what is here, and fetching the originals.", no_args_is_help=True)
materials = typer.Typer(help="What the simulated follower can press.", no_args_is_help=True)


@datasets.command("list")
def list_datasets(json_output: Json = False) -> None:
    """The measured recordings, and whose they are; time, position and force of all of them are here.

    Example: foretouch datasets list
    """
    from foretouch import recordings

    entries = recordings.list_datasets()
    if json_output:
        print_json(
            {
                entry.name: {
                    "kind": entry.kind,
                    "licence": entry.origin.licence,
                    "url": entry.url,
                    "excerpt": str(recordings.excerpt(entry.name)),
                    "seen": entry.seen,
                }
                for entry in entries
            }
        )
        return
    for entry in entries:
        show(f"{entry.name:<20} {entry.kind:<8} {entry.file:<34} {entry.origin.licence}")


@datasets.command("fetch")
def fetch_dataset(
    name: Annotated[str, typer.Argument(help="A name from `foretouch datasets list`, or all.")],
    json_output: Json = False,
) -> None:
    """Make the originals of measured recordings available here, with all that they hold, and print where they lie.

    They come from the folder that FORETOUCH_DATA_DIR names, from the cache, or from their public origin.

    Example: foretouch datasets fetch tue/b-foam
    """
    from foretouch import recordings

    names = [entry.name for entry in recordings.list_datasets()] if name == "all" else [name]
    paths: dict[str, str] = {}
    with progress_bar(f"fetching {name}") as bar:
        bar.pulse()
        for done, each in enumerate(names):
            bar.update(done, len(names), f"fetching {each}")
            paths[each] = str(recordings.fetch(each))
    if json_output:
        print_json({"files": paths})
        return
    for path in paths.values():
        show(str(path))


@materials.command("list")
def list_materials(json_output: Json = False) -> None:
    """The materials, and where their numbers come from.

    Example: foretouch materials list
    """
    from foretouch.plugins import PluginError, plugin_names
    from foretouch.robot import MATERIALS, make_material

    entries = {name: make_material(name) for name in MATERIALS}
    for name in plugin_names("material"):
        try:
            entries.setdefault(name, make_material(name))
        except PluginError as error:
            say(f"left out: {error}")
    if json_output:
        print_json(
            {
                name: {
                    "description": entry.description,
                    "provenance": entry.provenance,
                    "press_depth_m": entry.press_depth,
                }
                for name, entry in entries.items()
            }
        )
        return
    for name, entry in entries.items():
        show(f"{name:<16} to {1e3 * entry.press_depth:.1f} mm   {entry.description}")


@materials.command("fit")
def fit_material(
    name: Annotated[str, typer.Argument(help="foam-measured: the material that comes from measured files.")],
    out: Annotated[Path | None, typer.Option(help="JSON file for the coefficients.")] = None,
    json_output: Json = False,
) -> None:
    """Fit a measured material again from its recordings, and print how well the law describes each.

    Example: foretouch materials fit foam-measured --out foam.json
    """
    from foretouch.errors import UnknownNameError
    from foretouch.recordings import atomic_path, excerpt, read_recording
    from foretouch.robot import FOAM_DATASETS, fit_foam, foam_fit_json

    if name != "foam-measured":
        raise UnknownNameError("fitted material", name, ["foam-measured"])
    pressed = [replace(read_recording(excerpt(dataset)), name=dataset) for dataset in FOAM_DATASETS]
    fit = pulsing("fitting", fit_foam, pressed)
    if out is not None:
        require_writable(out.parent)
        with atomic_path(out) as part:
            part.write_bytes(foam_fit_json(fit))
    if json_output:
        print_json({file.name: {"residual_percent": file.residual_percent} for file in fit.files})
        return
    for file in fit.files:
        show(f"{file.name:<16} residual {file.residual_percent:5.1f} % of the contact-force RMS")
