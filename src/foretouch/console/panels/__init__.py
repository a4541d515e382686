"""The controls beside the picture: tabs, numbers, plots and buttons."""
