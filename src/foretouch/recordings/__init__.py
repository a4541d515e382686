"""Room `recordings`."""
