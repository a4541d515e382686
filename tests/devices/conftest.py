"""What the tests of devices share."""

from __future__ import annotations

import importlib.metadata
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from foretouch.plugins import all_plugins

GROUP = "foretouch.devices"
PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of the path; with the project's entry points, where the installed metadata is older than they are."""
    folder = tmp_path / "site"
    folder.mkdir()
    own = tomllib.loads(PROJECT.read_text())["project"]["entry-points"][GROUP]
    missing = set(own) - {point.name for point in importlib.metadata.entry_points(group=GROUP)}
    if missing:
        info = folder / "foretouch_own-0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foretouch-own\nVersion: 0\n")
        lines = [f"[{GROUP}]", *(f"{name} = {own[name]}" for name in sorted(missing))]
        (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
        monkeypatch.syspath_prepend(str(folder))
    all_plugins.cache_clear()
    yield folder
    all_plugins.cache_clear()
