"""From raw samples of a robot to contact samples, and the watch over a force sensor and an encoder."""
