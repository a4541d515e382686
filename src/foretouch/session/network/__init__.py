"""Who may command, how old it may be, and when a model is sent."""
