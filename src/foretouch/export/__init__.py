"""What other programs are built against: the messages in C."""
