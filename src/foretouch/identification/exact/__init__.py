"""The exact law (4), learnt by a recursive estimator that does not linearise it, with standard errors."""
