"""Write the results of a sweep into `docs/sweep.md`, and draw its plots again.

Usage: `.venv/bin/python docs/draw_sweep.py [FOLDER]`, after `make sweep`; without a folder `out/sweep`. The table goes
into the block `totals`, the images to `docs/images`. Of a sweep that other code has run the page says so. Of a sweep
with a budget the table goes into the block `sweep` of `docs/thin-links.md`, and there are no plots.
"""

from __future__ import annotations

import sys
from pathlib import Path

from measured_blocks import fill

from foretouch.sweep import page as figures
from foretouch.sweep import summary
from foretouch.sweep.curves import AXES, TOTALS, crossover_sentences, figure_text
from foretouch.sweep.sweep import FILE_NAME, code_digest, read_store

PAGE, THIN_PAGE = (Path(__file__).parent / name for name in ("sweep.md", "thin-links.md"))
IMAGES = Path(__file__).parent / "images"
HEADS = {
    "ours": "models",
    "compared": "models, where compared",
    "delayed": "delayed force",
    "delayed-tdpa": "delayed force, passivity controller",
}
LEFT_OUT = (
    *("median_phantom_N", "simulated_s", "elapsed_s"),
    *("guarded_contacts", "median_depth_lost_mm", "median_time_lost_s"),
)
"""Totals that the command prints and the page does not need."""


def main(folder: Path) -> None:
    """Write the table and draw the plots."""
    header, store = read_store(folder / FILE_NAME)
    rows = list(store.values())
    content = summary(rows)
    columns = [name for name in HEADS if name in content]
    lines = [f"| | {' | '.join(HEADS[name] for name in columns)} |", f"| --- |{' --: |' * len(columns)}"]
    for figure, (unit, words) in TOTALS.items():
        if figure in LEFT_OUT:
            continue
        lines.append(f"| {words} | {' | '.join(figure_text(content[name][figure], unit) for name in columns)} |")
    sentences = crossover_sentences(content.get("crossovers", ()))
    sentences += [f"Session {one['number']}: {one['objection']}: `{one['command']}`" for one in content["objections"]]
    compared = content.get("compared", {"sessions": 0})["sessions"]
    ran = f"--sessions {content['ours']['sessions']} --baselines {compared} --duration {header.duration_s:g}"
    ran += f" --budget {header.budget:g}" if header.budget else ""
    intro = f"`foretouch sweep {ran} --seed {header.seed}`, foretouch {header.version}:"
    block = "\n".join([intro, "", *lines, "", *(f"- {sentence}" for sentence in sentences)]).rstrip() + "\n"
    current = header.code == code_digest()
    if header.budget:
        fill(THIN_PAGE, {"sweep": block}, current=current)
        return
    fill(PAGE, {"totals": block}, current=current)
    names = ("round-trip", "model-rate", "model-age")
    drawn = {f"sweep-{name}": figures.error_figure(rows, axis) for name, axis in zip(names, AXES, strict=True)}
    drawn["sweep-stability"] = figures.condition_figure(rows)
    for name, figure in drawn.items():
        figure.savefig(IMAGES / f"{name}.png", dpi=90)
        print(f"docs/images/{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/sweep"))
