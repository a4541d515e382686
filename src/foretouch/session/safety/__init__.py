"""What the robot may be told: force, motion, ways that were proven, and who has the last word."""
