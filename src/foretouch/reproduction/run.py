"""Every section in the paper's order, all at once on all cores, into one page with its data beside it.

The page has a summary, the equations, and each section with its figure and its claims as cards.
"""

from __future__ import annotations

import base64
import importlib
import io
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from foretouch.comparison.parallel import run_all
from foretouch.errors import InputError, UnknownNameError
from foretouch.recordings import atomic_path, write_columns
from foretouch.report import embedded, write_html
from foretouch.reproduction.section import Claim, Section, Verdict

PAPER = (
    "A continuous switching contact model for virtual environment based teleoperation, Complex & Intelligent Systems "
    "(2021), doi:10.1007/s40747-021-00464-0"
)
"""Title, journal, year and DOI."""

LINK = "https://doi.org/10.1007/s40747-021-00464-0"

SHOWN: dict[Verdict, tuple[str, str, str]] = {
    "holds": ("holds", "✓", "holds as printed"),
    "holds under stated choice": ("choice", "◐", "holds under a choice"),
    "does not hold": ("not", "✗", "does not hold"),
}
"""Class in the style, sign and words of each verdict: sign and words repeat what colour shows."""

CENTRAL = {
    "fig4": "gamma lies in [2, 3]",
    "fig5": "Error of (18) against (15)",
    "fig7b": "Parameters follow the continuous change",
    "fig8": "Continuous switching changes without a jump",
    "fig11": "All three materials",
}
"""The five claims that the paper's summary stands on, each by its section and the words that it begins with: energy
loss, linearised law, identification, switching and predicted force."""

EQUATIONS = {
    1: r"F = K\,x + B\,\dot x,\ \ x \geq 0",
    2: r"F = k\,x^n + \lambda\,x^n\,\dot x,\ \ x \geq 0",
    4: r"F = k\,x^{n+\alpha} + \lambda\,x^n\,\dot x,\ \ x \geq 0",
    5: r"1 \leq n+\alpha < 2,\ \ 0 \leq \alpha \leq 1",
    9: r"\Delta E \approx A\,\int_0^{x_M} x^n \sqrt{x_M^{n+\alpha+1} - x^{n+\alpha+1}}\ dx",
    12: r"\Delta E = \frac{B}{3}\, y_M^{3-2\beta}\, F(\beta,\,1.5;\,2.5;\,1)",
    13: r"\Delta E = K_0\, v_i^{\gamma}",
    14: r"\gamma = 3 - 2\,\frac{\alpha}{n+\alpha+1}",
    15: r"\ln F = \ln k + n\,\ln x + \ln(x^\alpha + \varphi),\ \ \varphi = \frac{\lambda}{k}\,\dot x",
    16: r"\ln(x^\alpha + \varphi) \approx \alpha\,\ln x + \frac{\varphi}{x^\alpha}",
    17: r"\frac{1}{x^\alpha} \approx a_1 + a_2\,\frac{1}{x}",
    18: r"\ln F \approx \ln k + s\,\ln x + b_1\,\dot x + b_2\,\frac{\dot x}{x}",
    20: r"P_{k+1} = \frac{1}{\mu}(I - K_{k+1}\Phi_{k+1}^T)\,P_k + \delta\,N(\kappa\,\hat e_k^2)\,I",
}
"""Equations that claims and texts name, by the paper's number."""

OF_SECTION = {
    "fig2": (1,),
    "fig3": (2,),
    "shock": (4,),
    "fig4": (14,),
    "fig5": (15, 18),
    "table1": (17,),
    **dict.fromkeys(("fig7a", "fig7b", "fig7c", "fig8", "choices", "arguments", "fast", "fig10", "fig11"), (18, 20)),
}
"""Equations of claims that name none themselves."""

STYLE = """<style>
body { max-width: 76rem; } a { color: inherit; } h2 { margin: 1.2rem 0 .4rem; }
.bar { display: flex; height: 1.7rem; border-radius: .4rem; overflow: hidden; margin: .6rem 0; }
.bar span { color: #fff; text-align: center; font-size: .85rem; line-height: 1.7rem; white-space: nowrap; }
.bar .holds, .holds > summary b { background: #00614a; } .bar .choice, .choice > summary b { background: #8a5a00; }
.bar .not, .not > summary b { background: #a12d00; }
.equations { display: grid; grid-template-columns: repeat(auto-fill, minmax(16rem, 1fr)); gap: .3rem; }
.equations div { background: #fff; color: #444; border: 1px solid var(--line); border-radius: .4rem; display: flex;
  align-items: center; justify-content: space-between; padding: .15rem .6rem; font-size: .8rem; min-height: 2.1rem; }
.equations img { max-width: calc(100% - 2rem); }
.part { display: grid; grid-template-columns: 17rem 1fr; gap: 0 1rem; align-items: start; }
.part > div { min-width: 0; } .part .figure[open] { grid-column: 1 / -1; }
.figure summary { list-style: none; cursor: zoom-in; } .figure figure { margin: 0; padding: .2rem; }
.figure figcaption { display: none; } .figure[open] summary { cursor: zoom-out; }
.claim { background: var(--card); border: 1px solid var(--line); border-radius: .4rem; margin: 0 0 .25rem;
  font-size: .82rem; line-height: 1.35; }
.claim summary { display: flex; gap: .6rem; padding: .18rem .5rem; cursor: pointer; align-items: baseline; }
.claim summary b { color: #fff; border-radius: .3rem; padding: 0 .4rem; white-space: nowrap; font-weight: 600;
  font-size: .75rem; min-width: 8.6rem; box-sizing: border-box; }
.claim summary span { flex: 1; } .claim summary small { color: var(--quiet); white-space: nowrap; }
.claim dl { margin: .2rem .6rem .5rem; display: grid; grid-template-columns: 6rem 1fr; gap: .2rem .6rem; }
.claim dt { color: var(--quiet); } .claim dd { margin: 0; overflow-wrap: anywhere; }
.done { font-size: .82rem; margin: 0 0 .4rem; }
@media (max-width: 45rem) { .part { grid-template-columns: 1fr; } .claim summary { flex-wrap: wrap; }
  .claim summary span { flex-basis: 100%; order: 2; } .claim summary small { order: 3; } }
</style>"""


def counted(claims: Sequence[Claim]) -> dict[Verdict, int]:
    """Number of claims with each verdict, in the order in which verdicts are shown."""
    result = Counter(claim.verdict for claim in claims)
    return {verdict: result[verdict] for verdict in SHOWN}


def named_equations(section: Section, claim: Claim) -> tuple[int, ...]:
    """Numbers of the equations that a claim names, else those of its section."""
    return tuple(sorted(_named(claim.claim, claim.paper))) or OF_SECTION.get(section.name, ())


def _named(*texts: str) -> set[int]:
    return {int(number) for number in re.findall(r"\((\d{1,2})\)", " ".join(texts))} & EQUATIONS.keys()


def _summary(sections: Sequence[Section]) -> list[str]:
    claims = [claim for section in sections for claim in section.claims]
    if not claims:
        return []
    counts = counted(claims)
    bar = "".join(
        f'<span class="{SHOWN[verdict][0]}" style="flex: {count}">{SHOWN[verdict][1]} {count} {words}</span>'
        for (verdict, count), words in zip(counts.items(), ("hold", "hold under a choice", "do not hold"), strict=True)
        if count
    )
    text = (
        f"Of {len(claims)} claims {counts['holds']} hold as printed, {counts['holds under stated choice']} under a "
        f"choice that the paper leaves open and that is stated, and {counts['does not hold']} with none that was tried."
    )
    most = [
        (section, claim)
        for section in sections
        for claim in section.claims
        if section.name in CENTRAL and claim.claim.startswith(CENTRAL[section.name])
    ]
    return [
        f"<p>{text} A click on a claim shows what the paper says, what was measured and how; one on a figure enlarges "
        f'it.</p><div class="bar">{bar}</div>',
        *(["<h2>The claims that matter most</h2>"] if most else []),
        *(_card(section, claim, f'<a href="#{section.name}">{_short(section)}</a>') for section, claim in most),
    ]


def _equations(sections: Sequence[Section]) -> list[str]:
    numbers = set().union(
        *(_named(one.title, one.text) for one in sections),
        *(
            _named(*claim.as_row().values()) | {*named_equations(one, claim)}
            for one in sections
            for claim in one.claims
        ),
    )
    if not numbers:
        return []
    shown = (
        f'<div id="equation-{number}"><img alt="{escape(EQUATIONS[number])}" '
        f'src="data:image/svg+xml;base64,{_drawn(EQUATIONS[number])}"><span>({number})</span></div>'
        for number in sorted(numbers)
    )
    return ["<h2>Equations that are named</h2>", f'<div class="equations">{"".join(shown)}</div>']


def _drawn(formula: str) -> str:
    from matplotlib.mathtext import math_to_image

    buffer = io.BytesIO()
    math_to_image(f"${formula}$", buffer, format="svg", dpi=80)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _part(section: Section) -> list[str]:
    cards, figure = "", ""
    for claim in section.claims:
        equations = (f' <a href="#equation-{number}">({number})</a>' for number in named_equations(section, claim))
        cards += _card(section, claim, f'<a href="#{section.name}">{_short(section)}</a>{"".join(equations)}')
    if section.figure is not None:
        figure = f'<details class="figure"><summary>{embedded(section.figure, section.title)}</summary></details>'
    text = f"<summary>What was done and what is seen</summary><p>{escape(section.text)}</p>"
    return [
        f'<h2 id="{section.name}">{escape(section.title)}</h2>',
        f'<div class="part">{figure}<div><details class="done">{text}</details>{cards}</div></div>',
    ]


def _card(section: Section, claim: Claim, links: str) -> str:
    name, sign, words = SHOWN[claim.verdict]
    rows = (("the paper", claim.paper), ("measured", claim.measured), ("setting", claim.setting))
    details = "".join(f"<dt>{title}</dt><dd>{escape(text)}</dd>" for title, text in rows)
    return (
        f'<details class="claim {name}"><summary><b>{sign} {words}</b><span>{escape(claim.claim)}</span>'
        f"<small>{links}</small></summary><dl>{details}</dl></details>"
    )


def _short(section: Section) -> str:
    """Figure or table of the paper that a section is of, else "figure"."""
    head = section.title.partition(":")[0]
    return escape(head) if head.startswith(("Fig.", "Table")) else "figure"


SECTIONS: dict[str, str] = {
    "fig2": "figures.impacts:make_fig2",
    "fig3": "figures.impacts:make_fig3",
    "shock": "questions.shock",
    "fig4": "figures.fig4",
    "fig5": "figures.fig5",
    "table1": "figures.table1",
    "fig6": "figures.simulations:make_fig6",
    "fig7a": "figures.simulations:make_fig7a",
    "fig7b": "figures.simulations:make_fig7b",
    "fig7c": "figures.simulations:make_fig7c",
    "fig8": "figures.fig8",
    "choices": "questions.choices",
    "arguments": "questions.arguments",
    "fast": "questions.fast",
    "fig10": "figures.fig10",
    "fig11": "figures.fig11",
}
"""Name of each section, and the module of this room whose ``make()``, or what stands behind the colon, makes it."""


def make_section(name: str) -> Section:
    """Make one section, which may take a minute; an UnknownNameError where there is none of that name."""
    if name not in SECTIONS:
        raise UnknownNameError("section", name, SECTIONS)
    module, _, maker = SECTIONS[name].partition(":")
    section: Section = getattr(importlib.import_module(f"foretouch.reproduction.{module}"), maker or "make")()
    return section


SLOWEST = "fig11"
"""Half of all the work: begun first, while the other cores make the rest, so that something is done all the time."""


def reproduce(names: Sequence[str], *, progress: Callable[[str, float], None] | None = None) -> list[Section]:
    """Make sections, by their names, side by side on the cores of this machine; they come back in the paper's order.

    `progress` is called with the name of each section that is done and the time since the start [s]. Where there is no
    such section, that is an UnknownNameError.
    """
    started = time.perf_counter()
    made: dict[str, Section] = {}

    def lost(name: str, reason: str) -> Section:
        raise RuntimeError(f"section {name}: {reason}")

    ordered = sorted(names, key=lambda name: name != SLOWEST)
    for _, section in run_all(make_section, ordered, lost=lost):
        made[section.name] = section
        if progress is not None:
            progress(section.name, time.perf_counter() - started)
    return [made[name] for name in SECTIONS if name in made]


def write_report(
    directory: Path,
    sections: Sequence[Section],
    made: Mapping[str, Any] | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write the page, at first a summary, all else folded to a line each, and figures (SVG, PNG) and data (Parquet).

    The directory is made if it is not there; `made` is as of `foretouch.report.write_html`, and `progress` is called
    with the name of each section before it is written. Returns the path of the page.

    Raises:
        InputError: Something cannot be written there.
        MissingExtraError: A package of the extras ``report`` or ``recordings`` is not installed.
    """
    body = [
        STYLE,
        "<h1>The paper, reproduced</h1>",
        f'<p class="quiet">{escape(PAPER.partition(", doi:")[0])}, <a href="{LINK}">doi:{LINK[16:]}</a></p>',
        *_summary(sections),
        *_equations(sections),
        *(part for section in sections for part in _part(section)),
    ]
    page = write_html(directory, "The paper, reproduced", body, made)
    try:
        for section in sections:
            if progress is not None:
                progress(section.name)
            _write_files(directory, section)
    except OSError as error:
        raise InputError(f"{directory}: the data cannot be written there: {error.strerror}") from None
    return page


def _write_files(directory: Path, section: Section) -> None:
    for suffix, metadata in (("svg", {"Date": None}), ("png", None)) if section.figure is not None else ():
        with atomic_path(directory / f"{section.name}.{suffix}") as part:
            section.figure.savefig(part, format=suffix, dpi=150, metadata=metadata)
    for name, columns in section.data.items():
        write_columns(directory / f"{section.name}-{name}.parquet", dict(columns))
