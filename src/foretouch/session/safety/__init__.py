"""What the robot may be commanded: limits of force and motion, the proven way in, and the last stage of all."""
