"""Newton's method, its line search, and time steps."""

from __future__ import annotations

from mutation import Mutation

SEARCH = "tests/stepping/test_line_search.py"
VELOCITIES = "tests/stepping/test_velocities.py"
FALL = (f"{VELOCITIES}::test_free_fall",)
SPRING = (f"{VELOCITIES}::test_a_spring_follows_the_recurrence",)
CODE = "yasps/stepping/newton.py"

MUTATIONS = (
    Mutation(
        "the Newton step goes uphill",
        CODE,
        "start - step * x for start, x in",
        "start + step * x for start, x in",
        FALL,
    ),
    Mutation(
        "the line search accepts growth",
        CODE,
        "if energy <= start + ROUNDING * abs(start):",
        "if energy <= start + abs(start):",
        (f"{SEARCH}::test_a_step_that_raises_the_energy_is_halved",),
    ),
    Mutation(
        "pairs are not restored after a failed longer step",
        CODE,
        "        self.newton.find_contacts(now, candidates)\n        return 1.0, energy",
        "        return 1.0, energy",
        (f"{SEARCH}::test_pairs_are_those_of_where_a_failed_longer_step_leaves",),
    ),
    Mutation(
        "a longer step is taken although the energy is higher there",
        CODE,
        "if further < energy:",
        "if further > energy:",
        (f"{SEARCH}::test_pairs_are_those_of_where_a_failed_longer_step_leaves",),
    ),
    Mutation(
        "the longer step is twice as far as the parabola says",
        CODE,
        "lowest = 0.5 / curvature",
        "lowest = 1.0 / curvature",
        ("tests/stepping/test_newton.py::test_a_step_too_short_is_made_longer",),
    ),
    Mutation(
        "a curved way is not checked again",
        CODE,
        "if curved and self.bound(self.now) < 1.0:",
        "if False:",
        (f"{SEARCH}::test_a_curved_way_does_not_jump_over_a_wall",),
    ),
    Mutation(
        "pairs are those of where the step began",
        CODE,
        "            self.newton.find_contacts(self.now, self.candidates)\n",
        "",
        (f"{SEARCH}::test_a_longer_step_that_ends_near_the_ground_brings_its_pairs",),
    ),
    Mutation(
        "targets stay where a failed line search left them",
        CODE,
        "        self.motion.write(self.motion.start)\n        self.newton.find_contacts(self.before)",
        "        self.newton.find_contacts(self.before)",
        (f"{SEARCH}::test_where_no_step_is_short_enough_everything_stays",),
    ),
    Mutation(
        "velocities are displacements",
        CODE,
        "self.velocities[k] = (positions_of([part.position]) - x) / dt",
        "self.velocities[k] = positions_of([part.position]) - x",
        FALL,
    ),
    Mutation(
        "velocities are those of the first part",
        CODE,
        "self.velocities[k] = (positions_of([part.position]) - x) / dt",
        "self.velocities[k] = (positions_of([self.parts[0].position])[: len(x)] - x) / dt",
        FALL,
    ),
    Mutation(
        "inertia is predicted without velocity",
        CODE,
        "part.predicted.update_value(x + dt * v)",
        "part.predicted.update_value(x)",
        FALL,
    ),
    Mutation(
        "the first guess falls by dt a",
        CODE,
        "flight = flight + dt * dt * np.",
        "flight = flight + dt * np.",
        FALL,
    ),
    Mutation(
        "the first guess forgets the velocity",
        CODE,
        "flight = old + dt * velocity",
        "flight = old",
        FALL,
    ),
    Mutation(
        "velocities of targets are displacements",
        CODE,
        "self._target_velocities = [(new - old) / dt for",
        "self._target_velocities = [(new - old) for",
        FALL,
    ),
    Mutation(
        "the kinetic energy has no half",
        CODE,
        "total += 0.5 * float(part.mass.value @ (v * v).sum(axis=1))",
        "total += float(part.mass.value @ (v * v).sum(axis=1))",
        FALL,
    ),
    Mutation(
        "the momentum has no mass",
        CODE,
        "total += part.mass.value @ v",
        "total += v.sum(axis=0)",
        FALL,
    ),
)
