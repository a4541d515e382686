"""The contact map as a law: its numbers in one flat array, its memory and force, and its form on the network."""
