"""Tetrahedral meshes: from files, of simple shapes, of closed surfaces."""
