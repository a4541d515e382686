"""Equation (20) over many recordings in vectorised NumPy: what the compiled estimators are tested and timed against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.identification.linear.options import SMALLEST_DEPTH, SMALLEST_FORCE, FPRLSOptions, RobustOptions
from foretouch.identification.linear.recursion import LARGEST_TRACE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def fprls_many_numpy(
    depth: Array, velocity: Array, force: Array, in_contact: Flags | None = None, *, options: FPRLSOptions | None = None
) -> tuple[Array, Array]:
    """The printed method on n recordings of m samples, one NumPy operation for all recordings at a time.

    Written independently of the compiled kernel, from the equation: the logarithms are NumPy's, sums and divides are
    in another order. Where the covariance is well-conditioned both agree to about ten digits.

    Args:
        depth: [m], shape (m, n).
        velocity: [m/s], shape (m, n).
        force: [N], shape (m, n).
        in_contact: Shape (m, n); by default everywhere.
        options: As printed: depth in metres, the test on ln F, delta I added after the gain, nothing robust.

    Returns:
        Theta, shape (n, 4), and P, shape (n, 4, 4).

    Raises:
        SettingError: Options beyond the printed ones.
    """
    options = FPRLSOptions() if options is None else options
    _require_printed(options)
    touching = np.ones(depth.shape, np.bool_) if in_contact is None else in_contact
    count = depth.shape[1]
    start = np.array(options.initial_parameters)[:, None]
    begin = options.initial_covariance * np.eye(4)[:, :, None]
    theta, p = np.tile(start, (1, count)), np.tile(begin, (1, 1, count))
    last = np.full(count, np.nan)
    with np.errstate(all="ignore"):
        for x, v, f, contact in zip(depth, velocity, force, touching, strict=True):
            usable = (x >= SMALLEST_DEPTH) & (x < np.inf) & (f >= SMALLEST_FORCE) & (f < np.inf) & np.isfinite(v)
            taken = contact & usable
            moved = np.nan_to_num(np.abs(x - last), nan=0.0)
            last = np.where(contact, np.where(taken, x, last), np.nan)
            x, v, f = np.where(taken, x, 1.0), np.where(taken, v, 0.0), np.where(taken, f, 1.0)
            mu = 0.95 + 0.05 * np.exp(-options.forgetting_rate * moved)
            phi = np.stack([np.ones(count), np.log(x), v, v / x])
            innovation = np.log(f) - (phi * theta).sum(axis=0)
            projected = np.einsum("ijn,jn->in", p, phi)
            spread = mu + (phi * projected).sum(axis=0)
            gain = projected / spread
            new_theta = theta + gain * innovation
            new_p = (p - gain[:, None] * projected[None]) / mu
            sound = (spread > 0.0) & np.isfinite(spread) & np.isfinite(new_theta).all(axis=0)
            sound &= np.einsum("iin->n", new_p) < LARGEST_TRACE
            if options.perturbation > 0.0:
                tripped = options.sensitivity * innovation * innovation >= 1.0
                if tripped.any():
                    new_p += np.where(tripped, options.perturbation, 0.0) * np.eye(4)[:, :, None]
            if taken.all() and sound.all():
                theta, p = new_theta, new_p
                continue
            theta = np.where(taken, np.where(sound, new_theta, start), theta)
            p = np.where(taken, np.where(sound, new_p, begin), p)
            last[taken & ~sound] = np.nan
    return theta.T.copy(), np.moveaxis(p, 2, 0).copy()


def _require_printed(options: FPRLSOptions) -> None:
    choices = (options.depth_unit, options.perturbation_error, options.perturbation_moment, options.perturbation_form)
    if choices != ("m", "log", "after", "add") or options.robust != RobustOptions():
        raise SettingError("options", options, "the NumPy reference takes the printed choices in metres alone")
