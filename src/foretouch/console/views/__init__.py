"""What is drawn in the scene, along a line and in space."""
