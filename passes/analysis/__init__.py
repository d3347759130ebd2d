"""What is true of a body: how values depend on inputs, in what an energy is isotropic."""
