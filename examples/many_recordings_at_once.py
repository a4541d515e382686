"""A thousand presses through the paper's estimator in one call.

python examples/many_recordings_at_once.py
"""

import time

import numpy as np

from foretouch import FPRLS

rng = np.random.default_rng(0)
recordings, samples = 1000, 2000
clock = np.arange(samples) * 1e-3
depth = 0.004 * (1.0 - np.cos(2.0 * np.pi * clock))[:, None] + 0.0005  # [m], a row a sample
velocity = np.gradient(depth[:, 0], clock)[:, None]
stiffness = rng.uniform(500.0, 2000.0, recordings)  # a column a recording
force = stiffness * depth**1.2 * np.exp(0.5 * velocity) * np.exp(rng.normal(0.0, 0.01, (samples, recordings)))

began = time.perf_counter()
found = FPRLS().run_many(np.broadcast_to(depth, force.shape), np.broadcast_to(velocity, force.shape), force)
elapsed = time.perf_counter() - began

print(f"{force.size:,} samples in {elapsed:.2f} s, with the compiling of the first call")
print(f"ln k wrong by {np.abs(found.theta[:, 0] - np.log(stiffness)).max():.3f} at most")
