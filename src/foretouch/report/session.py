"""The numbers of a session."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from foretouch.errors.checks import require_type
from foretouch.messages import CHANNELS, SessionLog, encode
from foretouch.models import ContactMapModel, summarise_map
from foretouch.quantities import Array, Rows
from foretouch.report.numbers import largest, renders_models, setting
from foretouch.report.perception import time_to_accuracy, update_jumps
from foretouch.report.rows import Pairs, away, force_at_follower, joining, model_of, not_scored, nowhere, pair
from foretouch.report.scene import AT_ONE_POSITION, look, tracking_error
from foretouch.report.scores import Scores
from foretouch.report.sections.hand import hand_figures
from foretouch.report.sections.heard import heard_figures
from foretouch.report.sections.safety import contact_force, safety_figures, segment_figures
from foretouch.report.sections.session import duration, loop_sentence, phase_figures, rendered_scores, scored
from foretouch.session.latency import latency_figures
from foretouch.settings import NO_BASELINE

CONTACT_FLOOR = 0.05
"""Smallest force that counts as contact in a session [N]."""

LONGEST_LAG = 0.2  # Tracking lags are looked for up to this [s]
LATE = 1.5  # A tick is late when its period is longer than this many nominal periods


def session_figures(
    log: SessionLog, *, score_from: float = 1.5, score_to: float | None = None, recording: str | None = None
) -> dict[str, Any]:
    """All figures of a session as one object of plain numbers, texts and None, ready for JSON.

    True, predicted, rendered and delayed force are compared at equal command sequence, one row per applied command
    (`foretouch.report.pair`), and scored by `score_prediction` at the time of the follower's tick. The true force is
    the follower's compensated sensor force; the rendered one is divided by the force scale. Rows in which the follower
    guarded a first touch, did something else than follow, or in which the clutch was pressed or the device gave no
    position, are counted and not scored; rows whose sensors were not to be trusted are counted and left out. A figure
    is None where there is nothing to measure it on.

    Where a side ended and began again, or settings changed, all figures are of the longest part in which nothing
    changed (`SessionLog.longest_phase`) and ``settings`` are its own, but for ``segments``, ``safety``, ``messages``
    and ``counts``, which are of the whole session. ``segments`` has the main figures of every part.

    A session in three dimensions has these figures along the normal of the surface, and ``scene`` beside them
    (`foretouch.report.scene.scene_figures`).

    Args:
        log: The recorded session.
        score_from: Start of the scoring window [s] after the first row.
        score_to: Its end [s]; None for the last row.
        recording: Path of the recording, to be named in the report.

    Returns:
        The fields of `Scores`; those of the force after the limits, divided by the force scale, begin with
        ``rendered_``, as ``rendered_rmse_N``. Energy, hand, segments and scenes are on this page above. Beside these:

        - ``status``: a key of `STATUSES`; ``recording``: path of the MCAP file; ``duration_s``: first to last tick;
          ``score_from_s``, ``score_to_s``: the window, None being the end.
        - ``samples``: rows in all; ``guarded_samples``: rows in which a first touch was guarded.
        - ``largest_model_jump_N``, ``largest_model_jump_N_per_s``, ``largest_model_jump_at_s``: the largest change of
          the predicted force by a new model, its largest rate, and when the first came after the leader's first tick.
        - ``largest_update_jump_N``, ``largest_update_jump_N_per_s``, ``largest_update_jump_at_s``: the same after
          mediation, and ``largest_rendered_update_jump_N``, ``largest_rendered_update_jump_N_per_s``,
          ``largest_rendered_update_jump_at_s``: after the limits, which spread a jump over several ticks.
        - ``time_to_ten_percent_s``: from the first contact to an error that stays within 10 % (`time_to_accuracy`).
        - ``equal_position``: the prediction at the follower's own motion, without the robot's tracking error;
          ``exact_force``: the prediction against the simulator's contact force.
        - ``max_rendered_force_N``, ``largest_rendered_jump_N`` in one tick, ``max_follower_force_N`` on the material.
        - ``clipped_ticks``: ticks in which a limit acted; ``clipped``: by ``leader`` and ``follower``.
        - ``tracking_error``: ``rms_mm``, ``max_mm``, and ``lag_ms``, the time shift that explains most of it;
          ``commands``: ``sent``, ``applied``, ``never_applied``.
        - ``standard_deviation``: its median in contact, ``median_N``, and the percentages of errors within one and two
          of it, ``within_one_percent`` and ``within_two_percent``, honest at 68 and 95.
        - ``parameters``, ``standard_errors``: numbers of the last valid law, None where undetermined; for a contact map
          ``stiffness``, ``damping``, ``exponent``, ``switching`` of its law.
        - ``map``: the weights ``shares`` of ``law``, ``coarse``, ``fine``; ``depth_visited_m``,
          ``speed_visited_m_per_s``; force at rest and slope at three depths, ``depths_m``, ``forces_N``,
          ``local_stiffness_N_per_m``; the last ``standard_deviation_N`` in contact.
        - ``models``: ``sent``, ``valid``, ``used`` in some tick; ``model_bytes``: ``per_s``, ``p50`` and ``max`` of
          one.
        - ``messages``: ``sent``, ``lost``, ``late``, ``undecodable``, and ``dropped`` by the recorder; ``counts``: the
          counters behind them, with ``recorder_missed``, and ``truncated`` for a recording that was cut.
        - ``timing``: of each side ``period_ms`` and ``compute_us`` (``p50``, ``p99``, ``max``), ``late_ticks`` (longer
          than 1.5 ms) of ``ticks``, ``ticks_per_s`` reached, ``rate`` wanted; ``elapsed_s`` of a simulation.
        - ``latency``: times of the loop's stages, their sum, and the loop as measured
          (`foretouch.session.latency.latency_figures`).
        - ``heard``: ages of models, stalls, and bytes of a thin link
          (`foretouch.report.sections.heard.heard_figures`).
        - ``operator``, ``loop``, ``baseline``, ``settings``: who moved the leader, whether the force moves a hand, the
          rendered baseline if any, and the settings as text.

    Raises:
        SettingError: A window that ends before it begins.
        ArgumentTypeError: No log.
    """
    require_type(
        "log", log, SessionLog, "a SessionLog: read_session gives one, and what simulate returns has one as log"
    )
    whole, log = log, log.longest_phase()
    pairs = pair(log)
    leader, follower = pairs.leader, pairs.follower
    skipped = not_scored(pairs)
    limits: dict[str, Any] = {"contact_floor": CONTACT_FLOOR, "score_from": score_from, "score_to": score_to}
    predicted = leader["predicted_force"]
    main, rendered = scored(pairs, predicted, **limits), rendered_scores(log, pairs, **limits)
    local, exact = scored(pairs, force_at_follower(log, pairs), **limits), None
    if np.isfinite(follower["exact_force"]).all():  # the simulator's force has no offset to take off
        exact = scored(pairs, predicted, "exact_force", offset=0.0, **limits)
    jumps = update_jumps(log.leader)
    clipped = {"leader": int(log.leader["clipped"].sum()), "follower": int(log.follower["clipped"].sum())}
    report = {
        "status": main.status,
        "recording": recording,
        "segments": segment_figures(whole)
        | {"duration_s": duration(whole), "each": phase_figures(whole, log, **limits)},
        "safety": safety_figures(whole),
        "duration_s": duration(log),
        "samples": main.samples,
        "scored_samples": main.scored_samples,
        "guarded_samples": int(follower["guarded"].sum()),
        "away_samples": int((away(follower) & ~joining(follower)).sum()),
        "faulty_samples": int((log.follower["validity"] > 0).sum()),
        "nowhere_samples": int(nowhere(log.leader).sum()),
        "score_from_s": score_from,
        "score_to_s": score_to,
        "contact_force_rms_N": main.contact_force_rms_N,
        "prediction_rmse_N": main.prediction_rmse_N,
        "prediction_error_percent": main.prediction_error_percent,
        "delayed_force_rmse_N": main.delayed_force_rmse_N,
        "delayed_force_error_percent": main.delayed_force_error_percent,
        "rendered_rmse_N": rendered.prediction_rmse_N,
        "rendered_error_percent": rendered.prediction_error_percent,
        "within_jnd_percent": main.within_jnd_percent,
        "rendered_within_jnd_percent": rendered.within_jnd_percent,
        "phantom_force_rms_N": main.phantom_force_rms_N,
        "rendered_phantom_force_rms_N": rendered.phantom_force_rms_N,
        "missed_contact_percent": main.missed_contact_percent,
        **(jumps if renders_models(log.settings) else dict.fromkeys(jumps)),
        "time_to_ten_percent_s": time_to_accuracy(
            pairs.time, main.measured_force, predicted, main.in_contact & ~skipped
        ),
        "equal_position": _errors(local),
        "exact_force": _errors(exact),
        **hand_figures(log, pairs),
        "max_rendered_force_N": largest(log.leader["rendered_force"]),
        "largest_rendered_jump_N": largest(np.abs(np.diff(log.leader["rendered_force"]))),
        "max_follower_force_N": largest(contact_force(log)),
        "clipped_ticks": sum(clipped.values()),
        "clipped": clipped,
        "tracking_error": _tracking(pairs, score_from, score_to),
        "commands": {
            "sent": int(log.leader.size),
            "applied": int(log.leader.size - pairs.never_applied),
            "never_applied": pairs.never_applied,
        },
        **_learnt(log, pairs),
        "models": _models(log),
        "model_bytes": _model_bytes(log),
        "standard_deviation": main.coverage(pairs.leader["predicted_force"], pairs.leader["standard_deviation"]),
        "messages": _messages(whole),
        "counts": dict(log.counts),
        "timing": {
            "leader": _timing(log.leader, CHANNELS["command"].rate),
            "follower": _timing(log.follower, CHANNELS["telemetry"].rate),
        },
        "latency": latency_figures(log.leader, log.follower, log.settings),
        "heard": heard_figures(whole, duration(whole)),
        "operator": log.settings.get("operator"),
        "loop": loop_sentence(log.settings),
        "baseline": setting(log.settings, "baseline", NO_BASELINE),
        "settings": dict(log.settings),
    }
    return look(log, pairs).complete(report)


def _errors(scores: Scores | None) -> dict[str, float | None]:
    return {name: getattr(scores, name, None) for name in AT_ONE_POSITION}


def _learnt(log: SessionLog, pairs: Pairs) -> dict[str, Any]:
    """The law's numbers in the last valid model, None where undetermined, and what a contact map has beside them."""
    models = ((update, model_of(update)) for update in reversed(log.models))
    update, model = next(((update, model) for update, model in models if model is not None), (None, None))
    if update is None or model is None:
        return {"parameters": None, "standard_errors": None, "map": None}
    finite = [error if math.isfinite(error) else None for error in update.standard_errors]
    errors = dict(zip(model.parameter_names, finite, strict=True)) if len(finite) == len(model.parameters) else None
    untold = {name for name, error in (errors or {}).items() if error is None}
    numbers = zip(model.parameter_names, model.parameters, strict=True)
    deviation = pairs.leader["standard_deviation"]
    known = np.flatnonzero(np.isfinite(deviation) & pairs.follower["in_contact"])
    newest = float(deviation[known[-1]]) if known.size else None
    return {
        "parameters": {name: None if name in untold else value for name, value in numbers},
        "standard_errors": errors,
        "map": summarise_map(model).figures(newest) if isinstance(model, ContactMapModel) else None,
    }


def _models(log: SessionLog) -> dict[str, int]:
    """Numbers of models that were sent, could be rendered from, and were the newest at some leader tick."""
    arrived = np.unique(log.leader["model_sequence"])
    return {
        "sent": len(log.models),
        "valid": sum(model_of(model) is not None for model in log.models),
        "used": int((arrived > 0).sum()),
    }


def _model_bytes(log: SessionLog) -> dict[str, float | None]:
    """Network load of the models: bytes of their messages without the network's own."""
    sizes, seconds = np.array([len(encode(model)) for model in log.models]), duration(log)
    return {
        "per_s": float(sizes.sum()) / seconds if seconds > 0.0 else None,
        "p50": float(np.median(sizes)) if sizes.size else None,
        "max": float(sizes.max()) if sizes.size else None,
    }


def _messages(log: SessionLog) -> dict[str, int | None]:
    """Counters of both sides, summed; one without a count is None, except for what the log itself shows was sent."""
    counted = {word: _total(log.counts, word) for word in ("sent", "lost", "late", "undecodable", "dropped")}
    if counted["sent"] is None:
        counted["sent"] = int(log.leader.size + log.follower.size) + len(log.models)
    return counted


def _total(counts: dict[str, int], word: str) -> int | None:
    """Sum of the counters whose name is or ends with the word, as ``lost``, ``leader_lost`` or ``leader.lost``."""
    matching = [count for name, count in counts.items() if name.replace(".", "_").split("_")[-1] == word]
    return sum(matching) if matching else None


def _timing(table: Rows, rate: float) -> dict[str, Any]:
    """Loop period and compute time of one side; the first tick has no period."""
    period = table["period_ns"][table["period_ns"] > 0]
    span = float(np.ptp(table["time_ns"])) * 1e-9 if table.size else 0.0
    return {
        "period_ms": _spread(period * 1e-6),
        "compute_us": _spread(table["compute_ns"] * 1e-3),
        "late_ticks": int((period > LATE * 1e9 / rate).sum()),
        "ticks_per_s": (table.size - 1) / span if span > 0.0 else None,
        "ticks": int(table.size),
        "rate": rate,
    }


def _spread(values: Array) -> dict[str, float | None]:
    if not values.size:
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return {"p50": float(p50), "p99": float(p99), "max": float(values.max())}


def _tracking(pairs: Pairs, score_from: float, score_to: float | None) -> dict[str, float | None]:
    """Distance of the robot from the commands it applied, and the time by which it lagged, over the window."""
    inside = (pairs.time >= score_from) & np.isfinite(pairs.leader["position"]) & ~away(pairs.follower)
    if score_to is not None:
        inside &= pairs.time <= score_to
    time = pairs.time[inside]
    commanded, actual = pairs.leader["position"][inside], pairs.follower["position"][inside]
    if not time.size:
        return tracking_error(time)
    lag = _lag(time, commanded, actual)
    return tracking_error(1e3 * np.abs(actual - commanded), None if lag is None else 1e3 * lag)


def _lag(time: Array, commanded: Array, actual: Array) -> float | None:
    """The shift tau [s] that makes ``actual(t) - commanded(t - tau)`` least in squares, a constant offset aside.

    None where the session is too short or the hand hardly moved (under 0.1 mm).
    """
    inside = (time >= time[0] + LONGEST_LAG) & (time <= time[-1] - LONGEST_LAG)
    if inside.sum() < 100 or np.ptp(commanded[inside]) < 1e-4:
        return None
    thin = max(1, int(inside.sum()) // 5000)
    when, where = time[inside][::thin], actual[inside][::thin]

    def leftover(lag: float) -> float:
        return float(np.var(where - np.interp(when - lag, time, commanded)))

    step = 0.002
    grid = np.arange(-LONGEST_LAG / 10, LONGEST_LAG, step)
    best = float(grid[np.argmin([leftover(lag) for lag in grid])])
    best_fit = minimize_scalar(leftover, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-6})
    return float(best_fit.x)
