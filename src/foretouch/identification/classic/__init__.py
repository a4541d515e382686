"""The estimators that the paper compares its own with, each for its law."""
