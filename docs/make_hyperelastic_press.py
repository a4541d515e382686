"""Compute the press that the material hyperelastic-fe has: a sphere on a neo-Hookean rubber block, by finite elements.

    pip install scikit-fem
    python docs/make_hyperelastic_press.py src/foretouch/robot/materials/hyperelastic_press.json

It needs scikit-fem, which the package does not, takes some minutes, and prints the force beside Hertz's. The block is
an axisymmetric body with the stored energy

    psi = mu / 2 (I_1 - 3 - 2 ln J) + lambda / 2 (ln J)^2

(Bonet and Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4), bonded to rigid ground,
free at its side, in quadratic triangles that are small where the sphere first touches. The sphere is rigid and without
friction; what lies inside of it is pushed out by a penalty pressure. Each depth is solved by Newton's method from the
one before.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri

SPHERE, THICKNESS, BLOCK = 0.006, 0.012, 0.030  # Radius of the sphere, thickness and radius of the block [m]
YOUNG, POISSON = 100e3, 0.45  # E [Pa] and nu of the block at small strains
DEEPEST, ROWS, STEP = (
    0.005,
    25,
    1e-4,
)  # Depth of the last row [m], rows beside the first, and largest step on the way [m]
FINEST, GROWTH, COARSEST = 8e-5, 1.1, 2e-3  # Sides of the triangles [m]: at the contact, from one to the next, at most
PENALTY = 5e3 * YOUNG / SPHERE  # Pressure for each metre inside of the sphere [Pa/m]
MU, LAMBDA = YOUNG / (2.0 * (1.0 + POISSON)), YOUNG * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))


def graded(length: float) -> np.ndarray:
    """Positions from 0 to a length [m], close together at 0."""
    places, size = [0.0], FINEST
    while places[-1] < length:
        places.append(places[-1] + size)
        size = min(size * GROWTH, COARSEST)
    return np.array(places) * length / places[-1]


def deformation(u: object, r: np.ndarray) -> np.ndarray:
    """The deformation gradient, in the order r, z, hoop: shape (3, 3, ...)."""
    gradient = np.zeros((3, 3, *r.shape))
    gradient[:2, :2] = u.grad
    gradient[2, 2] = u.value[0] / r
    return gradient


def inverse(f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of a deformation gradient and its determinant."""
    plane = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    back = np.zeros_like(f)
    back[0, 0], back[1, 1] = f[1, 1] / plane, f[0, 0] / plane
    back[0, 1], back[1, 0] = -f[0, 1] / plane, -f[1, 0] / plane
    back[2, 2] = 1.0 / f[2, 2]
    return back, plane * f[2, 2]


def identity_plus(u: object, r: np.ndarray) -> np.ndarray:
    """F of a displacement."""
    f = deformation(u, r)
    for axis in range(3):
        f[axis, axis] += 1.0
    return f


@BilinearForm
def tangent(u, v, w):
    """Derivative of the virtual work by the displacement."""
    r = w.x[0]
    back, volume = inverse(identity_plus(w["now"], r))
    du, dv = deformation(u, r), deformation(v, r)
    left, right = np.einsum("ij...,jk...->ik...", back, du), np.einsum("ij...,jk...->ik...", back, dv)
    stretched = (MU - LAMBDA * np.log(volume)) * np.einsum("ij...,ji...->...", left, right)
    squeezed = LAMBDA * np.einsum("ii...->...", left) * np.einsum("ii...->...", right)
    return 2.0 * math.pi * r * (MU * np.sum(du * dv, axis=(0, 1)) + stretched + squeezed)


@LinearForm
def work(v, w):
    """Virtual work of the first Piola-Kirchhoff stress P = mu (F - F^-T) + lambda ln J F^-T."""
    r = w.x[0]
    f = identity_plus(w["now"], r)
    back, volume = inverse(f)
    stress = MU * f + (LAMBDA * np.log(volume) - MU) * np.swapaxes(back, 0, 1)
    return 2.0 * math.pi * r * np.sum(stress * deformation(v, r), axis=(0, 1))


def beyond(w) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How far a point lies inside of the sphere [m], its distance from the centre [m], and the normal outwards."""
    right, up = w.x[0] + w["now"].value[0], w.x[1] + w["now"].value[1] - (THICKNESS + SPHERE - w.depth)
    distance = np.hypot(right, up)
    return np.maximum(SPHERE - distance, 0.0), distance, right / distance, up / distance


@BilinearForm
def contact_tangent(u, v, w):
    """Derivative of the penalty pressure's virtual work."""
    inside, distance, right, up = beyond(w)
    normal = (u.value[0] * right + u.value[1] * up) * (v.value[0] * right + v.value[1] * up)
    along = (u.value[0] * up - u.value[1] * right) * (v.value[0] * up - v.value[1] * right)
    return 2.0 * math.pi * w.x[0] * PENALTY * ((inside > 0.0) * normal - inside / distance * along)


@LinearForm
def contact_work(v, w):
    """Virtual work of the penalty pressure."""
    inside, _, right, up = beyond(w)
    return -2.0 * math.pi * w.x[0] * PENALTY * inside * (v.value[0] * right + v.value[1] * up)


def presses() -> list[tuple[float, float]]:
    """Depth [m] and force [N] of each row."""
    mesh = MeshTri.init_tensor(graded(BLOCK), THICKNESS - graded(THICKNESS)[::-1])
    element = ElementVector(ElementTriP2())
    body = Basis(mesh, element, intorder=4)
    top = FacetBasis(mesh, element, facets=mesh.facets_satisfying(lambda x: np.isclose(x[1], THICKNESS)), intorder=6)
    ground = body.get_dofs(lambda x: np.isclose(x[1], 0.0)).all()
    axis = body.get_dofs(lambda x: np.isclose(x[0], 0.0)).all(["u^1"])
    free = np.setdiff1d(np.arange(body.N), np.union1d(ground, axis))
    print(f"{body.N} unknowns", file=sys.stderr)
    now, rate, rows = np.zeros(body.N), np.zeros(body.N), [(0.0, 0.0)]
    for row in range(1, ROWS + 1):
        before, depth = rows[-1][0], DEEPEST * (row / ROWS) ** 2
        step = STEP
        while before < depth:
            step = min(step, depth - before)
            after = solved(body, top, free, now + step * rate, before + step)
            if after is None:
                step *= 0.5
                continue
            now, rate, before, step = after, (after - now) / step, before + step, min(1.5 * step, STEP)
        force = contact_work.assemble(top, now=top.interpolate(now), depth=depth)[top.get_dofs().all(["u^2"])].sum()
        rows.append((depth, float(force)))
        hertz = 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * math.sqrt(SPHERE) * depth**1.5
        print(f"{1e3 * depth:.4f} mm {force:.5f} N, {force / hertz:.4f} of Hertz's", file=sys.stderr, flush=True)
    return rows


def solved(body: Basis, top: FacetBasis, free: np.ndarray, now: np.ndarray, depth: float) -> np.ndarray | None:
    """The displacements in equilibrium with the sphere at a depth [m]; None where Newton's method does not converge."""

    def residual(u: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            inner = work.assemble(body, now=body.interpolate(u))
        return (inner + contact_work.assemble(top, now=top.interpolate(u), depth=depth))[free]

    missing = residual(now)
    for _ in range(20):
        stiffness = tangent.assemble(body, now=body.interpolate(now))
        stiffness = stiffness + contact_tangent.assemble(top, now=top.interpolate(now), depth=depth)
        step = np.zeros_like(now)
        step[free] = -spsolve(stiffness[free][:, free].tocsc(), missing, permc_spec="MMD_AT_PLUS_A")
        if not np.isfinite(step).all():
            return None
        length = 1.0
        after = residual(now + step)
        while not np.linalg.norm(after) < 2.0 * np.linalg.norm(missing) and length > 0.1:
            length *= 0.5
            after = residual(now + length * step)
        now, missing = now + length * step, after
        if length == 1.0 and np.abs(step).max() < 1e-10:
            return now
    return None


def main() -> None:
    """Write the table to the file that is named."""
    depth, force = zip(*presses(), strict=True)
    provenance = (
        f"finite elements by scikit-fem (docs/make_hyperelastic_press.py): sphere of {1e3 * SPHERE:g} mm radius, "
        f"without friction, neo-Hookean block {1e3 * THICKNESS:g} mm thick and {2e3 * BLOCK:g} mm wide, bonded to its "
        f"ground, E = {1e-3 * YOUNG:g} kPa and nu = {POISSON:g} at small strains"
    )
    rounded = {"depth": [float(f"{x:.6g}") for x in depth], "force": [float(f"{x:.6g}") for x in force]}
    Path(sys.argv[1]).write_text(json.dumps({"provenance": provenance, **rounded}, indent=1) + "\n")


if __name__ == "__main__":
    main()
