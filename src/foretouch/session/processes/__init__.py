"""A session's processes: begun, watched, recorded and ended."""
