"""Formulas as MathML, written into the page: the site needs no network and no script to show them."""

from __future__ import annotations

import re

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

_SIZES = re.compile(r"\\[bB]igg?[lr]?(?![a-zA-Z])")  # the browser sizes brackets itself


def mathml(tex: str, block: bool) -> str:
    """One formula; lines end with two backslashes, and `&` aligns them."""
    tex = _SIZES.sub("", tex).strip()
    try:
        if not block or ("&" not in tex and "\\\\" not in tex):
            return latex2mathml.tex2mathml(tex, as_block=block)
        rows = [row for row in re.split(r"\\\\", tex) if row.strip()]
        cells = [[f"<mtd>{_bare(cell)}</mtd>" for cell in row.split("&")] for row in rows]
    except (MathError, AttributeError) as error:
        raise ExtensionError(f"formula {tex!r}: {error}") from error
    table = "".join(f"<mtr>{''.join(row)}</mtr>" for row in cells)
    return f'<math display="block"><mtable class="aligned" displaystyle="true">{table}</mtable></math>'


def _bare(tex: str) -> str:
    """A formula without the element around it."""
    return re.sub(r"^<math[^>]*>|</math>\s*$", "", latex2mathml.tex2mathml(tex.strip()))


def visit_inline(translator: object, node: nodes.math) -> None:
    """Write a formula in a line."""
    translator.body.append(mathml(node.astext(), block=False))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def visit_block(translator: object, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    translator.body.append(mathml(node.astext(), block=True))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make MathML a choice for `html_math_renderer`."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
