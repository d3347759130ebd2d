"""Derivatives of bodies."""
