"""Campaigns: many trials of many strategies, and what they say of each."""
