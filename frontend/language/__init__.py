"""What users write: meshes, primitives, connectivities, attributes."""
