"""A report as lines of text, as drawings and as a page."""
