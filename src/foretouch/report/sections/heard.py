"""What the leader had heard of the follower: how old the model was, how long nothing came, and a thin link's bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import Array, Rows, new_figure
from foretouch.report.drawing import ERROR, PREDICTED, curve, finished, legend, shade
from foretouch.report.numbers import Finding, figure, number, number_of, runs
from foretouch.report.sections import Drawing, Section, View

STALL = 0.1  # Time without news of the follower from which on it is a stall [s]
OLD = 1.0  # Age of a model, in contact, from which on a reader is told [s]


def ages(log: SessionLog) -> tuple[Array, Array]:
    """By leader tick, how much older the rendered model is than the newest telemetry, and how old that is [s].

    The first is between two times of the follower's clock, the second between two of the leader's: the time since newer
    telemetry came. NaN where there is no model, or no telemetry.
    """
    leader, follower = log.leader, log.follower
    made = dict(zip((model.sequence for model in log.models), (model.time_ns for model in log.models), strict=True))
    numbers, where = np.unique(leader["model_sequence"], return_inverse=True)
    model_ns = np.array([made.get(int(one), -1) for one in numbers], dtype=np.int64)[where]
    at = np.searchsorted(follower["sequence"], leader["telemetry_sequence"])
    known = (at < follower.size) & (leader["telemetry_sequence"] > 0)
    heard_ns = follower["time_ns"][np.minimum(at, max(follower.size - 1, 0))] if follower.size else np.zeros(at.size)
    age = np.where(known & (model_ns >= 0), (heard_ns - model_ns) * 1e-9, np.nan)
    return np.maximum(age, 0.0), np.where(known, _since_news(leader), np.nan)


def _since_news(leader: Rows) -> Array:
    """Time since newer telemetry came, by leader tick [s]."""
    newest = np.maximum.accumulate(leader["telemetry_sequence"])
    came = np.flatnonzero(np.diff(newest, prepend=-1))
    last = came[np.searchsorted(came, np.arange(leader.size), side="right") - 1]
    since: NDArray[np.float64] = (leader["time_ns"] - leader["time_ns"][last]) * 1e-9
    return since


def heard_figures(log: SessionLog, seconds: float) -> dict[str, Any]:
    """Ages of models, stalls, and bytes of a thin link, of a session of this length [s].

    Returns:
        ``model_age_s``: median, 99 % and largest age of the rendered model beyond that of the newest telemetry.
        ``stalls``: how often nothing came for `STALL`. ``longest_stall_s``: the longest of them. ``budget``: bytes a
        second that each side may send, 0 where messages are sent as they are; by side ``bytes_per_s`` and
        ``packets_per_s``, None without one.
    """
    if not (log.leader.size and log.follower.size):
        age, since = np.empty(0), np.empty(0)
    else:
        age, since = ages(log)
    age = age[np.isfinite(age)]
    still = [float(since[begin:end].max()) for begin, end in runs(np.nan_to_num(since) >= STALL)]
    quantiles = np.percentile(age, (50.0, 99.0, 100.0)).tolist() if age.size else (None, None, None)
    return {
        "model_age_s": dict(zip(("p50", "p99", "max"), quantiles, strict=True)),
        "stalls": len(still),
        "longest_stall_s": max(still, default=0.0),
        "budget": number_of(log.settings, "budget", 0.0),
        "leader": _sent(log, "leader", seconds),
        "follower": _sent(log, "follower", seconds),
    }


def _sent(log: SessionLog, side: str, seconds: float) -> dict[str, float | None]:
    counts = {kind: log.counts.get(f"{side}_thin_{kind}") for kind in ("bytes", "packets")}
    return {
        f"{kind}_per_s": None if count is None or not seconds > 0.0 else count / seconds
        for kind, count in counts.items()
    }


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    heard = report["heard"]
    age = heard["model_age_s"]
    if age["p50"] is None:
        return
    yield "What was heard of the follower"
    older = f"median {number(age['p50'], 's')}, 99 % {number(age['p99'], 's')}, at most {number(age['max'], 's')}"
    yield f"  model      older than the newest news by {older}"
    longest = f", the longest {number(heard['longest_stall_s'], 's')}" if heard["stalls"] else ""
    yield f"  stalls     {heard['stalls']} of {STALL:g} s and more without news{longest}"
    if heard["budget"]:
        for side, way in (("leader", "there"), ("follower", "back")):
            rates = heard[side]
            if rates["bytes_per_s"] is not None:
                sent = f"{figure(rates['bytes_per_s'])} of {heard['budget']:,.0f} bytes/s"
                yield f"  {way:<10} {sent}, in {figure(rates['packets_per_s'])} packets a second"
    yield ""


def _stalled(report: Mapping[str, Any]) -> Iterator[Finding]:
    heard = report["heard"]
    if heard["stalls"]:
        longest = number(heard["longest_stall_s"], "s")
        yield Finding(f"Nothing was heard of the follower {heard['stalls']} times, at most for {longest}.")
    age = heard["model_age_s"]["p99"]
    if age is not None and age > OLD and not heard["budget"]:
        yield Finding(f"In 1 % of the time the model was more than {number(age, 's')} older than the newest news.")


def _drawings(view: View) -> Iterator[Drawing]:
    heard = view.report["heard"]
    if heard["stalls"] or heard["budget"]:
        yield Drawing(age_figure(view.log), "Age of the model that the hand felt, and times without news")


def age_figure(log: SessionLog) -> Any:
    """How much older the rendered model was than the newest telemetry, and when nothing came."""
    drawing = new_figure(3.4)
    axes = drawing.subplots()
    age, since = ages(log)
    time = (log.leader["time_ns"] - log.leader["time_ns"][0]) * 1e-9
    curve(axes, time, age, PREDICTED, 1.2, label="model, beyond the newest news")
    curve(axes, time, since, ERROR, 1.0, label="since the newest news")
    shade(axes, time, np.nan_to_num(since) >= STALL, ERROR, "nothing heard")
    axes.set(xlabel="time [s]", ylabel="age [s]", title="How old what the leader knew was")
    axes.set_ylim(bottom=0.0)
    legend(axes, columns=3)
    return finished(drawing, 1)


HEARD = Section("heard", _stalled, _lines, _drawings)
