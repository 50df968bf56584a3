"""Receivers of pulses that are measured: what receiver_figures.py and receiver_pictures.py share."""
