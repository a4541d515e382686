"""A recorded session as a data frame: forces and positions at equal command.

foretouch simulate --duration 8 --recording session.mcap
python examples/read_a_session.py session.mcap
"""

import sys

import foretouch

if len(sys.argv) != 2:
    sys.exit("Usage: read_a_session.py SESSION.mcap")
log = foretouch.read_session(sys.argv[1])
table = log.to_pandas()
touching = table[table["in_contact"]]
print(f"{len(table)} commands carried out, {len(touching)} of them in contact")
print(f"{len(log.models)} models came, {sum(model.valid for model in log.models)} of them to render from")
print(touching[["predicted_force_N", "delayed_force_N", "rendered_force_N"]].describe().round(3))
