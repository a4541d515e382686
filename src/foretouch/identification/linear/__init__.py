"""Laws that are linear in their parameters: fixed-point robust recursive least squares, equation (20), and its kin."""
