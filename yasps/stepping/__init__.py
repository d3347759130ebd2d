"""Minimisation and time stepping."""
