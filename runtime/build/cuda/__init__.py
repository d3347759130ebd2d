"""Compilers and linkers of device code."""
