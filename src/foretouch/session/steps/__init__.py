"""One tick of each side, without clock, thread or network."""
