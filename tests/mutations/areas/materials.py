"""Energies of materials and their parameters."""

from __future__ import annotations

from mutation import Mutation

MODULI = "tests/materials/test_elastic_moduli.py"
BAR = (f"{MODULI}::test_a_stretched_bar_has_youngs_modulus_and_poissons_ratio",)
TETRAHEDRON = (f"{MODULI}::test_a_tetrahedron_that_is_not_regular",)
PARTS = ("tests/materials/test_parts.py",)
THIN = ("tests/materials/test_thin_bodies.py",)
CLOTH = ("tests/materials/test_materials.py",)
FALL = ("tests/stepping/test_velocities.py",)
AFFINE = "yasps/materials/affine.py"
BENDING = "yasps/materials/bending.py"
CLOTH_CODE = "yasps/materials/cloth.py"
ELASTICITY = "yasps/materials/elasticity.py"
RODS = "yasps/materials/rods.py"
FORCES = "yasps/materials/forces.py"

MUTATIONS = (
    Mutation(
        "lambda + 4/6 mu",
        ELASTICITY,
        "lam + 5 / 6 * mu",
        "lam + 4 / 6 * mu",
        BAR,
    ),
    Mutation(
        "mu of Lame is taken as it is",
        ELASTICITY,
        "return 4 / 3 * mu, lam",
        "return mu, lam",
        BAR,
    ),
    Mutation(
        "Lame: a factor 2 in lambda's denominator",
        ELASTICITY,
        "(1 - 2 * poisson_ratio))\n    return mu, lam",
        "(1 - poisson_ratio))\n    return mu, lam",
        BAR,
    ),
    Mutation(
        "stable Neo-Hookean: the shift that makes the rest shape one",
        ELASTICITY,
        "(1 + 0.75 * mu / lam)",
        "(1 + 0.5 * mu / lam)",
        BAR,
    ),
    Mutation(
        "stable Neo-Hookean: no 1 in the logarithm",
        ELASTICITY,
        "(stretch + 1).log()",
        "stretch.log()",
        BAR,
    ),
    Mutation(
        "stable Neo-Hookean: half of the volume term is missing",
        ELASTICITY,
        "0.5 * lam * dilation * dilation",
        "lam * dilation * dilation",
        BAR,
    ),
    Mutation(
        "stable Neo-Hookean: energy without volume",
        ELASTICITY,
        """0.5 * lam * dilation * dilation
    return as_attribute(volume) * density""",
        """0.5 * lam * dilation * dilation
    return density""",
        BAR,
    ),
    Mutation(
        "tetrahedra: volume a third",
        ELASTICITY,
        "volumes = np.linalg.det(edges) / 6",
        "volumes = np.linalg.det(edges) / 3",
        TETRAHEDRON,
    ),
    Mutation(
        "tetrahedra: rest edges as rows",
        ELASTICITY,
        "edges = (x[t[:, 1:]] - x[t[:, :1]]).swapaxes(1, 2)",
        "edges = x[t[:, 1:]] - x[t[:, :1]]",
        TETRAHEDRON,
    ),
    Mutation(
        "tetrahedra: current edges as rows",
        ELASTICITY,
        "for i in (1, 2, 3)])\n    return edges.T * rest_edges_inverse",
        "for i in (1, 2, 3)])\n    return edges * rest_edges_inverse",
        TETRAHEDRON,
    ),
    Mutation(
        "cloth: stretch without area",
        CLOTH_CODE,
        "as_attribute(area) * (resisting + as_attribute(shear) * tilt * tilt)",
        "resisting + as_attribute(area) * as_attribute(shear) * tilt * tilt",
        CLOTH,
    ),
    Mutation(
        "cloth: stretch resists where it is compressed",
        CLOTH_CODE,
        "select(strain < 0, as_attribute(compression), as_attribute(1.0))",
        "select(strain < 0, as_attribute(1.0), as_attribute(compression))",
        CLOTH,
    ),
    Mutation(
        "cloth: area of a triangle doubled",
        CLOTH_CODE,
        "0.5 * double[:, 0]",
        "double[:, 0]",
        CLOTH,
    ),
    Mutation(
        "cloth: weft along the normal's other side",
        CLOTH_CODE,
        "np.cross(normals, along / length)], axis=1)",
        "np.cross(along / length, normals)], axis=1)",
        CLOTH,
    ),
    Mutation(
        "hinge: the second normal points the other way",
        BENDING,
        "return edge.cross(left), right.cross(edge)",
        "return edge.cross(left), edge.cross(right)",
        CLOTH,
    ),
    Mutation(
        "affine bodies: a half is missing",
        AFFINE,
        "return 0.5 * as_attribute(stiffness) * strain.dot(strain)",
        "return as_attribute(stiffness) * strain.dot(strain)",
        ("tests/materials/test_materials.py::test_affine_bodies",),
    ),
    Mutation(
        "affine bodies: rotations are measured as A - I",
        AFFINE,
        "strain = affine_matrix.T * affine_matrix - identity(3)",
        "strain = affine_matrix - identity(3)",
        ("tests/materials/test_materials.py::test_affine_bodies",),
    ),
    Mutation(
        "inertia without mass",
        FORCES,
        "return 0.5 * as_attribute(mass) / (step * step)",
        "return 0.5 / (step * step)",
        FALL,
    ),
    Mutation(
        "inertia divided by dt",
        FORCES,
        "return 0.5 * as_attribute(mass) / (step * step)",
        "return 0.5 * as_attribute(mass) / step",
        FALL,
    ),
    Mutation(
        "inertia: a half is missing",
        FORCES,
        "return 0.5 * as_attribute(mass) / (step * step)",
        "return as_attribute(mass) / (step * step)",
        FALL,
    ),
    Mutation(
        "gravity pulls up",
        FORCES,
        "position.reshape(3, 1).dot(-",
        "position.reshape(3, 1).dot(",
        FALL,
    ),
    Mutation(
        "masses of vertices: a third of each tetrahedron",
        "yasps/meshes/tetrahedral_mesh.py",
        "0.25 * density * self.volumes()",
        "1 / 3 * density * self.volumes()",
        ("tests/meshes/test_tetrahedral_mesh.py::test_volumes_and_masses",),
    ),
    Mutation(
        "Mooney-Rivlin: I_1 with the wrong power of J",
        ELASTICITY,
        "volume_ratio ** (-2 / 3)",
        "volume_ratio ** (-1 / 3)",
        PARTS,
    ),
    Mutation(
        "fibres that resist shortening too",
        ELASTICITY,
        "select(stretch > 0, stored, 0)",
        "stored",
        PARTS,
    ),
    Mutation(
        "plane stress: lambda of the solid",
        "yasps/materials/membranes.py",
        "lam * mu / (lam + 2 * mu) * trace * trace",
        "0.5 * lam * trace * trace",
        PARTS,
    ),
    Mutation(
        "strain-rate damping without its half",
        "yasps/materials/damping.py",
        "0.5 * as_attribute(viscosity)",
        "as_attribute(viscosity)",
        PARTS,
    ),
    Mutation(
        "pressure that pulls",
        "yasps/materials/pressure.py",
        "return -as_attribute(pressure)",
        "return as_attribute(pressure)",
        THIN,
    ),
    Mutation(
        "quadratic bending with the weights of the paper",
        BENDING,
        "size = np.sqrt(2 / ",
        "size = np.sqrt(6 / ",
        THIN,
    ),
    Mutation(
        "angles of hinges: the other way",
        BENDING,
        "np.cross(second, first), edge)",
        "np.cross(first, second), edge)",
        THIN,
    ),
    Mutation(
        "rods: the reference frames' own twist is left out",
        RODS,
        "angles[1] - angles[0] + turned + change",
        "angles[1] - angles[0] + change",
        THIN,
    ),
    Mutation(
        "rods: parallel transport without its denominator",
        RODS,
        "end.dot(vector) / (1 + start.dot(end)) * (start + end)",
        "end.dot(vector) * (start + end)",
        PARTS,
    ),
    Mutation(
        "rods: twists of whole turns are forgotten",
        RODS,
        "twists + 2 * np.pi * np.round((before - twists) / (2 * np.pi))",
        "twists",
        THIN,
    ),
)
