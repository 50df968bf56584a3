"""What soak_strangers.py disturbs."""
