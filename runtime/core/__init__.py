"""The compiled runtime and what all of its parts share."""
