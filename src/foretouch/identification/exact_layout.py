"""What the exact recursive estimator remembers and how it is set, by their places in flat arrays.

The unknowns are F0 [N], D [N], s, alpha of `exact_law`, and the height of the true surface above the given one in
shares of x0.
"""

from __future__ import annotations

__all__ = [
    "ALARM",
    "ALPHA_LOWER",
    "ANCHOR_DEPTH",
    "ANCHOR_TIME",
    "CLIP",
    "CONSTANT_NOISE",
    "CORRELATION_TIME",
    "COUNT",
    "COVARIANCE",
    "DRIFT",
    "EXCESS",
    "FIRST_CORRELATION_TIME",
    "FIRST_NOISE",
    "GAIN",
    "GATE",
    "HOLD_SHARE",
    "HOLD_TIME",
    "IGNORANCE_TIME",
    "LARGEST_NOISE",
    "LARGEST_REFERENCE",
    "LAST_RESIDUAL",
    "LAST_TIME",
    "LEARNT_FROM",
    "LEAST_NOISE",
    "LOG_DEPTH",
    "LOG_REFERENCE",
    "MEMORY_SIZE",
    "MOMENTS",
    "MOVING_TIME",
    "NOISE_MEMORY",
    "NOTES",
    "PAUSE",
    "POWER",
    "PRODUCT",
    "PROJECTED",
    "REFERENCE",
    "REFERENCE_TIME_AT",
    "SETTINGS",
    "SHARE_NOISE",
    "SLOPE",
    "SQUARE",
    "STATE_SIZE",
    "SURFACE_NOISE",
    "S_LOWER",
    "THETA",
    "UNKNOWNS",
]

UNKNOWNS = 5

REFERENCE = 0  # x0 [m], 0 before the first sample
LARGEST_REFERENCE = 1  # the largest so far [m]
LAST_TIME = 2  # of the newest moving sample [s]
ANCHOR_DEPTH, ANCHOR_TIME = 3, 4  # where and when movement was last seen [m], [s]
COUNT = 5  # moving samples, at most the noise memory
MOVING_TIME = 6  # [s]
LOG_DEPTH = 7  # running mean of ln x
POWER = 8  # running mean of F^2 [N^2]
CONSTANT_NOISE = 9  # variance of the force that does not grow with it [N^2]
SHARE_NOISE = 10  # variance of the force in shares of its square
MOMENTS = 11  # five weighted means: 1, F^2, F^4, r^2, r^2 F^2
PRODUCT, SQUARE, LAST_RESIDUAL = 16, 17, 18  # of successive normalised residuals
ALARM = 19  # mean of the last squared normalised innovations
PAUSE = 20  # samples for which no change can be called
EXCESS = 21  # the same mean over a longer time
LEARNT_FROM = 22  # samples since the beginning
LOG_REFERENCE = 23  # ln x0
SLOPE, PROJECTED, GAIN = 24, 29, 34  # scratch of one step: H, P H' and K
MEMORY_SIZE = 39

THETA, COVARIANCE, NOTES = 0, UNKNOWNS, UNKNOWNS + UNKNOWNS * UNKNOWNS
STATE_SIZE = NOTES + MEMORY_SIZE
"""One array holds the unknowns, their covariance and the memory, in this order: a call with one array is quick."""

SETTINGS: tuple[str, ...] = (
    "strength_prior",
    "strength_prior",
    "s_prior",
    "alpha_prior",
    "surface_prior",
    "s_lower",
    "s_upper",
    "alpha_lower",
    "alpha_upper",
    "drift",
    "least_noise",
    "first_noise",
    "largest_noise",
    "ignorance_time",
    "noise_memory",
    "correlation_time",
    "first_correlation_time",
    "clip",
    "gate",
    "hold_time",
    "hold_share",
    "surface_noise",
    "reference_time",
)
"""Their order in the array of settings."""

S_LOWER, ALPHA_LOWER = SETTINGS.index("s_lower"), SETTINGS.index("alpha_lower")
DRIFT = SETTINGS.index("drift")
LEAST_NOISE, FIRST_NOISE = SETTINGS.index("least_noise"), SETTINGS.index("first_noise")
LARGEST_NOISE, IGNORANCE_TIME = SETTINGS.index("largest_noise"), SETTINGS.index("ignorance_time")
NOISE_MEMORY = SETTINGS.index("noise_memory")
CORRELATION_TIME, FIRST_CORRELATION_TIME = (
    SETTINGS.index("correlation_time"),
    SETTINGS.index("first_correlation_time"),
)
CLIP, GATE = SETTINGS.index("clip"), SETTINGS.index("gate")
HOLD_TIME, HOLD_SHARE = SETTINGS.index("hold_time"), SETTINGS.index("hold_share")
SURFACE_NOISE, REFERENCE_TIME_AT = SETTINGS.index("surface_noise"), SETTINGS.index("reference_time")
