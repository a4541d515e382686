"""What to type is what pip takes: by name from an index, or by the folder that the package was installed from."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
from pathlib import Path

import pytest

from foretouch.errors import MissingExtraError, install_command


def installed(folder: Path, stated: dict[str, object] | None) -> importlib.metadata.Distribution:
    info = folder / "foretouch-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foretouch\nVersion: 0.1.0\n")
    if stated is not None:
        (info / "direct_url.json").write_text(json.dumps(stated))
    return importlib.metadata.PathDistribution(info)


@pytest.mark.parametrize(
    ("stated", "command"),
    [
        (None, ["pip", "install", "foretouch[sim]"]),
        ({"url": "file:///a%20b/foretouch", "dir_info": {}}, ["pip", "install", "/a b/foretouch[sim]"]),
        (
            {"url": "file:///home/me/foretouch", "dir_info": {"editable": True}},
            ["pip", "install", "--editable", "/home/me/foretouch[sim]"],
        ),
        ({"url": "file:///tmp/foretouch-0.1.0.whl", "archive_info": {}}, ["pip", "install", "foretouch[sim]"]),
        ({"url": "https://example.org/foretouch.git", "vcs_info": {}}, ["pip", "install", "foretouch[sim]"]),
    ],
)
def test_what_was_installed_from_a_folder_is_asked_of_that_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stated: dict[str, object] | None, command: list[str]
) -> None:
    result = installed(tmp_path, stated)
    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: result)
    assert shlex.split(install_command("sim")) == command
    assert str(MissingExtraError("mujoco", "sim")).endswith(install_command("sim"))
    assert "--force-reinstall" in install_command(again=True)
    assert "[" not in install_command(again=True)


def test_here_it_names_what_is_installed_here() -> None:
    *_, wanted = shlex.split(install_command("sim", "link"))
    assert wanted.endswith("[sim,link]")
    place = Path(wanted.removesuffix("[sim,link]"))
    assert place == Path("foretouch") or (place / "pyproject.toml").exists()
