"""Formulas of docstrings become MathML, rows and environments included."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable

import pytest
from docs_pages import ROOT

pytest.importorskip("sphinx")


@pytest.fixture(scope="module")
def mathml() -> Callable[..., str]:
    spec = importlib.util.spec_from_file_location("mathml", ROOT / "docs" / "_extensions" / "mathml.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    function: Callable[..., str] = module.mathml
    return function


def parsed(text: str) -> tuple[ElementTree.Element, list[str]]:
    tree = ElementTree.fromstring(text)
    return tree, [element.tag.split("}")[-1] for element in tree.iter()]


@pytest.mark.parametrize(
    ("tex", "rows", "cells"),
    [
        (r"F = \max(0,\; k x^n + \lambda x^n \dot x)", 0, 0),
        (r"a &= \frac{1}{2} \\ b &= \hat\theta", 2, 4),
        (r"e = \Big(\frac{a}{b}\Big)", 0, 0),
        (r"S = \begin{cases} a & x \ge 1 \\ b & \text{else} \end{cases}", 2, 4),
        (r"S &= \begin{cases} a & x \ge 1 \\ b & \text{else} \end{cases} \\ T &= 1", 4, 8),
    ],
)
def test_rows_and_cells_are_kept(mathml: Callable[..., str], tex: str, rows: int, cells: int) -> None:
    tree, tags = parsed(mathml(tex, block=True))
    assert tree.attrib["display"] == "block"
    assert (tags.count("mtr"), tags.count("mtd")) == (rows, cells)


def test_a_formula_in_a_line_is_no_block(mathml: Callable[..., str]) -> None:
    tree, _ = parsed(mathml(r"\mu \in (0, 1]", block=False))
    assert "display" not in tree.attrib


def test_a_formula_that_cannot_be_read_is_an_error(mathml: Callable[..., str]) -> None:
    with pytest.raises(ValueError, match=r"formula .* cannot be read"):
        mathml(r"\nosuchcommand x", block=True)
