"""What a report found out, as lines of text, as drawings and as a page."""
