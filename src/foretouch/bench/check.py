"""Has it become slower? Ratios of ours to bare compiled loops in the same run, against a baseline that is committed.

Seconds depend on the machine, these ratios hardly. What noise adds to a time is never negative, so that the least of
many interleaved rounds is what is compared: a machine that is busy half of the time still has quiet rounds. A ratio
fails beyond its baseline times a band. The band leaves room for what differs between machines and versions of Python;
the purpose is that nothing becomes twice as slow unnoticed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import msgspec
import numpy as np

from foretouch.bench.benchmarks.steps import TapedSession
from foretouch.bench.benchmarks.updates import CALLED, bare, theta_of, update_all
from foretouch.bench.benchmarks.updates import map_contestant as map_over_recording
from foretouch.bench.peers import Problem, press, rank_one_updates, recursion_over, samples
from foretouch.bench.timing import Contestant, once
from foretouch.errors import RecordingError

BAND, SHORT_BAND = 1.6, 2.5
"""Largest ratio to the baseline, full and short form; the short form has few rounds."""

STALE = 0.8  # A ratio below this fraction of its baseline is so by more than noise: a later slowdown would go unnoticed

ROUNDS, SHORT_ROUNDS, TURNS, ATTEMPTS = 40, 4, 6, 3
"""Rounds, full and short form; runs in a round of all but the session; and attempts at a ratio that fails."""

CALLS, RECORDED, MATRICES = 2_000, 20_000, 100
"""Work of one turn: calls, samples of a recording, matrices."""

BARE = {
    "FPRLS over a recording": "bare recursion",
    "contact map over a recording": "bare matrix",
    "leader step": "bare call",
    "follower step": "bare call",
    "FPRLS update": "bare call",
    "exact update": "bare call",
    "contact map update": "bare matrix",
}
"""What each is held against: where a machine is shared, code that fills wide registers and caches suffers most, and is
compared with such code."""

Measured = dict[str, float]
"""Ratio by name."""


@dataclass(frozen=True, slots=True)
class Checked:
    """One ratio beside its baseline.

    Attributes:
        name: Name of the ratio.
        ratio: As measured now; None where the baseline names what is not measured any more.
        baseline: Stored ratio; None where it is new.
        band: Largest allowed multiple of the baseline.
    """

    name: str
    ratio: float | None
    baseline: float | None
    band: float

    @property
    def passed(self) -> bool:
        """Whether it is within the band of its baseline."""
        return self.ratio is not None and self.baseline is not None and self.ratio <= self.band * self.baseline

    @property
    def sentence(self) -> str:
        """What there is to say, in one line."""
        if self.ratio is None:
            return f"{self.name}: in the baseline, but not measured any more: write the baseline anew"
        if self.baseline is None:
            return f"{self.name}: {self.ratio:.3g}, and not in the baseline: write the baseline anew"
        verdict = f"{'within' if self.passed else 'BEYOND'} the band of {self.band:g}"
        if self.ratio < STALE * self.baseline:
            verdict = "below the baseline by more than the noise: write it anew"
        return (
            f"{self.name}: {self.ratio:.3g}, {self.ratio / self.baseline:.2f} times the baseline of "
            f"{self.baseline:.3g}: {verdict}"
        )


def measure_ratios(*, short: bool) -> Measured:
    """Ours over a bare compiled loop, each the least of interleaved rounds, in seconds (`short`) or a minute."""
    return _ratios(_least(short, {}))


def _ratios(least: Mapping[str, float]) -> Measured:
    return {name: seconds / least[BARE[name]] for name, seconds in least.items() if name in BARE}


def _least(short: bool, before: Mapping[str, float]) -> dict[str, float]:
    """The least time of a unit of work [s] of everything, of these rounds and of those before."""
    pressed = press(RECORDED)
    sampled, problem = samples(press(CALLS)), Problem.of(pressed)
    session = TapedSession(2.0)
    contestants = {
        "bare call": Contestant(bare(sampled), CALLS),
        "bare recursion": Contestant(lambda: recursion_over(problem), RECORDED),
        "bare matrix": Contestant(lambda: rank_one_updates(MATRICES), MATRICES),
        "FPRLS over a recording": Contestant(lambda: theta_of(pressed), RECORDED),
        "contact map over a recording": map_over_recording(CALLS, 10e-3),
    }
    for name, (make, _) in CALLED.items():
        estimator = make()
        contestants[f"{name} update"] = Contestant(update_all(estimator, sampled), CALLS, estimator.reset)
    least = dict(before)

    def keep(name: str, seconds: float) -> None:
        least[name] = min(seconds, least.get(name, seconds))

    for _ in range(SHORT_ROUNDS if short else ROUNDS):  # the first warms up; it is never the least
        times = session.times()
        touching = times.pop("contact") > 0.0
        for side, values in times.items():
            keep(f"{side} step", float(np.median(values[touching])))
        for _ in range(TURNS):
            for name, one in contestants.items():
                keep(name, once(one))
    return least


def compare(measured: Mapping[str, float], baseline: Mapping[str, float], band: float) -> list[Checked]:
    """Every ratio beside its baseline, for all names of either; up to `band` times the baseline is allowed."""
    names = dict.fromkeys((*measured, *baseline))
    return [Checked(name, measured.get(name), baseline.get(name), band) for name in names]


def check(baseline: Path | None = None, *, short: bool = False) -> list[Checked]:
    """Measure all ratios and hold them against a baseline.

    Where one is beyond its band, further rounds are added, twice: what really is slower stays slower. The baseline is
    a file, by default the committed one; the short form takes a few seconds and has a wider band. A RecordingError
    says that the baseline cannot be read.
    """
    kept = read_baseline(baseline)
    least: dict[str, float] = {}
    band = SHORT_BAND if short else BAND
    for _ in range(ATTEMPTS):
        least = _least(short, least)
        checked = compare(_ratios(least), kept, band)
        if all(one.passed for one in checked):
            break
    return checked


def read_baseline(path: Path | None = None) -> Measured:
    """Ratio by name from a file, the committed one by default; a RecordingError where it cannot be read."""
    try:
        content = (files("foretouch.bench") / "baseline.json").read_bytes() if path is None else path.read_bytes()
        return msgspec.json.decode(content, type=Measured)
    except (OSError, msgspec.DecodeError) as error:
        raise RecordingError(path or "the committed baseline", f"no baseline of ratios: {error}") from None


def try_to_write(path: Path) -> None:
    """See that a baseline can be kept there, before a minute is spent on it; else a RecordingError."""
    new = not path.exists()
    try:
        with path.open("ab"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise RecordingError(path, f"cannot be written: {error.strerror}") from None


def write_baseline(path: Path, measured: Mapping[str, float]) -> None:
    """Write ratios to three figures, over a file that is there; a RecordingError where it cannot be written."""
    rounded = {name: float(f"{ratio:.3g}") for name, ratio in measured.items()}
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(rounded), indent=2) + b"\n")
    except OSError as error:
        raise RecordingError(path, f"cannot be written: {error.strerror}") from None
