"""A whole session in simulated time: operator, network, robot and material. Writes session.png.

python examples/simulate_a_session.py
"""

import foretouch

settings = foretouch.SessionSettings(
    material="hunt-crossley", grip="normal", position_delay=0.08, force_delay=0.3, loss=0.02, seed=1
)
log = foretouch.simulate(settings, duration=8.0).log

report = foretouch.session_report(log)
print(f"stable: {report.stable}")
print(f"predicted force wrong by {report.prediction_error_percent:.1f} % of the force's RMS,")
print(f"the delayed force, never rendered, by {report.delayed_force_error_percent:.1f} %")

log.plot("predicted_force", "delayed_force", "rendered_force", "in_contact").savefig("session.png")
