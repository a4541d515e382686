"""One module for the commands of one purpose; each reads its options and calls one room."""
