"""The estimators that the paper compares with."""
