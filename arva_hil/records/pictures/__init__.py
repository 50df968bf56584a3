"""Pictures of records, drawn by matplotlib: the extra `plots`. Without it `draw` raises ModuleNotFoundError."""
