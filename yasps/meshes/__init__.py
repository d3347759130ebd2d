"""Meshes: from files, of simple shapes, of closed surfaces."""

from yasps.meshes.isosurface_stuffing import CoarseLatticeError, stuff_isosurface, stuff_isosurface_with_vertex_count
from yasps.meshes.mesh_file import read_tetrahedral_mesh, write_mesh
from yasps.meshes.rabbit_shape import rabbit
from yasps.meshes.shapes import TriangleMesh, box, cloth_grid, ground, sphere
from yasps.meshes.surface_meshing import tetrahedra_of, tetrahedralize
from yasps.meshes.tetrahedral_mesh import MeshError, TetrahedralMesh
from yasps.meshes.triangles import hinge_stiffness, hinges_of, triangle_areas, triangle_vertex_masses

__all__ = [
    "CoarseLatticeError",
    "MeshError",
    "TetrahedralMesh",
    "TriangleMesh",
    "box",
    "cloth_grid",
    "ground",
    "hinge_stiffness",
    "hinges_of",
    "rabbit",
    "read_tetrahedral_mesh",
    "sphere",
    "stuff_isosurface",
    "stuff_isosurface_with_vertex_count",
    "tetrahedra_of",
    "tetrahedralize",
    "triangle_areas",
    "triangle_vertex_masses",
    "write_mesh",
]
