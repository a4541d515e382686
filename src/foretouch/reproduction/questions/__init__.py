"""What the paper leaves open, each tried in more than one way."""
