"""The contact map: force over depth and time as numbers, how it advances, and its bytes."""
