"""A session's own file: written while it runs, read, repaired and exported."""
