"""The linearised law (18), learnt by recursive least squares: equation (20), its kin, and what mends it."""
