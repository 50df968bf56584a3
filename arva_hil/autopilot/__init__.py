"""The autopilot: following it, and commanding it."""
