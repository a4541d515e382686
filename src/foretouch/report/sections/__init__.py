"""The sections of a report: of each its figures, its sentences and what a page draws of it."""
