"""The findings of a report, as lines of text, as drawings and as a page."""
