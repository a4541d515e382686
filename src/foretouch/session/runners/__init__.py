"""What drives the steps: the machine's clock or a simulated one."""
