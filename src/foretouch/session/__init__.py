"""Room `session`."""
