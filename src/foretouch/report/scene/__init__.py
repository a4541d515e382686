"""What a report finds out about a session in space."""
