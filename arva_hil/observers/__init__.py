"""Observers of an engine: console, record, service manager and others."""
