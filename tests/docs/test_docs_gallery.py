"""The gallery shows every figure that there is, each once."""

from __future__ import annotations

import re

from docs_pages import ROOT


def test_every_figure_is_in_the_gallery_once() -> None:
    shown = re.findall(r"^```\{figure\} images/(\S+)$", (ROOT / "docs" / "gallery.md").read_text(), re.MULTILINE)
    assert sorted(shown) == sorted(path.name for path in (ROOT / "docs" / "images").glob("*.png"))


def test_every_script_that_it_names_is_there() -> None:
    for script in re.findall(r"docs/\w+\.py", (ROOT / "docs" / "gallery.md").read_text()):
        assert (ROOT / script).exists(), script
