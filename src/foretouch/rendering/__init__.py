"""Room `rendering`."""
