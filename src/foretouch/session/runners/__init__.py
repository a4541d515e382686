"""What drives the steps, by the machine's clock or a simulated one, with everything compiled before."""
