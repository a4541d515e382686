"""The figures of a session in three dimensions, and what they stand in for among those of a session along a line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog
from foretouch.models import MaterialField
from foretouch.report.booked import booked_device
from foretouch.report.energy import Account
from foretouch.report.hand import number_of, setting
from foretouch.report.pairs import Pairs
from foretouch.report.scene_contacts import (
    Wrong,
    contact_figures,
    force_figures,
    friction_figures,
    wrong_contacts,
)
from foretouch.report.scene_energy import spatial_account, spatial_energy_figures
from foretouch.report.scene_map import StiffnessMap, learnt_field, map_figures, stiffness_map
from foretouch.report.scene_pose import PoseError, pose_error, pose_figures
from foretouch.report.scene_rows import SceneRows, scene_rows, vectors
from foretouch.robot import MATERIALS
from foretouch.session.spatial import Scene, make_scene

__all__ = ["SceneFindings", "in_scene", "look_at_scene", "scene_figures"]

NOT_ALONG_A_LINE = ("contact_force_rms_N", "prediction_rmse_N", "prediction_error_percent", "within_jnd_percent")


@dataclass(frozen=True, eq=False)
class SceneFindings:
    """What figures and drawings of one stretch are made of.

    Attributes:
        rows: Of the session.
        pose: Error of the fixture's pose.
        wrong: Contacts at equal command; None where nobody knows the true force.
        account: Of energy, in all directions.
        scene: What was touched; None where it is not to be had any more, as the file of a mesh.
        field: The newest materials over the surface; None where there were none.
        map: Of local stiffness; None without a scene or a field.
    """

    rows: SceneRows
    pose: PoseError
    wrong: Wrong | None
    account: Account
    scene: Scene | None
    field: MaterialField | None
    map: StiffnessMap | None


def look_at_scene(log: SessionLog, pairs: Pairs) -> SceneFindings:
    """Everything that figures and drawings of a session in three dimensions are made of.

    Args:
        log: One stretch, with something said in space.
        pairs: Its rows at equal command.
    """
    rows = scene_rows(log, pairs)
    account = spatial_account(
        rows,
        position_scale=number_of(log.settings, "position_scale", 1.0),
        device=booked_device(log.settings),
    )
    scene, field = _scene(log.settings), learnt_field(log)
    found = None
    if scene is not None and field is not None:
        felt = next((model.surface for model in reversed(log.models) if model.valid), 0.0)
        material = _material(log.settings) if _is_simulated(rows) else None
        found = stiffness_map(rows, field, scene, material, felt if math.isfinite(felt) else 0.0)
    return SceneFindings(rows, pose_error(rows), wrong_contacts(log, pairs), account, scene, field, found)


def scene_figures(log: SessionLog, pairs: Pairs, found: SceneFindings) -> dict[str, Any]:
    """What a report says of a scene, as plain numbers, texts and None; a figure is None where nobody knows the truth.

    Args:
        log: One stretch.
        pairs: Its rows at equal command.
        found: What `look_at_scene` found.

    Returns:
        ``name``, ``fusion``, and by kind ``pose`` (`pose_figures`), ``contacts`` (`contact_figures`), ``friction``
        (`friction_figures`), ``forces`` (`force_figures`), ``energy`` (`spatial_energy_figures`) and ``map``
        (`map_figures`, None without a map).
    """
    true = found.scene if _is_simulated(found.rows) else None
    coefficient, viscous = (None, None) if true is None else (true.friction, true.viscous)
    stiffness = None
    if found.map is not None and found.field is not None and found.scene is not None:
        stiffness = map_figures(found.map, found.field, found.scene)
    return {
        "name": setting(log.settings, "scene", ""),
        "fusion": setting(log.settings, "fusion", "full"),
        "pose": pose_figures(log, found.pose),
        "contacts": contact_figures(found.wrong, pairs.time),
        "friction": friction_figures(log, coefficient, viscous),
        "forces": force_figures(found.rows),
        "energy": spatial_energy_figures(found.rows, found.account),
        "map": stiffness,
    }


def in_scene(report: dict[str, Any], scene: Mapping[str, Any], found: SceneFindings) -> dict[str, Any]:
    """A report with its scene, in which nothing is said as if it were along a line.

    The account of energy is that in all directions, and so is the distance between robot and command. What compares
    positions along one line, or the whole contact force with the model's part along the normal, is None.

    Args:
        report: Of the session along the normal.
        scene: What `scene_figures` gave.
        found: And what from.
    """
    energy, hand = scene["energy"], report["hand"]
    holds = energy["certificate_holds"]
    hand = {**hand, "certificate_holds": holds, "energy_agrees": energy["energy_agrees"]}
    stable = bool(holds and hand["forces_finite"] and not hand["oscillation"]["oscillates"])
    nothing = dict.fromkeys(NOT_ALONG_A_LINE)
    return {
        **report,
        "stable": stable,
        **{name: energy[name] for name in ("net_energy_J", "energy_bound_J", "energy_margin_J", "late_energy_J")},
        "energy_used_percent": None,
        "net_energy_exact_J": None,
        "hand": hand,
        "equal_position": dict(nothing),
        "exact_force": dict(nothing),
        "tracking_error": _tracking(found.rows, report["score_from_s"]),
        "scene": dict(scene),
    }


def _tracking(rows: SceneRows, score_from: float) -> dict[str, float | None]:
    """How far the probe was from the place of the command that it applied, in space."""
    applied, at = np.unique(rows.follower["command_sequence"], return_index=True)
    _, told, did = np.intersect1d(rows.hand["sequence"], applied, return_indices=True)
    apart = vectors(rows.hand[told], "place") - vectors(rows.probe[at[did]], "place")
    size = 1e3 * np.linalg.norm(apart, axis=1)[rows.follower_time[at[did]] >= score_from]
    size = size[np.isfinite(size)]
    if not size.size:
        return {"rms_mm": None, "max_mm": None, "lag_ms": None}
    return {"rms_mm": float(np.sqrt(np.mean(size**2))), "max_mm": float(size.max()), "lag_ms": None}


def _is_simulated(rows: SceneRows) -> bool:
    """Whether somebody knows where the fixture really is."""
    return bool(np.isfinite(rows.probe["exact_x"]).any())


def _scene(settings: Mapping[str, str]) -> Scene | None:
    try:
        return make_scene(setting(settings, "scene", ""))
    except ForetouchError:
        return None


def _material(settings: Mapping[str, str]) -> str | None:
    return name if (name := setting(settings, "material", "")) in MATERIALS else None
