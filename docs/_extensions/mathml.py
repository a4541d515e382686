"""Formulas as MathML, written into the page: the site needs no network and no script to show them."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_SIZES = re.compile(r"\\[bB]igg?[lr]?(?![a-zA-Z])")  # the browser sizes brackets itself


def mathml(tex: str, block: bool) -> str:
    """One formula; lines end with two backslashes, and `&` aligns them."""
    tex = _SIZES.sub("", tex).strip()
    try:
        rows = [_split(row, "&") for row in _split(tex, "\\\\") if row.strip()]
        if not block or max(map(len, rows), default=1) * len(rows) <= 1:
            return latex2mathml.tex2mathml(tex, as_block=block)
        cells = [[f"<mtd>{_bare(cell)}</mtd>" for cell in row] for row in rows]
    except (MathError, AttributeError) as error:
        raise ValueError(f"formula {tex!r} cannot be read: {error}") from error
    table = "".join(f"<mtr>{''.join(row)}</mtr>" for row in cells)
    return f'<math display="block"><mtable class="aligned" displaystyle="true">{table}</mtable></math>'


def _split(tex: str, mark: str) -> list[str]:
    """Split at a mark, but not inside an environment, which has rows and cells of its own."""
    pieces, depth = [""], 0
    for token in re.split(r"(\\begin\{|\\end\{|\\\\|&)", tex):
        depth += (token == "\\begin{") - (token == "\\end{")
        if token == mark and depth == 0:
            pieces.append("")
        else:
            pieces[-1] += token
    return pieces


def _bare(tex: str) -> str:
    """A formula without the element around it."""
    return re.sub(r"^<math[^>]*>|</math>\s*$", "", latex2mathml.tex2mathml(tex.strip()))


def _visit(translator: Any, node: nodes.Node, block: bool) -> None:
    try:
        translator.body.append(mathml(node.astext(), block))
    except ValueError as error:
        logging.getLogger(__name__).warning(str(error), location=node)
    raise nodes.SkipNode


def visit_inline(translator: Any, node: nodes.math) -> None:
    """Write a formula in a line."""
    _visit(translator, node, block=False)


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    _visit(translator, node, block=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Make MathML a choice for `html_math_renderer`."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
