"""What the IR means, in NumPy."""
