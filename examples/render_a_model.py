"""The operator's side alone: a model that has come is rendered at once, from the hand's own motion.

python examples/render_a_model.py
"""

import math

from foretouch import HuntCrossley, KelvinVoigt, Predictor

predictor = Predictor()
for tick in range(2000):
    time = 0.001 * tick
    hand = 0.01 * math.sin(math.pi * time)  # [m], growing into the material
    if tick == 300:  # a model arrives over the network, and where its surface is [m]
        predictor.adopt(KelvinVoigt(stiffness=800.0, damping=3.0), surface=0.002)
    if tick == 600:  # and a better one
        predictor.adopt(HuntCrossley(stiffness=3000.0, damping=1500.0, exponent=1.4), surface=0.0025)
    force = predictor.update(time, hand)
    if tick % 100 == 0 and tick <= 1000:
        print(
            f"{time:.1f} s: hand at {1e3 * hand:5.2f} mm, force {force:.3f} N, by a new model {predictor.jump:+.2f} N"
        )
