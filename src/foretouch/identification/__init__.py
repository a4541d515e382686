"""Room `identification`."""
