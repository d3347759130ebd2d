"""Benchmarks of yasps beside its peers: `python -m benchmarks` from the top of the repository lists them."""
