"""What the robot may be told: limits of force and motion, the way in that was proven, and the last word."""
