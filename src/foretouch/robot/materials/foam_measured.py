"""Foam fitted to measured presses: the default material."""

from __future__ import annotations

from importlib.resources import files

import msgspec

from foretouch.robot.materials.foam_fit import FoamFit
from foretouch.robot.materials.material import Material

__all__ = ["foam_measured", "shipped_foam_fit"]


def shipped_foam_fit() -> FoamFit:
    """The fit that is shipped with the package: coefficients, files, surfaces, offsets and residuals."""
    return msgspec.json.decode((files(__package__) / "foam_measured.json").read_bytes(), type=FoamFit)


def foam_measured() -> Material:
    """Foam pressed by a lever at TU/e, as a law over depth and velocity with its hysteresis.

    A soft toe, a steep rise, a plateau and densification; about a third of the energy of a press stays in the
    material. Its surface comes back more slowly than a quick probe. Valid to 1.2 times `FoamFit.measured_depth`
    and 0.3 m/s.
    """
    fit = shipped_foam_fit()
    return Material(
        name="foam-measured",
        description="foam with plateau, densification, hysteresis and relaxation, fitted to measured presses",
        provenance=fit.provenance,
        model=fit.model(),
        press_depth=0.009,
    )
