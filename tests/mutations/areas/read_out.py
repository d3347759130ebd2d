"""Forces of contact, and start states."""

from __future__ import annotations

from mutation import Mutation

PAIRS, FORCES = "yasps/contact/pair_forces.py", "yasps/contact/contact_forces.py"
STATE, PARTINGS, SEPARATION = (f"yasps/contact/{name}.py" for name in ("start_state", "partings", "separation"))
SLOPES = ("tests/contact/test_pair_forces.py::test_slopes_are_those_of_complex_steps",)
RUBBING = ("tests/contact/test_pair_forces.py::test_friction_is_the_derivative_of_its_potential",)
GRADIENT = ("tests/contact/test_contact_forces.py::test_forces_are_those_of_the_scenes_gradient",)
REACTION = ("tests/simulation/test_forces.py::test_every_force_has_its_reaction",)
START = "tests/contact/test_start_state.py"
SMALL = (f"{START}::test_small_overlaps_are_measured_and_taken_away",)
INSIDE = (f"{START}::test_a_body_wholly_inside_another_is_noticed",)
LARGE = (f"{START}::test_too_large_an_overlap_leaves_everything_as_it_was",)
CRUSHED = "yasps/contact/crushed_pairs.py"
SMALLEST = ("tests/contact/test_contact_forces.py::test_the_gradient_of_the_smallest_gaps",)

MUTATIONS = (
    Mutation(
        "pairs that rub have all of their radii",
        FORCES,
        'offset = offset * pairs.primitive["share"].value',
        "offset = offset * 1.0",
        ("tests/contact/test_contact_forces.py::test_pairs_rub_at_the_gap_at_which_they_push",),
    ),
    Mutation(
        "moving obstacles may be sunk in what stands still",
        STATE,
        "fixed=np.repeat([body.stands_still for body in self.bodies], counts),",
        "fixed=np.repeat([body.is_fixed for body in self.bodies], counts),",
        (f"{START}::test_a_moving_obstacle_has_to_be_apart_from_all_that_stands_still",),
    ),
    Mutation(
        "closest points turn with nothing",
        PAIRS,
        "self.of_parameters.T[None, :, :, None] * self.way[:, None, None] + (",
        "(",
        SLOPES,
    ),
    Mutation(
        "the mollifier pushes one edge the wrong way",
        PAIRS,
        "= -of_u, of_u, -of_v, of_v",
        "= -of_u, of_u, of_v, -of_v",
        SLOPES,
    ),
    Mutation(
        "the range of the barrier grows where it shrinks",
        PAIRS,
        "-by_ratio * ratio / activation",
        "by_ratio * ratio / activation",
        SLOPES,
    ),
    Mutation(
        "friction of what sticks grows too fast",
        PAIRS,
        "np.where(sticks, (2 - share) / length",
        "np.where(sticks, (2 + share) / length",
        RUBBING,
    ),
    Mutation(
        "forces between bodies are those of the other",
        FORCES,
        "sign = np.where(first < second, 1.0, -1.0)",
        "sign = np.where(first < second, -1.0, 1.0)",
        REACTION,
    ),
    Mutation(
        "a half-space is pulled",
        FORCES,
        "-slopes[:, first].sum(axis=1) if kind.is_plane",
        "slopes[:, first].sum(axis=1) if kind.is_plane",
        GRADIENT,
    ),
    Mutation(
        "what lies inside is outside",
        STATE,
        "self.corners_of(outer))) > 0.5",
        "self.corners_of(outer))) > 1.5",
        INSIDE,
    ),
    Mutation(
        "most of a sheet is on the wrong side",
        STATE,
        "(sizes[cut] < largest[whole])",
        "(sizes[cut] >= largest[whole])",
        SMALL,
    ),
    Mutation(
        "radii are forgotten where bodies are parted",
        PARTINGS,
        "(np.abs(weights) * self.surfaces.radii[vertices]).sum(axis=1)",
        "0 * weights.sum(axis=1)",
        (f"{START}::test_a_thick_sheet_is_bent_between_what_can_not_move",),
    ),
    Mutation(
        "the gap aimed at is too small",
        PARTINGS,
        "MORE = 1.02",
        "MORE = 0.95",
        SMALL,
    ),
    Mutation(
        "any way is short enough",
        SEPARATION,
        "if way > largest_share * size:",
        "if way > 1e9 * size:",
        LARGE,
    ),
    Mutation(
        "crushed pairs are all pairs",
        CRUSHED,
        "some <= ALIKE * least",
        "some <= np.inf",
        SMALLEST,
    ),
    Mutation(
        "of crushed pairs all energies pull",
        "frontend/execution/compiled_scene.py",
        "if paths is None or term.symbol in paths]",
        "if True]",
        ("tests/frontend/execution/test_compiled_scene.py::test_gradients_of_all_energies_and_of_some",),
    ),
    Mutation(
        "the scene keeps the crushed pairs alone",
        CRUSHED,
        "    finally:\n        contact.show_only({})",
        "    finally:\n        least = 0.0",
        SMALLEST,
    ),
    Mutation(
        "gaps are distances",
        CRUSHED,
        "found[name] -= points.offset(name, radii)",
        "found[name] -= 0.0 * points.offset(name, radii)",
        SMALLEST,
    ),
)
