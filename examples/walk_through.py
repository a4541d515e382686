"""A press from its file to its pictures, cell by cell: read, identify, predict, simulate, plot.

Each `# %%` begins a cell: Visual Studio Code, PyCharm and Spyder run them one by one and show what each ends with, and
`jupytext --to notebook examples/walk_through.py` makes a notebook of them. As a program it writes walk-through-*.png.

python examples/walk_through.py
"""

# %% [markdown]
# ## Read
# A measured foam that is part of the package; `foretouch.read_recording("press.csv")` reads your own. Whatever the
# file holds, time, position and force are in s, m and N, and the position grows with depth.

# %%
import foretouch

recording = foretouch.read_recording(foretouch.excerpt("tue/b-foam"))
print(f"{len(recording)} samples, {recording.time[-1] - recording.time[0]:.1f} s")
recording.plot("position", "force").savefig("walk-through-read.png")

# %% [markdown]
# ## Identify
# A law with its own numbers: what the press determines has a standard error, what it does not determine is None.

# %%
found = foretouch.identify(recording, foretouch.ExactContinuousSwitching(), keep_history=True)
for name, value in found.parameters.items():
    error = (found.standard_errors or {}).get(name)
    print(f"{name}: undetermined" if value is None or error is None else f"{name}: {value:.3g} ± {error:.1g}")
print(f"surface: {1e3 * found.surface:.2f} ± {1e3 * found.surface_error:.2f} mm")
found.plot().savefig("walk-through-identified.png")

# %% [markdown]
# ## Predict
# The same press behind a network that is 0.3 s late: the force that a leader computes from the models so far, and
# beside it the force as it arrives. The contact map is what a session learns where no other law is asked for.

# %%
DELAY = 0.3
predicted = foretouch.predict(recording, delay=DELAY)
late = foretouch.delayed_force(recording.time, recording.force, DELAY)
scores = foretouch.score_prediction(
    recording.time, recording.force, predicted.force, late, contact_floor=recording.contact_floor
)
print(
    f"predicted force wrong by {scores.prediction_error_percent:.1f} %,"
    f" the delayed one by {scores.delayed_force_error_percent:.1f} %"
)
predicted.plot("force", "standard_deviation").savefig("walk-through-predicted.png")

# %% [markdown]
# ## Simulate
# A whole session in simulated time: a hand, a network with losses, a robot, a material; one seed, the same bits.

# %%
settings = foretouch.SessionSettings(material="foam-measured", grip="normal", force_delay=DELAY, loss=0.02, seed=1)
log = foretouch.simulate(settings, duration=8.0).log
report = foretouch.session_report(log)
print(f"stable: {report.stable}; rendered force wrong by {report.rendered_error_percent:.1f} %")

# %% [markdown]
# ## Plot
# Every result has `plot()`, `to_numpy()` and `to_pandas()`; a plot is a figure of Matplotlib and of no window.

# %%
figure = log.plot("rendered_force", "predicted_force", "delayed_force", "in_contact")
figure.savefig("walk-through-session.png")
print(log.to_pandas()[["rendered_force_N", "delayed_force_N"]].describe().round(2))
