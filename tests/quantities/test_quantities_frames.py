"""The frames by name: those that a user reads of are those that are written."""

from __future__ import annotations

from pathlib import Path

from foretouch.quantities import FRAMES, wrong_frame

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_has_every_frame_as_it_is() -> None:
    rows = [f"| `{name}` | {meaning} |" for name, meaning in FRAMES.items()]
    assert "\n".join(rows) in (DOCS / "arms.md").read_text()


def test_a_wrong_frame_is_said_with_what_both_are() -> None:
    said = wrong_frame("flange", "sensor")
    assert said.startswith("is in the frame flange (where the tool is mounted")
    assert said.endswith(f"has to be in sensor ({FRAMES['sensor']})")
