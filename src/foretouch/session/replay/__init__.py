"""A recorded session again, as it was or under another network."""
