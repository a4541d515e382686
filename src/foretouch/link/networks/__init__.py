"""Measured networks: what one did to messages over time, from a file, from others' measurements, or as it is known."""
