"""Measured receivers of pulses: the common part of receiver_figures.py and receiver_pictures.py."""
