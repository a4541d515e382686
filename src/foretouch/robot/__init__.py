"""Room `robot`."""
