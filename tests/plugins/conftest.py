"""What the tests of plug-ins share."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from plugin_packages import make_package

from foretouch.plugins import all_plugins


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Puts packages that are made for this test on this process's path, and takes them off again."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(name: str, points: Any, source: str = "", **more: Any) -> None:
        make_package(tmp_path, name, points, source, **more)
        importlib.invalidate_caches()
        all_plugins.cache_clear()

    yield put
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]
    all_plugins.cache_clear()
