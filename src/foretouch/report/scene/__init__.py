"""The figures of a session in three dimensions, and those that they replace among those along a line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from foretouch.messages import FRICTION_NUMBERS, SessionLog
from foretouch.models import BristleFriction, ScaleField, ShapeField
from foretouch.quantities import Array, Flags, Rows
from foretouch.report.energy import (
    Account,
    BookedDevice,
    account_figures,
    book,
    booked_device,
    energy_account,
    lost_rows,
    recorded_account,
    summed_account,
)
from foretouch.report.numbers import largest, number_of, runs, setting
from foretouch.report.rows import Pairs, model_of, not_scored
from foretouch.report.scene.map import StiffnessMap, learnt_field, map_figures, stiffness_map, touched_places
from foretouch.report.scene.pose import PoseError, SceneRows, pose_error, pose_figures, scene_rows, vectors
from foretouch.report.scene.shape import learnt_shape, scene_of, shape_figures, specimen_of
from foretouch.report.scene.spots import Spot, find_spots, spot_figures
from foretouch.robot import MATERIALS
from foretouch.session.spatial import Scene

FELT = 0.05  # A force above this is one that is felt [N]
BEHIND = 1e-3  # Distance from its command above which a robot is not there yet [m]
EPISODE = 0.02  # Shorter ones are edges of a contact, which are never quite where they were [s]


class Wrong(NamedTuple):
    """Wrong contacts in rows at equal command, shape (n,): false, missed, before any model; and the counted rows.

    Last, which of the false are of a robot that was not there yet, more than a millimetre from the hand: where nobody
    knows the surface it comes slowly.
    """

    false: Flags
    missed: Flags
    first: Flags
    counted: Flags
    behind: Flags


def wrong_contacts(log: SessionLog, pairs: Pairs) -> Wrong | None:
    """Wrong contacts of a segment; None where the true force is unknown."""
    true = pairs.follower["exact_force"]
    if not np.isfinite(true).any():
        return None
    counted = ~not_scored(pairs)
    wanted = pairs.leader["predicted_force"]
    valid = [model.sequence for model in log.models if model.valid]
    known = pairs.leader["model_sequence"] >= min(valid, default=np.iinfo(np.int64).max)
    untold = (true > FELT) & ~(wanted > FELT) & counted
    false = (wanted > FELT) & (true == 0.0) & counted
    behind = false & (np.abs(pairs.leader["position"] - pairs.follower["position"]) > BEHIND)
    return Wrong(false, untold & known, untold & ~known, counted, behind)


def contact_figures(wrong: Wrong | None, time: Array) -> dict[str, Any]:
    """Fractions and numbers of the wrong contacts.

    Returns:
        ``false``, ``missed`` and ``before_model``, each with ``percent`` of the rows that are counted, the number of
        ``episodes`` longer than 20 ms, and the ``longest_s`` of them, 0 where there is none;
        ``behind`` likewise: the false ones while the robot was not there yet. All None where unknown.
    """
    names = ("false", "missed", "before_model", "behind")
    if wrong is None:
        return {name: dict.fromkeys(("percent", "episodes", "longest_s")) for name in names}
    return {
        name: _figures(flags, wrong.counted, time)
        for name, flags in zip(names, (*wrong[:3], wrong.behind), strict=True)
    }


def friction_figures(log: SessionLog, true: BristleFriction | None) -> dict[str, float | None]:
    """Friction as it was learnt last, beside the true one, None where unknown."""
    learnt = next((model.friction for model in reversed(log.models) if len(model.friction) == FRICTION_NUMBERS), None)
    coefficient, viscous, of_mu, of_c, stiffness, of_stiffness, excess, of_excess = learnt or (None,) * FRICTION_NUMBERS
    return {
        "coefficient": coefficient,
        "deviation": of_mu,
        "true_coefficient": None if true is None else true.coefficient,
        "viscous_N_s_per_m": viscous,
        "viscous_deviation_N_s_per_m": of_c,
        "true_viscous_N_s_per_m": None if true is None else true.viscous,
        "stiffness_N_per_m": stiffness or None,
        "stiffness_deviation_N_per_m": of_stiffness or None,
        "true_stiffness_N_per_m": None if true is None else true.stiffness,
        "excess_at_rest": excess if of_excess else None,
        "excess_deviation": of_excess or None,
        "true_excess_at_rest": None if true is None else (true.static - 1.0) * true.coefficient,
    }


def force_figures(rows: SceneRows) -> dict[str, float | None]:
    """The largest forces at hand and robot [N]: in all, and along the surface."""
    figures: dict[str, float | None] = {}
    for side, table in (("hand", rows.hand), ("robot", rows.probe)):
        force, normal = vectors(table, "force"), vectors(table, "normal")
        along = force - np.einsum("ij,ij->i", force, normal)[:, None] * normal
        for name, vector in (("total", force), ("tangential", along)):
            figures[f"{name}_{side}_N"] = largest(np.linalg.norm(vector, axis=1))
    return figures


def _figures(flags: Flags, counted: Flags, time: Array) -> dict[str, float | int | None]:
    lengths = [float(time[end - 1] - time[begin]) for begin, end in runs(flags)]
    long = [length for length in lengths if length > EPISODE]
    percent = 100.0 * float(flags.sum() / counted.sum()) if counted.any() else None
    return {"percent": percent, "episodes": len(long), "longest_s": max(long, default=0.0)}


def spatial_account(rows: SceneRows, *, position_scale: float, device: BookedDevice | None) -> Account:
    """The account in all directions, from the recorded forces and positions of the hand.

    As `foretouch.rendering.SpatialEnergyAccount` keeps it. Where hand and robot are not coupled, the hand's position
    in the world does not give its motion: there, and where rows were lost, the leader's account is used; without a
    known device, throughout.
    """
    hand = rows.hand
    if device is None:
        return Account(*(hand[name].copy() for name in ("energy", "energy_bound", "late_energy")))
    position, force = vectors(hand, "hand") / position_scale, vectors(hand, "force")
    position[~np.isfinite(rows.leader["hand_position"])] = np.nan
    coupled = rows.leader["engaged"]
    lost = lost_rows(hand, np.asarray(np.isfinite(position).all(axis=1)))
    lost |= ~coupled | ~np.concatenate((coupled[:1], coupled[:-1]))
    size, pressing = np.linalg.norm(force, axis=1), rows.leader["rendered_force"]

    def account(period: Array) -> Account:
        return summed_account(hand, book(force, position, period, device), size, pressing, lost, device)

    return recorded_account(rows.leader, hand, account)[0]


AT_ONE_POSITION = ("contact_force_rms_N", "prediction_rmse_N", "prediction_error_percent", "within_jnd_percent")


@dataclass(frozen=True, eq=False)
class LineFindings:
    """What the figures and drawings of one segment along a line are made of."""

    log: SessionLog
    pairs: Pairs  # its rows at equal command

    def booked(self) -> tuple[Rows, Account]:
        """The leader's rows, and their energy account."""
        return self.log.leader, energy_account(self.log.leader, booked_device(self.log.settings))

    def complete(self, report: dict[str, Any]) -> dict[str, Any]:
        """The report with all that is found here alone."""
        return report


@dataclass(frozen=True, eq=False)
class SceneFindings(LineFindings):
    """The same of a segment with messages in space.

    Attributes:
        log: The segment.
        pairs: Its rows at equal command.
        rows: Rows of the session.
        pose: Error of the fixture's pose.
        wrong: Contacts at equal command; None where the true force is unknown.
        account: Energy account in all directions.
        scene: The scene, a shape that was learnt as at the end; None where it is no longer available, as a file.
        field: The newest materials over the surface; None where there were none.
        map: Map of local stiffness; None without a scene or a field.
        spots: Stiff and soft spots of the map, the surest first.
        shape: A shape that nobody knew, as learnt at the end; None for a known one.
    """

    rows: SceneRows
    pose: PoseError
    wrong: Wrong | None
    account: Account
    scene: Scene | None
    field: ScaleField | None
    map: StiffnessMap | None
    spots: tuple[Spot, ...] = ()
    shape: ShapeField | None = None

    def booked(self) -> tuple[Rows, Account]:
        """See `LineFindings.booked`; the account is that in all directions."""
        return self.rows.leader, self.account

    def complete(self, report: dict[str, Any]) -> dict[str, Any]:
        """The report with its scene, without the figures that hold along a line only.

        The account of energy is that in all directions, and so is the distance between robot and command. Figures that
        compare positions along one line, or the whole contact force with the model's part along the normal, are None.
        """
        scene = scene_figures(self.log, self.pairs, self)
        energy, hand = scene["energy"], report["hand"]
        holds = energy["certificate_holds"]
        hand = {**hand, "certificate_holds": holds, "energy_agrees": energy["energy_agrees"]}
        return {
            **report,
            "nowhere_samples": 0,  # a hand has no position on the normal before it is coupled
            "stable": bool(holds and hand["forces_finite"] and not hand["oscillation"]["oscillates"]),
            **{name: energy[name] for name in ("net_energy_J", "energy_bound_J", "energy_margin_J", "late_energy_J")},
            "energy_used_percent": None,
            "net_energy_exact_J": None,
            "hand": hand,
            "exact_force": dict.fromkeys(AT_ONE_POSITION),
            "tracking_error": _tracking(self.rows, report["score_from_s"]),
            "scene": scene,
        }


def look(log: SessionLog, pairs: Pairs) -> LineFindings:
    """What is found in a segment along a line, or in three dimensions where it has messages in space."""
    in_space = bool(setting(log.settings, "scene", "")) and bool(log.leader_space.size and log.follower_space.size)
    return (LineFindings, look_at_scene)[in_space](log, pairs)


def look_at_scene(log: SessionLog, pairs: Pairs) -> SceneFindings:
    """What figures and drawings of a segment with messages in space are made of; its rows at equal command with it."""
    rows = scene_rows(log, pairs)
    scale, device = number_of(log.settings, "position_scale", 1.0), booked_device(log.settings)
    account = spatial_account(rows, position_scale=scale, device=device)
    scene, field = scene_of(log), learnt_field(log)
    stiffness, newest = None, next((model for model in reversed(log.models) if model.valid), None)
    law = None if newest is None else model_of(newest)
    if scene is not None and field is not None and newest is not None and law is not None:
        felt = newest.surface
        name = setting(log.settings, "material", "")
        material = name if name in MATERIALS and _is_simulated(rows) else None
        places, felt = touched_places(rows, scene.surface.radius), felt if math.isfinite(felt) else 0.0
        stiffness = stiffness_map(places, field, law, scene, material, felt)
    wrong = wrong_contacts(log, pairs)
    spots = () if stiffness is None else tuple(find_spots(stiffness))
    found = rows, pose_error(rows), wrong, account, scene, field, stiffness, spots, learnt_shape(log)
    return SceneFindings(log, pairs, *found)


def scene_figures(log: SessionLog, pairs: Pairs, findings: SceneFindings) -> dict[str, Any]:
    """Figures of a scene in one segment, as plain numbers, texts and None; None where the truth is unknown.

    Returns:
        ``name``, ``fusion``, and by kind ``pose`` (`pose_figures`), ``contacts`` (`contact_figures`), ``friction``
        (`friction_figures`), ``forces`` (`force_figures`), ``energy`` (`account_figures`), ``map``
        (`map_figures`, and `spot_figures` as its ``spots``; None without a map) and ``shape`` (`shape_figures`; None
        for a known one).
    """
    true = findings.scene if _is_simulated(findings.rows) else None
    stiffness = None
    if findings.map is not None and findings.field is not None and findings.scene is not None:
        stiffness = map_figures(findings.map, findings.field, findings.scene)
        stiffness["spots"] = spot_figures(findings.spots)
    shape = None
    if findings.shape is not None:
        there = specimen_of(log) if _is_simulated(findings.rows) else None
        shape = shape_figures(findings.shape, findings.rows, touched_places(findings.rows), there)
    return {
        "name": setting(log.settings, "scene", ""),
        "fusion": setting(log.settings, "fusion", "full"),
        "pose": pose_figures(log, findings.pose),
        "contacts": contact_figures(findings.wrong, pairs.time),
        "friction": friction_figures(log, None if true is None else true.friction),
        "forces": force_figures(findings.rows),
        "energy": account_figures(findings.account, findings.rows.hand),
        "map": stiffness,
        "shape": shape,
    }


def _tracking(rows: SceneRows, score_from: float) -> dict[str, float | None]:
    applied, at = np.unique(rows.follower["command_sequence"], return_index=True)
    _, commanded, did = np.intersect1d(rows.hand["sequence"], applied, return_indices=True)
    apart = vectors(rows.hand[commanded], "place") - vectors(rows.probe[at[did]], "place")
    size = 1e3 * np.linalg.norm(apart, axis=1)[rows.follower_time[at[did]] >= score_from]
    return tracking_error(size[np.isfinite(size)])


def tracking_error(size: Array, lag: float | None = None) -> dict[str, float | None]:
    """Figures of distances between robot and command, in mm, and the lag in ms."""
    if not size.size:
        return {"rms_mm": None, "max_mm": None, "lag_ms": None}
    return {"rms_mm": float(np.sqrt(np.mean(size**2))), "max_mm": float(size.max()), "lag_ms": lag}


def _is_simulated(rows: SceneRows) -> bool:
    """Whether the true pose of the fixture is known."""
    return bool(np.isfinite(rows.probe["exact_x"]).any())
