"""Control lease, freshness of commands, and sending of models."""
