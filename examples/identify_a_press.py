"""Which contact law fits a press, and how sure is that? Writes identified.png.

python examples/identify_a_press.py docs/examples/spring.csv
"""

import sys

import foretouch

recording = foretouch.read_recording(sys.argv[1] if sys.argv[1:] else "docs/examples/spring.csv")
found = foretouch.identify(recording, foretouch.ExactKelvinVoigt(), keep_history=True)

print(f"surface at {1e3 * found.surface:.2f} mm, force in free air {found.force_offset:.2f} N")
for name, value in found.parameters.items():
    error = (found.standard_errors or {}).get(name)
    margin = "" if error is None else f" ± {error:.2g}"
    print(f"{name}: not determined by this press" if value is None else f"{name}: {value:.4g}{margin}")
print(f"one step ahead the force is wrong by {found.residual_rms / found.contact_force_rms:.1%} of its RMS")

found.plot().savefig("identified.png")
