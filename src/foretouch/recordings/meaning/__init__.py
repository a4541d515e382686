"""From columns to a recording: which is time, position and force, and in which units."""
