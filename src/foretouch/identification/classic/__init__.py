"""Estimators of one law each, among them those that the paper compares its own with."""
