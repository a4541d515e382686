"""Sessions in three dimensions: the steps along a line, with geometry about them, a tracker and a camera."""
