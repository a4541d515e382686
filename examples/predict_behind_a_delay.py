"""Had this press happened behind a slow network: the force a leader renders at once, beside the one that is late.

python examples/predict_behind_a_delay.py docs/examples/spring.csv 0.3
"""

import sys

import foretouch

path = sys.argv[1] if len(sys.argv) > 1 else "docs/examples/spring.csv"
delay = float(sys.argv[2] if len(sys.argv) > 2 else 0.3)
recording = foretouch.read_recording(path)

predicted = foretouch.predict(recording, delay=delay)
late = foretouch.delayed_force(recording.time, recording.force, delay)
scores = foretouch.score_prediction(
    recording.time, recording.force, predicted.force, late, contact_floor=recording.contact_floor
)

print(f"behind {delay:g} s the predicted force is wrong by {scores.prediction_error_percent:.1f} % of the force's RMS,")
print(f"the delayed force by {scores.delayed_force_error_percent:.1f} %")
table = predicted.to_pandas()
print(table.describe().loc[["mean", "std", "max"], ["force_N", "standard_deviation_N"]].round(3))
