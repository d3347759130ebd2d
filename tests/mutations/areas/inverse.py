"""Derivatives through runs."""

from __future__ import annotations

from mutation import Mutation

GRADIENTS = "tests/inverse/test_gradients.py"
SPRINGS = (f"{GRADIENTS}::test_masses_on_springs",)
FORWARDS = (f"{GRADIENTS}::test_forwards_as_backwards",)
SLIDES = ("tests/inverse/test_contact.py::test_a_cube_that_lands_and_slides",)
REFUSALS = "tests/inverse/test_refusals.py"
FIT = "tests/inverse/test_fit.py"
ADJOINT, TANGENT = "yasps/inverse/adjoint.py", "yasps/inverse/tangent.py"
TRAJECTORY = "yasps/inverse/trajectory.py"

MUTATIONS = (
    Mutation(
        "adjoint: velocities at the end of a step do not count from its beginning",
        ADJOINT,
        "origins[part] = -columns / taken.effective",
        "origins[part] = 0 * columns",
        SPRINGS,
    ),
    Mutation(
        "adjoint: BDF2 forgets the step before",
        ADJOINT,
        "self._add_velocity(step - back, k, weight * taken.effective * predicted)",
        "self._add_velocity(step, k, weight * taken.effective * predicted)",
        SPRINGS,
    ),
    Mutation(
        "adjoint: positions at which friction is lagged are no variables",
        ADJOINT,
        "self._add(step, contact.position, of_others[slices[points",
        "self._add(step, contact.position, 0 * of_others[slices[points",
        SLIDES,
    ),
    Mutation(
        "adjoint: slips count from nowhere",
        ADJOINT,
        'weight * of_others[slices[points["previous_position"]]]',
        '0 * of_others[slices[points["previous_position"]]]',
        SLIDES,
    ),
    Mutation(
        "tangent: velocities do not count from X",
        TANGENT,
        "[part.position] - origins[k]) / taken.effective",
        "[part.position]) / taken.effective",
        FORWARDS,
    ),
    Mutation(
        "trajectory: slips of another start count from the old one",
        TRAJECTORY,
        "            self.simulation.contact.accept(self.simulation.contact.positions())\n",
        "            pass\n",
        SLIDES,
    ),
    Mutation(
        "trajectory: after a gradient friction is lagged as in the first step",
        TRAJECTORY,
        "            stepper.load(self._end_of_stepper)\n",
        "            pass\n",
        SLIDES,
    ),
    Mutation(
        "trajectory: another number of the scene is no reason for another run",
        TRAJECTORY,
        "if self._digest_now() != self._digest:",
        "if False:",
        (f"{GRADIENTS}::test_a_run_is_taken_again_when_numbers_change",),
    ),
    Mutation(
        "trajectory: nobody says that forces were left",
        TRAJECTORY,
        "if left <= UNBALANCED:",
        "if True:",
        (f"{GRADIENTS}::test_a_run_that_was_stopped_early_is_said",),
    ),
    Mutation(
        "trajectory: steps in parts are differentiated as if they were whole",
        TRAJECTORY,
        "if report.substeps > 1:",
        "if False:",
        (f"{REFUSALS}::test_steps_that_are_cut_into_parts",),
    ),
    Mutation(
        "kinks: a pair at the activation distance goes unseen",
        "yasps/inverse/kinks.py",
        "np.abs(gap - reach) < NEAR * reach",
        "gap > 2 * reach",
        (f"{REFUSALS}::test_kinks",),
    ),
    Mutation(
        "fit: gradients are by values where the optimiser moves transforms of them",
        "yasps/inverse/fitting.py",
        "return gradient.value, stacked * self._slopes(x)",
        "return gradient.value, stacked",
        (f"{FIT}::test_what_made_a_motion_is_found",),
    ),
    Mutation(
        "jacobian: columns of variables that are not read are left out",
        "frontend/execution/variants.py",
        "blocks.append(sparse.csr_array((count * entries, size)))",
        "pass",
        ("tests/frontend/execution/test_hessian.py::test_jacobian_against_differences",),
    ),
)
