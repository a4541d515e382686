"""The gallery shows every figure that there is: each stands on a page, with a text that says what it shows."""

from __future__ import annotations

import sys

import pytest
from docs_pages import ROOT


def test_every_figure_stands_on_a_page_with_a_text() -> None:
    sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
    try:
        extension = pytest.importorskip("foretouch_docs", reason="Sphinx is not installed")
    finally:
        sys.path.pop(0)
    shown = extension.shown_figures(ROOT / "docs")
    assert sorted(shown) == sorted(path.name for path in (ROOT / "docs" / "images").glob("*.png"))
    assert [name for name, (_, text) in shown.items() if len(text.split()) < 3] == []
    assert ".. figures::" in (ROOT / "docs" / "gallery.md").read_text()
