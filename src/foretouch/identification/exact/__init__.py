"""Laws that are not linear, by recursive Bayesian estimation."""
