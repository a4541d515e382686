"""Packages with entry points that are made for a test: a folder that is put on the path."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "foretouch-plugin-example"
"""The package that others begin theirs with."""
GROUPS = {one: f"foretouch.{one}s" for one in ("robot", "device", "material", "estimator")}


def make_package(
    folder: Path, name: str, points: Mapping[str, Mapping[str, str]], source: str = "", version: str = "1.2"
) -> Path:
    """An installed package, as its files lie in a folder of the path.

    Args:
        folder: Where installed packages lie.
        name: Of the package; its module has the same with ``_``.
        points: By kind, the name of each entry point and its target.
        source: Of the module.
        version: Of the package.
    """
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    text = "".join(
        f"[{GROUPS[kind]}]\n" + "".join(f"{point} = {target}\n" for point, target in named.items())
        for kind, named in points.items()
    )
    (info / "entry_points.txt").write_text(text)
    (folder / f"{name.replace('-', '_')}.py").write_text(source)
    return folder
