"""The file of a session: written while it runs, read, repaired and exported."""
