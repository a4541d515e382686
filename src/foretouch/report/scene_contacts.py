"""Contacts that the leader renders and there are none, or that there are and it does not; friction and forces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.report.pairs import Pairs, not_scored
from foretouch.report.scene_rows import SceneRows, vectors

__all__ = ["Wrong", "contact_figures", "force_figures", "friction_figures", "wrong_contacts"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FELT = 0.05
"""A force above this is one that is felt [N]."""

EPISODE = 0.02
"""Shorter ones are edges of a contact, which are never quite where they were [s]."""


class Wrong(NamedTuple):
    """Wrong contacts in each row at equal command, shape (n,).

    Attributes:
        false: The leader predicts a force, and the probe touches nothing.
        missed: The probe touches, and the leader, which has a model, predicts nothing.
        first: The probe touches, and there is no model yet: nobody could know.
        counted: Rows that are looked at: the robot was where the command said.
    """

    false: Flags
    missed: Flags
    first: Flags
    counted: Flags


def wrong_contacts(log: SessionLog, pairs: Pairs) -> Wrong | None:
    """Wrong contacts of a stretch; None where nobody knows the true force."""
    true = pairs.follower["exact_force"]
    if not np.isfinite(true).any():
        return None
    counted = ~not_scored(pairs)
    wanted = pairs.leader["predicted_force"]
    valid = [model.sequence for model in log.models if model.valid]
    known = pairs.leader["model_sequence"] >= min(valid, default=np.iinfo(np.int64).max)
    untold = (true > FELT) & ~(wanted > FELT) & counted
    return Wrong((wanted > FELT) & (true == 0.0) & counted, untold & known, untold & ~known, counted)


def contact_figures(wrong: Wrong | None, time: Array) -> dict[str, Any]:
    """Shares and numbers of the wrong contacts.

    Args:
        wrong: Of the rows at equal command; None where nobody knows.
        time: Of these rows [s].

    Returns:
        ``false``, ``missed`` and ``before_model``, each with ``percent`` of the rows that are counted, the number of
        ``episodes`` longer than 20 ms, and the ``longest_s`` of them, 0 where there is none; all None where nobody
        knows.
    """
    if wrong is None:
        nothing = dict.fromkeys(("percent", "episodes", "longest_s"))
        return {name: dict(nothing) for name in ("false", "missed", "before_model")}
    flags = {"false": wrong.false, "missed": wrong.missed, "before_model": wrong.first}
    return {name: _figures(values, wrong.counted, time) for name, values in flags.items()}


def friction_figures(log: SessionLog, coefficient: float | None, viscous: float | None) -> dict[str, float | None]:
    """Friction as it was learnt last, beside what a simulated scene has.

    Args:
        log: One stretch.
        coefficient: The true one, None where nobody knows.
        viscous: [N s/m].
    """
    said = next((model.friction for model in reversed(log.models) if len(model.friction) >= 4), (None,) * 4)
    return {
        "coefficient": said[0],
        "deviation": said[2],
        "true_coefficient": coefficient,
        "viscous_N_s_per_m": said[1],
        "viscous_deviation_N_s_per_m": said[3],
        "true_viscous_N_s_per_m": viscous,
    }


def force_figures(rows: SceneRows) -> dict[str, float | None]:
    """The largest forces at hand and robot [N]: in all, and along the surface."""
    found: dict[str, float | None] = {}
    for side, table in (("hand", rows.hand), ("robot", rows.probe)):
        force, normal = vectors(table, "force"), vectors(table, "normal")
        along = force - np.einsum("ij,ij->i", force, normal)[:, None] * normal
        for name, vector in (("total", force), ("tangential", along)):
            size = np.linalg.norm(vector, axis=1)
            size = size[np.isfinite(size)]
            found[f"{name}_{side}_N"] = float(size.max()) if size.size else None
    return found


def _figures(flags: Flags, counted: Flags, time: Array) -> dict[str, float | int | None]:
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    lengths = [float(time[end - 1] - time[start]) for start, end in zip(edges[::2], edges[1::2], strict=True)]
    long = [length for length in lengths if length > EPISODE]
    share = 100.0 * float(flags.sum() / counted.sum()) if counted.any() else None
    return {"percent": share, "episodes": len(long), "longest_s": max(long, default=0.0)}
