"""Parameterisations, joints and elements."""

from __future__ import annotations

from mutation import Mutation

BUNNIES = "tests/examples/test_bunnies_and_cloth.py"
RIGID = "tests/bodies/test_rigid_and_caged_bodies.py"
TURNS = (f"{RIGID}::test_a_block_turns_many_times_and_stays_rigid",)
WEIGHTS = "tests/parameterisations/test_weights.py"

JOINT_ENERGIES = "yasps/materials/joints.py"
JOINT_VALUES = ("tests/materials/test_joint_energies.py::test_values",)
LINKAGE = ("tests/bodies/test_joints.py::test_a_four_bar_linkage_follows_its_closed_form_through_a_whole_turn",)

KINDS = "yasps/meshes/element_kinds.py"
ELEMENT_MESH = "yasps/meshes/element_mesh.py"
ELEMENTS = "tests/meshes/test_element_mesh.py"

ROD_BODY, RODS = "yasps/bodies/rod.py", "tests/bodies/test_rods.py"

MUTATIONS = (
    Mutation(
        "rods of several strands are joined to one",
        ROD_BODY,
        "np.arange(start, end - count + 1)",
        "np.arange(start, min(end, starts[-1] - count + 1))",
        (f"{RODS}::test_several_rods_have_nothing_between_them",),
    ),
    Mutation(
        "the second moment of area of a rod is that of torsion",
        ROD_BODY,
        "youngs_modulus * section * radius**2 / 4",
        "youngs_modulus * section * radius**2 / 2",
        (f"{RODS}::test_a_rod_has_what_its_name_says",),
    ),
    Mutation(
        "each end of a rod's segment has the mass of all of it",
        ROD_BODY,
        "0.5 * density * section * lengths",
        "density * section * lengths",
        (f"{RODS}::test_a_rod_has_what_its_name_says",),
    ),
    Mutation(
        "masses are lumped by sums of rows",
        KINDS,
        "np.array([1 / 36] * 4 + [4 / 27] * 6)",
        "np.array([-1 / 20] * 4 + [1 / 5] * 6)",
        (f"{ELEMENTS}::test_masses_are_the_scaled_diagonal_of_the_consistent_matrix",),
    ),
    Mutation(
        "nodes in the middle of sides stand in another order",
        KINDS,
        "TET_SIDES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))",
        "TET_SIDES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))",
        (f"{ELEMENTS}::test_slopes_differentiate_what_the_kind_can_represent",),
    ),
    Mutation(
        "gradients are by the transposed Jacobian",
        ELEMENT_MESH,
        '"qnd,mqde->mqne", slopes, np.linalg.inv(by_local)',
        '"qnd,mqed->mqne", slopes, np.linalg.inv(by_local)',
        (f"{ELEMENTS}::test_an_affine_map_has_its_matrix_at_every_point",),
    ),
    Mutation(
        "half of a quadrilateral looks inwards",
        ELEMENT_MESH,
        "turned[:, [[0, 1, 2], [0, 2, 3]]]",
        "turned[:, [[0, 1, 2], [0, 3, 2]]]",
        (f"{ELEMENTS}::test_surfaces_are_closed_and_look_outwards",),
    ),
    Mutation(
        "Gauss points have the weights of others",
        ELEMENT_MESH,
        "(size * kind.weights).reshape(-1)",
        "(size * kind.weights).T.reshape(-1)",
        ("tests/bodies/test_elements.py::test_the_patch_test_is_exact",),
    ),
    Mutation(
        "a slider leaves one direction free",
        JOINT_ENERGIES,
        "(across * across + other * other)",
        "across * across",
        JOINT_VALUES,
    ),
    Mutation(
        "an angle counts the other way",
        JOINT_ENERGIES,
        "sine, cosine = e3.dot(f2) - e2.dot(f3)",
        "sine, cosine = e2.dot(f3) - e3.dot(f2)",
        JOINT_VALUES,
    ),
    Mutation(
        "a motor jumps at its largest torque",
        JOINT_ENERGIES,
        "(off - 0.5 * torque / select",
        "(off - torque / select",
        JOINT_VALUES,
    ),
    Mutation(
        "limits pull from inside",
        JOINT_ENERGIES,
        "maximum(angle - as_attribute(most), constant(0.0))",
        "maximum(as_attribute(most) - angle, constant(0.0))",
        JOINT_VALUES,
    ),
    Mutation(
        "a frame is fixed to other vertices",
        "yasps/bodies/joints.py",
        "row |= {side: start + numbers,",
        "row |= {side: numbers,",
        LINKAGE,
    ),
    Mutation(
        "angles begin anew after a whole turn",
        "yasps/bodies/joints.py",
        "hinge.frames.set(hinge.number, reference=hinge.angle())",
        "hinge.frames.set(hinge.number, reference=0.0)",
        LINKAGE,
    ),
    Mutation(
        "a rotation turns the other way",
        "yasps/parameterisations/rigid.py",
        "[[no, -z, y], [z, no, -x], [-y, x, no]]",
        "[[no, z, -y], [-z, no, x], [y, -x, no]]",
        (f"{RIGID}::test_rotation_matrices",),
    ),
    Mutation(
        "the base rotation is put after the vector's",
        "yasps/parameterisations/rigid.py",
        "(turns * bases).as_matrix()",
        "(bases * turns).as_matrix()",
        (
            f"{RIGID}::test_a_state_has_the_base_rotation",
            f"{RIGID}::test_putting_the_vector_into_the_base_rotation_moves_nothing",
        ),
    ),
    Mutation(
        "a state is without the base rotation",
        "yasps/simulation/state.py",
        '        one.update_value(state[f"history/{one.path}"])\n',
        "        pass\n",
        (
            f"{RIGID}::test_a_state_has_the_base_rotation",
            "tests/bodies/test_joints.py::test_a_state_has_the_turns_of_hinges",
        ),
    ),
    Mutation(
        "a link turns against the plane",
        "yasps/parameterisations/chains.py",
        "((cosine - 1) * x - sine * y) * first",
        "((cosine - 1) * x + sine * y) * first",
        (f"{WEIGHTS}::test_links_turn_in_their_plane_by_the_sum_of_angles",),
    ),
    Mutation(
        "barycentric weights belong to other corners",
        "yasps/parameterisations/cage.py",
        "np.concatenate([1 - later.sum(axis=-1, keepdims=True), later], axis=-1)",
        "np.concatenate([later, 1 - later.sum(axis=-1, keepdims=True)], axis=-1)",
        (f"{WEIGHTS}::test_barycentric_weights_give_points_and_affine_maps_back",),
    ),
    Mutation(
        "a cage's cells are all full",
        "yasps/bodies/caged_body.py",
        "volumes = points.volumes * np.repeat(filled, len(points.volumes) // len(filled))",
        "volumes = points.volumes",
        (f"{RIGID}::test_a_caged_ball_keeps_its_momentum_and_every_corner_is_held",),
    ),
    Mutation(
        "tetrahedra of a cage take corners in another order",
        "yasps/bodies/caged_body.py",
        "corners = cage.cells[:, np.argsort(cube)]",
        "corners = cage.cells",
        (f"{RIGID}::test_tetrahedra_of_a_cage_fill_its_cells",),
    ),
    Mutation(
        "a cage of tetrahedra is one of hexahedra",
        "yasps/bodies/caged_body.py",
        'if element == "hexahedron" else _cut(self.cage)',
        "if element else _cut(self.cage)",
        (f"{RIGID}::test_a_cage_that_is_full_has_the_energy_and_the_mass_of_the_body",),
    ),
    Mutation(
        "what has gone through the cloth is still above it",
        "examples/bunnies_and_cloth.py",
        "return int(np.sign(weights[heights < 0, 0]).sum()) == 1 and",
        "return",
        (f"{BUNNIES}::test_above_a_folded_sheet",),
    ),
    Mutation(
        "affine bunnies by hand weigh more",
        "examples/many_bunnies_on_cloth_by_hand.py",
        "add_inertia_and_weight(vertices, shape.vertex_masses(mass / volume))",
        "add_inertia_and_weight(vertices, shape.vertex_masses(1.01 * mass / volume))",
        (f"{BUNNIES}::test_with_the_kit_and_by_hand_they_move_alike[many_bunnies_on_cloth-flags1]",),
    ),
    Mutation(
        "docstrings are lines of code",
        "benchmarks/lines_of_code.py",
        "    has_code -= _docstring_lines(source)\n",
        "",
        ("tests/benchmarks/test_lines_of_code.py::test_comments_blank_lines_and_docstrings_are_no_code",),
    ),
)
