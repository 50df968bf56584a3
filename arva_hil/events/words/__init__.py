"""Events and reasons as English sentences."""
