"""The picture, along a line and in space: what is drawn in it, and the handle."""
