"""What a press can tell of the paper's law: `docs/images/identifiability.png` and tables of `docs/identifiability.md`.

Usage: `.venv/bin/python docs/draw_identifiability.py`; it takes some seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from measured_blocks import fill
from scipy.optimize import least_squares

from foretouch.models import ContinuousSwitching

mpl.use("Agg")
HERE = Path(__file__).parent
TRUE = ContinuousSwitching(1200.0, 2000.0, 1.1, 0.2)
NAMES = ("stiffness k", "damping λ", "exponent n", "switching α")
NOISE, PERIOD, SECONDS, DEEPEST = 0.02, 1e-3, 10.0, 0.01  # [N], [s], [s], [m]
FREQUENCIES = np.geomspace(0.1, 10.0, 25)  # of the presses [Hz]
SLOW, WRONG = 0.5, (0.0, 0.1, 0.2, 0.3, 0.4)
COLOURS, LINES = ("#000000", "#D55E00", "#0072B2", "#CC79A7"), ("-", "--", ":", "-.")

Array = np.ndarray


def press(frequency: float) -> tuple[Array, Array]:
    """Depth and velocity of smooth presses."""
    time = np.arange(0.0, SECONDS, PERIOD)
    angle = 2.0 * np.pi * frequency * time
    depth = 0.5 * DEEPEST * (1.0 - np.cos(angle)) + 1e-4
    return depth, 0.5 * DEEPEST * 2.0 * np.pi * frequency * np.sin(angle)


def force(logs: Array, depth: Array, velocity: Array) -> Array:
    """The law (4) of (ln k, ln λ, n, α) [N]."""
    k, damping, n, alpha = np.exp(logs[0]), np.exp(logs[1]), logs[2], logs[3]
    return k * depth ** (n + alpha) + damping * depth**n * velocity


def unknowns(law: ContinuousSwitching) -> Array:
    return np.array([np.log(law.stiffness), np.log(law.damping), law.exponent, law.switching])


def jacobian(logs: Array, depth: Array, velocity: Array) -> Array:
    """Slopes of the force over (ln k, ln λ, n, α), in closed form, shape (samples, 4)."""
    elastic = np.exp(logs[0]) * depth ** (logs[2] + logs[3])
    viscous = np.exp(logs[1]) * depth ** logs[2] * velocity
    log_depth = np.log(depth)
    return np.column_stack([elastic, viscous, (elastic + viscous) * log_depth, elastic * log_depth])


def standard_errors(frequency: float) -> tuple[Array, Array]:
    """The least that any unbiased estimator can have (Cramér and Rao), and the correlations."""
    depth, velocity = press(frequency)
    slopes = jacobian(unknowns(TRUE), depth, velocity)
    covariance = NOISE**2 * np.linalg.inv(slopes.T @ slopes)
    errors = np.sqrt(np.diag(covariance))
    return errors, covariance / np.outer(errors, errors)


def twin(alpha: float) -> tuple[Array, float, float]:
    """The law nearest in force whose α is held at a wrong value: its numbers, and how far the force is off.

    Of the force in the presses it was fitted to, and in presses ten times as fast [% of the RMS].
    """
    depth, velocity = press(SLOW)
    true = force(unknowns(TRUE), depth, velocity)

    def residual(three: Array) -> Array:
        return force(np.append(three, alpha), depth, velocity) - true

    start = unknowns(TRUE)[:3] + np.array([0.0, 0.0, TRUE.switching - alpha])
    found = np.append(least_squares(residual, start, x_scale="jac", xtol=1e-14, ftol=1e-14).x, alpha)
    fast_depth, fast_velocity = press(10.0 * SLOW)
    fast = force(unknowns(TRUE), fast_depth, fast_velocity)
    off = [
        100.0 * np.sqrt(np.mean((force(found, *motion) - wanted) ** 2) / np.mean(wanted**2))
        for motion, wanted in (((depth, velocity), true), ((fast_depth, fast_velocity), fast))
    ]
    return found, off[0], off[1]


def shares() -> dict[str, str]:
    """The blocks of the page."""
    rows = [
        "| Presses | viscous part (RMS) | k | λ | n | α | largest correlation |",
        "| --: | --: | --: | --: | --: | --: | --: |",
    ]
    for frequency in (0.1, 0.5, 2.0, 10.0):
        errors, correlations = standard_errors(frequency)
        depth, velocity = press(frequency)
        logs = unknowns(TRUE)
        viscous = np.exp(logs[1]) * depth ** logs[2] * velocity
        share = 100.0 * np.sqrt(np.mean(viscous**2) / np.mean(force(logs, depth, velocity) ** 2))
        largest = np.abs(correlations - np.eye(4)).max()
        k, damping = 100.0 * errors[:2]
        cells = f"{share:.2g} % | {k:.2g} % | {damping:.2g} % | {errors[2]:.2g} | {errors[3]:.2g} | {largest:.4f}"
        rows.append(f"| {frequency:g} Hz | {cells} |")
    twins = ["| α | k | λ | n | force off, as pressed | ten times as fast |", "| --: | --: | --: | --: | --: | --: |"]
    for alpha in WRONG:
        (log_k, log_damping, n, _), slow, fast = twin(alpha)
        mark = " (true)" if alpha == TRUE.switching else ""
        cells = f"{np.exp(log_k):,.0f} | {np.exp(log_damping):,.0f} | {n:.2f} | {slow:.2g} % | {fast:.2g} %"
        twins.append(f"| {alpha:g}{mark} | {cells} |")
    return {"bounds": "\n".join(rows) + "\n", "twins": "\n".join(twins) + "\n"}


def main() -> None:
    """Draw, and fill the page."""
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    import matplotlib.pyplot as plt

    errors = np.array([standard_errors(frequency)[0] for frequency in FREQUENCIES])
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.8), layout="constrained")
    for place, name in enumerate(NAMES):
        relative = errors[:, place] / (1.0 if place < 2 else unknowns(TRUE)[place])
        left.loglog(FREQUENCIES, 100.0 * relative, LINES[place], color=COLOURS[place], label=name)
    left.set(xlabel="presses a second [Hz]", ylabel="least standard error [%]", title="What 10 s of presses can tell")
    left.legend(frameon=False, fontsize="small")
    depth = np.linspace(1e-4, DEEPEST, 200)
    for place, alpha in enumerate(WRONG[::2]):
        found, *_ = twin(alpha)
        k, n = np.exp(found[0]), found[2]
        label = f"α = {alpha:g}: k = {k:,.0f}, n = {n:.2f}"
        right.plot(
            1e3 * depth,
            force(found, depth, 0.0 * depth),
            ("-", "--", ":")[place],
            color=COLOURS[place],
            lw=2.4 - 0.5 * place,
            label=label,
        )
    right.set(xlabel="depth [mm]", ylabel="force at rest [N]", title="Three laws that no slow press tells apart")
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both", linewidth=0.5)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(HERE / "images" / "identifiability.png", dpi=110)
    fill(HERE / "identifiability.md", shares())


if __name__ == "__main__":
    main()
