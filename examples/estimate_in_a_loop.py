"""One call a sample, as in a control loop of your own: a Learner is fed what sensors show, and asked for its model.

python examples/estimate_in_a_loop.py
"""

import math

from foretouch import ExactHuntCrossley, HuntCrossley, Learner

material = HuntCrossley(stiffness=2600.0, damping=4000.0, exponent=1.5)
learner = Learner(ExactHuntCrossley())  # Learner() alone learns a contact map

for tick in range(6000):
    time = 0.001 * tick
    position = 0.006 * (1.0 - math.cos(2.0 * math.pi * 0.7 * time))  # [m], the surface at 2 mm
    velocity = 0.006 * 2.0 * math.pi * 0.7 * math.sin(2.0 * math.pi * 0.7 * time)
    force = float(material.force(position - 0.002, velocity))
    learner.update(time, position, force)  # never raises; what it did is its answer

learnt = learner.learnt()
assert learnt.model is not None, learnt.reason
print(f"surface at {1e3 * learnt.surface:.2f} mm")
for name, true, found in zip(material.parameter_names, material.parameters, learnt.model.parameters, strict=True):
    print(f"{name}: {found:.4g} (true {true:.4g})")
