"""Parameterisations, joints and elements."""

from __future__ import annotations

from mutation import Mutation

RIGID = "tests/bodies/test_rigid_and_caged_bodies.py"
TURNS = (f"{RIGID}::test_a_block_turns_many_times_and_stays_rigid",)
DERIVATIVES = (
    "tests/parameterisations/test_derivatives_of_each.py::test_an_energy_of_positions_has_exact_derivatives",
)
WEIGHTS = "tests/parameterisations/test_weights.py"

MUTATIONS = (
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
        "yasps/simulation.py",
        '            one.update_value(state[f"history/{one.path}"])\n',
        "            pass\n",
        (f"{RIGID}::test_a_state_has_the_base_rotation",),
    ),
    Mutation(
        "a link turns against the plane",
        "yasps/parameterisations/chains.py",
        "((cosine - 1) * x - sine * y) * first",
        "((cosine - 1) * x + sine * y) * first",
        DERIVATIVES,
    ),
    Mutation(
        "barycentric weights belong to other corners",
        "yasps/parameterisations/cage.py",
        "np.column_stack([1 - later.sum(axis=1), later])",
        "np.column_stack([later, 1 - later.sum(axis=1)])",
        (f"{WEIGHTS}::test_barycentric_weights_give_points_and_affine_maps_back",),
    ),
    Mutation(
        "a cage's cells are all full",
        "yasps/bodies/caged_body.py",
        "volumes = points.volumes * np.repeat(filled, 8)",
        "volumes = points.volumes",
        (f"{RIGID}::test_a_caged_ball_keeps_its_momentum_and_every_corner_is_held",),
    ),
)
