"""Several searches together."""
