"""The commands `yasps` and `yasps-opt`."""
