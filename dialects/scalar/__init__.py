"""Straight-line scalar code as a hash-consed graph."""
