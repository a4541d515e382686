"""What stands beside the scene: tabs, numbers, plots and buttons."""
