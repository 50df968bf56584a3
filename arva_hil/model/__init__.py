"""The model: fields of transmitters, and receivers."""
