"""From raw samples of a robot to contact samples, and what a force sensor does wrong on the way."""
