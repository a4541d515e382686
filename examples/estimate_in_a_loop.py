"""One call a sample, as in a control loop of your own: a Learner is fed what sensors show, and asked for its model.

python examples/estimate_in_a_loop.py
"""

import math

import foretouch

material = foretouch.make_model("hunt-crossley", (2600.0, 4000.0, 1.5))
learner = foretouch.Learner(foretouch.make_estimator("hunt-crossley", "exact"), surface=0.0, force_offset=0.0)

period = 0.001
state = material.initial_state()
for tick in range(6000):
    time = tick * period
    depth = 0.006 * (1.0 - math.cos(2.0 * math.pi * 0.7 * time)) - 0.002
    velocity = 0.006 * 2.0 * math.pi * 0.7 * math.sin(2.0 * math.pi * 0.7 * time)
    state, force, _ = foretouch.advance(material, state, depth, velocity, period)
    learner.update(time, depth, force)  # never raises; what it did is its answer

learnt = learner.learnt()
assert learnt.model is not None, learnt.reason
for name, true, found in zip(material.parameter_names, material.parameters, learnt.model.parameters, strict=True):
    print(f"{name}: {found:.4g} (true {true:.4g})")
