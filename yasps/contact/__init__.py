"""Contact: which pieces of surfaces are close, and the energies that keep them apart."""
