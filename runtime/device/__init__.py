"""Devices: memory, launches, arrays of other libraries."""
