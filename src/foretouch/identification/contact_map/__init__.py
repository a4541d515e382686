"""Force over depth and time as a map: the bank of experts and what it learns from."""
