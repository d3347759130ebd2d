"""Solvers of linear systems on a device."""
