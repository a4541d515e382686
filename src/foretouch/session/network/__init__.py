"""Who may command, how old a command may be, and when a model is sent."""
