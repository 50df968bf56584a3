"""Those who watch an engine: console, record, service manager, pictures."""
