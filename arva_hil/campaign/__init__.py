"""Campaigns: many trials of many strategies, and their statistics."""
