"""From a file of each format to columns with names, and back."""
