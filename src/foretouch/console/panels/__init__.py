"""What stands beside the picture: tabs, numbers, plots and buttons."""
