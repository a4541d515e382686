"""What the paper derives of its laws: energy that is lost, impacts, linearisation, low damping.

What an impact costs is `energy_loss` and its neighbours in closed form, `integrate_impact` by integration, and
`low_damping_error` between the two; what linearising leaves out is `linearisation_error`.
"""
