"""How an arm's joints are driven from command to command, a file for each way, and the way of the tip between two.

They are compiled, and loaded where an arm is made: Numba is slow to import.
"""
