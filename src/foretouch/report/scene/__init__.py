"""What a report says of a session in space."""
