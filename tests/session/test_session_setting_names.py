"""Names in settings are known before anything is made or compiled."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import foretouch.cli.commands.sessions
from foretouch.cli.app import app
from foretouch.errors import UnknownNameError
from foretouch.session import SessionSettings

NAMES = ("material", "operator", "model", "estimator", "grip", "scene", "robot", "baseline", "first_touch", "fusion")


@pytest.mark.parametrize("name", NAMES)
def test_an_unknown_name_is_refused_where_the_settings_are_made(name: str) -> None:
    with pytest.raises(UnknownNameError, match="'nobody'"):
        SessionSettings(**{name: "nobody"})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["material", "operator", "model", "scene"])
def test_an_unknown_name_is_told_before_anything_is_compiled_or_written(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(foretouch.cli.commands.sessions, "compile_first", lambda: pytest.fail("compiled"))
    done = CliRunner().invoke(app, ["simulate", f"--{name}", "nobody", "--report", str(tmp_path / "out")])
    assert isinstance(done.exception, UnknownNameError)
    assert not (tmp_path / "out").exists()
