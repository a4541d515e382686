"""What a command's exit code says."""

from __future__ import annotations

__all__ = ["EXIT_CODES", "epilog"]

EXIT_CODES: dict[int, tuple[str, str]] = {
    0: ("done", "Done. `predict` on a recording that never touches is done too: null metrics and status `no_contact`"),
    1: (
        "done, and the answer is no",
        "Done, and the answer is no: `doctor` found something bad, `stop` stopped nothing, a benchmark became slower, "
        "a session of a sweep has objections, no comparison came off. Or a process of a session failed",
    ),
    2: (
        "bad input, or something is missing",
        "Bad input, or something is missing: one line that says what, where, which rule and what to do; no traceback",
    ),
    3: (
        "the recording is not all there",
        "The session went on to its end, but its recording is not all there, or not where it was asked for",
    ),
    130: (
        "interrupted by Ctrl-C",
        "Interrupted by Ctrl-C, with nothing left running. A session in real time ends so with code 0",
    ),
}
"""By code, in a few words for the help, and in a sentence for the documentation."""


def epilog() -> str:
    """One line on all of them, for the end of the help."""
    return "Exit codes: " + "; ".join(f"{code} {short}" for code, (short, _) in EXIT_CODES.items()) + "."
