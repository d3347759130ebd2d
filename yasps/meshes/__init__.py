"""Meshes: from files, of simple shapes, of closed surfaces."""

from yasps.meshes.element_kinds import trilinear_shape, trilinear_slopes
from yasps.meshes.element_mesh import ElementMesh, GaussPoints, hex_box, quadratic
from yasps.meshes.isosurface_stuffing import CoarseLatticeError, stuff_isosurface, stuff_isosurface_with_vertex_count
from yasps.meshes.mesh_file import read_tetrahedral_mesh, write_mesh
from yasps.meshes.rabbit_shape import rabbit
from yasps.meshes.refinement import edges_of, hinge_angles, split_edges
from yasps.meshes.shapes import TriangleMesh, box, cloth_grid, ground, sphere
from yasps.meshes.surface_meshing import tetrahedra_of, tetrahedralize
from yasps.meshes.tetrahedral_mesh import MeshError, TetrahedralMesh, signed_volumes
from yasps.meshes.triangles import hinge_stiffness, hinges_of, triangle_areas, triangle_vertex_masses

__all__ = [
    "CoarseLatticeError",
    "ElementMesh",
    "GaussPoints",
    "MeshError",
    "TetrahedralMesh",
    "TriangleMesh",
    "box",
    "cloth_grid",
    "edges_of",
    "ground",
    "hex_box",
    "hinge_angles",
    "hinge_stiffness",
    "hinges_of",
    "quadratic",
    "rabbit",
    "read_tetrahedral_mesh",
    "signed_volumes",
    "sphere",
    "split_edges",
    "stuff_isosurface",
    "stuff_isosurface_with_vertex_count",
    "tetrahedra_of",
    "tetrahedralize",
    "triangle_areas",
    "triangle_vertex_masses",
    "trilinear_shape",
    "trilinear_slopes",
    "write_mesh",
]
