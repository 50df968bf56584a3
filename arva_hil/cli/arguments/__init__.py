"""What each command takes: its description and its options. Importing these imports nothing that is slow."""
