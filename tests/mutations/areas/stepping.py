"""Newton's method, its line search, and time steps."""

from __future__ import annotations

from mutation import Mutation

SEARCH = "tests/stepping/test_line_search.py"
VELOCITIES = "tests/stepping/test_velocities.py"
FALL = (f"{VELOCITIES}::test_free_fall",)
SPRING = (f"{VELOCITIES}::test_a_spring_follows_the_recurrence",)
FORCES = "tests/stepping/test_forces.py"
FIXED = ("tests/frontend/execution/test_fixed_unknowns.py::test_the_solution_is_that_of_the_reduced_system",)
DRIVEN = "tests/simulation/test_driven.py"
RESCUE = "tests/simulation/test_rescue.py"
BAD_INPUT = "tests/simulation/test_bad_input.py"
SIMULATION = "tests/simulation/test_simulation.py"
FOLLOWS = "tests/runtime/matrix/test_block_matrix.py::test_fixed_rows_and_columns_follow_what_is_fixed_and_the_sparsity"
CRUSHED = ("tests/stepping/test_crushed_pairs.py::test_crushed_pairs_are_opened",)
DETOURS = "tests/stepping/test_detour.py"
DETOUR = "yasps/stepping/detour.py"
CODE = "yasps/stepping/newton.py"
INTEGRATORS = "yasps/stepping/integrators.py"
BDF = "tests/stepping/test_integrators.py"
ORDERS = (f"{BDF}::test_orders",)
STATIC = "tests/stepping/test_quasi_static.py"
CHOICE = "yasps/stepping/projection_choice.py"
CHOICES = "tests/stepping/test_projection_choice.py"
MOTION = "yasps/stepping/motion.py"
EULER = "yasps/stepping/time_stepper.py"

REMESHING = "tests/simulation/test_remeshing.py"
GOES_ON = (f"{REMESHING}::test_a_cloth_goes_on_with_another_mesh_and_compiles_nothing",)
ANEW = (f"{REMESHING}::test_the_simulation_is_then_one_of_the_new_mesh",)

MUTATIONS = (
    Mutation(
        "a guess of the Newton step is taken as it is",
        "frontend/execution/newton_system.py",
        "return slope / curvature * guess",
        "return guess",
        ("tests/frontend/execution/test_newton_guess.py::test_starts_at_the_best_multiple_of_a_guess",),
    ),
    Mutation(
        "a guess without a best multiple is taken",
        "frontend/execution/newton_system.py",
        "if not (curvature > 0 and np.isfinite(slope / curvature)):",
        "if False:",
        ("tests/frontend/execution/test_newton_guess.py::test_a_guess_without_a_best_multiple_changes_nothing",),
    ),
    Mutation(
        "nothing is left over by a cut step",
        CODE,
        "return solution.x - step * moved",
        "return None",
        (f"{DETOURS}::test_what_a_cut_step_left_over_saves_iterations",),
    ),
    Mutation(
        "static energies are projected at once",
        "frontend/execution/newton_system.py",
        '    "auto": ("dynamic", True),\n',
        '    "auto": (True,),\n',
        ("tests/frontend/execution/test_solver_choice.py",),
    ),
    Mutation(
        "energies of changing instances are left as they are",
        "frontend/execution/compiled_scene.py",
        'self.dynamic if project == "dynamic" else project',
        "project is True",
        ("tests/frontend/execution/test_solver_choice.py",),
    ),
    Mutation(
        "a failed try is forgotten",
        CHOICE,
        "        self.tries = not solution.projected\n",
        "        self.tries = True\n",
        (CHOICES,),
    ),
    Mutation(
        "pauses stay short",
        CHOICE,
        "min(2 * self.next_pause, LONGEST_PAUSE)",
        "1",
        (CHOICES,),
    ),
    Mutation(
        "a step too short is not noticed",
        CHOICE,
        "self.tries or bool(steps and steps[-1] > 1.0)",
        "self.tries",
        (CHOICES,),
    ),
    Mutation(
        "Newton's method learns nothing of failures",
        CODE,
        "        self.projections.learn(linear, solution)\n",
        "",
        ("tests/stepping/test_newton.py",),
    ),
    Mutation(
        "BDF2 begins anew on another mesh",
        EULER,
        "            self.past = replace(self.past, start=start, end=end)\n",
        "            self.past = None\n",
        GOES_ON,
    ),
    Mutation(
        "velocities stay those of the old vertices",
        EULER,
        "        new = transfer(old) if velocity is None else np.array(velocity, np.float64)\n",
        "        new = np.resize(old, transfer(old).shape)\n",
        GOES_ON,
    ),
    Mutation(
        "pins go to vertices that are a part of theirs",
        "yasps/simulation/remeshing.py",
        "alone = entries.data == 1.0",
        "alone = entries.data > 0.0",
        (f"{REMESHING}::test_pins_follow_and_what_a_user_added_is_asked_for",),
    ),
    Mutation(
        "a refused surface leaves the scene resized",
        "yasps/contact/barrier_contact.py",
        "            self._scene.resize(*undo)\n",
        "            pass\n",
        (f"{REMESHING}::test_what_is_refused_changes_nothing",),
    ),
    Mutation(
        "laws stay those of the old vertices",
        "yasps/contact/contact_table.py",
        "        return replace(self, class_of=np.repeat(np.array(classes, np.int32), list(new.values())))",
        "        return replace(self, class_of=np.resize(self.class_of, sum(new.values())))",
        ANEW,
    ),
    Mutation(
        "a state is restored without its mesh",
        "yasps/simulation/state.py",
        "        take_meshes(simulation, numbers)\n",
        "",
        (f"{REMESHING}::test_a_state_has_its_mesh",),
    ),
    Mutation(
        "pinned vertices are no part of a state",
        "yasps/simulation/driven_bodies.py",
        '            driven.vertices = state[f"driven_vertices/{k}"].astype(np.int64)\n',
        "",
        (f"{REMESHING}::test_a_state_has_its_mesh",),
    ),
    Mutation(
        "frames of another mesh go into the same file",
        "yasps/output/recorder.py",
        "                self.files.append(self._next_file())\n",
        "                pass\n",
        ("tests/output/test_recorder.py::test_another_mesh_is_in_another_file",),
    ),
    Mutation(
        "edges with a cut on one side alone",
        "yasps/meshes/refinement.py",
        "more = through[cut[sides].any(axis=1) & ~cut[through]]",
        "more = through[:0]",
        ("tests/meshes/test_refinement.py::test_the_surface_stays",),
    ),
    Mutation(
        "the Newton step goes uphill",
        MOTION,
        "np.subtract(start, x, out=x)",
        "np.add(start, x, out=x)",
        FALL,
    ),
    Mutation(
        "the line search accepts growth",
        CODE,
        "energy <= start + (0.0 if self.newton.settings.asks_for_forces else ROUNDING * abs(start))",
        "energy <= start + abs(start)",
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
        "if step != 1.0 and self.leaves_way(step) and self.bound(self.now) < 1.0:",
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
        EULER,
        "self.velocities[k] = (positions_of([part.position]) - x) / effective",
        "self.velocities[k] = positions_of([part.position]) - x",
        FALL,
    ),
    Mutation(
        "velocities are those of the first part",
        EULER,
        "self.velocities[k] = (positions_of([part.position]) - x) / effective",
        "self.velocities[k] = (positions_of([self.parts[0].position])[: len(x)] - x) / effective",
        FALL,
    ),
    Mutation(
        "inertia is predicted without velocity",
        EULER,
        "part.predicted.update_value(x + effective * v)",
        "part.predicted.update_value(x)",
        FALL,
    ),
    Mutation(
        "the first guess falls by dt a",
        EULER,
        "flight = flight + dt * dt * np.",
        "flight = flight + dt * np.",
        FALL,
    ),
    Mutation(
        "the first guess forgets the velocity",
        EULER,
        "flight = old + dt * velocity",
        "flight = old",
        FALL,
    ),
    Mutation(
        "velocities of targets are displacements",
        EULER,
        "self.target_velocities = [(new - old) / dt for",
        "self.target_velocities = [(new - old) for",
        FALL,
    ),
    Mutation(
        "the kinetic energy has no half",
        EULER,
        "total += 0.5 * float(part.mass.value @ (v * v).sum(axis=1))",
        "total += float(part.mass.value @ (v * v).sum(axis=1))",
        FALL,
    ),
    Mutation(
        "the momentum has no mass",
        EULER,
        "total += part.mass.value @ v",
        "total += v.sum(axis=0)",
        FALL,
    ),
    Mutation(
        "where the energy is rounding any step will do",
        CODE,
        "return there >= -STILL_DOWNHILL * slope",
        "return True",
        (f"{FORCES}::test_where_the_energy_is_all_rounding_the_slope_decides",),
    ),
    Mutation(
        "the residual force is that before the last step",
        CODE,
        "if is_short and self.forces_hold():\n                return report",
        "if is_short and report.residual_force >= 0:\n                return report",
        (f"{FORCES}::test_forces_fall_to_rounding_and_are_those_of_the_accepted_state",),
    ),
    Mutation(
        "torques count as forces",
        "yasps/stepping/forces.py",
        "most, start = max(most, norm / self.arms.get(target, 1.0)), end",
        "most, start = max(most, norm), end",
        (f"{FORCES}::test_torques_are_forces_over_the_arm",),
    ),
    Mutation(
        "one of two tolerances is enough",
        CODE,
        "report.residual_force <= settings.force_tolerance) and (",
        "report.residual_force <= settings.force_tolerance) or (",
        (f"{FORCES}::test_a_relative_tolerance_is_one_of_the_largest_force_of_an_energy",),
    ),
    Mutation(
        "what is driven is put through what is in the way",
        "yasps/stepping/arrival.py",
        "is_free = step == 1.0",
        "is_free = True",
        (f"{DRIVEN}::test_a_lift_takes_up_what_lies_on_it_and_arrives_exactly",),
    ),
    Mutation(
        "what is driven is not held where it was put",
        "yasps/stepping/arrival.py",
        "return self.stepper.minimize(self.fixed())",
        "return self.stepper.minimize()",
        (f"{DRIVEN}::test_a_lift_takes_up_what_lies_on_it_and_arrives_exactly",),
    ),
    Mutation(
        "multipliers learn nothing",
        "yasps/stepping/driven.py",
        "self.multiplier = self.multiplier - stiffness * (self.positions() - goal)",
        "self.multiplier = 0.0 * goal",
        (f"{DRIVEN}::test_pins_of_a_stiff_body_come_to_their_places_and_carry_its_weight",),
    ),
    Mutation(
        "obstacles are not asked for before they are pushed",
        "yasps/stepping/arrival.py",
        "end[rows], rigid[rows] = goal, one.is_exact",
        "end[rows], rigid[rows] = goal, False",
        (f"{DRIVEN}::test_two_that_are_driven_into_each_other_are_refused",),
    ),
    Mutation(
        "a part of a step goes the whole way",
        "yasps/stepping/driven.py",
        "(end - start) / (until - start)",
        "1.0",
        (f"{RESCUE}::test_halves_of_a_driven_step_go_half_the_way",),
    ),
    Mutation(
        "the first half of a failed step stays",
        "yasps/stepping/rescue.py",
        "    except BaseException:\n        stepper.load(before)\n        raise\n    finally:",
        "    finally:",
        (f"{RESCUE}::test_a_second_half_that_fails_takes_the_first_back",),
    ),
    Mutation(
        "a motion that raises leaves the first half of its step",
        "yasps/stepping/rescue.py",
        "    except BaseException:\n        stepper.load(before)\n        raise\n    finally:",
        "    except ValueError:\n        stepper.load(before)\n        raise\n    finally:",
        (f"{BAD_INPUT}::test_a_motion_that_fails_moves_nothing",),
    ),
    Mutation(
        "another time step is one of the scene alone",
        "yasps/simulation/simulation.py",
        "if seconds != self.stepper.time_step:",
        "if False:",
        (f"{SIMULATION}::test_the_time_step_and_gravity_may_change_between_steps",),
    ),
    Mutation(
        "forces are read with the time step of the next step",
        "yasps/simulation/simulation.py",
        "effective_step=self.effective_step,\n            )",
        "effective_step=self.time_step,\n            )",
        (f"{RESCUE}::test_forces_that_are_read_are_those_of_the_last_part",),
    ),
    Mutation(
        "first guesses fall as at the beginning",
        "yasps/simulation/simulation.py",
        "target: self.gravity for body",
        "target: self.gravity.value for body",
        (f"{SIMULATION}::test_the_time_step_and_gravity_may_change_between_steps",),
    ),
    Mutation(
        "targets of one's own have no velocity",
        EULER,
        "        dt = self.time_step\n        self._follow_targets()",
        "        dt = self.time_step",
        (f"{SIMULATION}::test_targets_of_ones_own_come_and_go_between_steps",),
    ),
    Mutation(
        "with friction Newton's method stops by speed alone",
        "yasps/simulation/contact_of_bodies.py",
        "max_iterations=500, relative_force_tolerance=FRICTION_BALANCE)",
        "max_iterations=500)",
        ("tests/simulation/test_friction_steps.py::test_forces_balance_in_every_step",),
    ),
    Mutation(
        "the time step stays halved",
        "yasps/stepping/rescue.py",
        "        set_time_step(seconds)\n",
        "        pass\n",
        (f"{RESCUE}::test_halves_and_quarters_are_tried",),
    ),
    Mutation(
        "velocities of targets are those of a failed part",
        EULER,
        "        self.target_velocities = [velocity.copy() for velocity in state.target_velocities]\n",
        "",
        (f"{RESCUE}::test_a_second_half_that_fails_takes_the_first_back",),
    ),
    Mutation(
        "only rows of fixed unknowns are left out",
        "runtime/matrix/block_matrix.py",
        "np.flatnonzero(fixed.take(group.rows) | fixed.take(group.cols))",
        "np.flatnonzero(fixed.take(group.rows))",
        FIXED,
    ),
    Mutation(
        "what is fixed is looked up once",
        "runtime/matrix/block_matrix.py",
        "if self._touched is None or not np.array_equal(self._touched[0], fixed):",
        "if self._touched is None:",
        (FOLLOWS,),
    ),
    Mutation(
        "what is fixed is not looked up in a new sparsity",
        "runtime/matrix/block_matrix.py",
        "self._groups = self._touched = None",
        "self._groups = None",
        (FOLLOWS,),
    ),
    Mutation(
        "fixed unknowns have no diagonal",
        "runtime/matrix/block_matrix.py",
        "= np.eye(group.r, group.c)",
        "= 0.0",
        FIXED,
    ),
    Mutation(
        "the gradient of fixed unknowns is kept",
        "frontend/execution/compiled_scene.py",
        "            gradient[fixed] = 0.0\n",
        "",
        FIXED,
    ),
    Mutation(
        "crushed pairs are left to Newton's method",
        CODE,
        "opened = None if crushed is None else self.open(solution, crushed, here)",
        "opened = None",
        CRUSHED,
    ),
    Mutation(
        "the first step that opens crushed pairs is the last",
        CODE,
        "            longest *= 2\n",
        "            break\n",
        CRUSHED,
    ),
    Mutation(
        "BDF2 weighs the step before as if it were to come",
        INTEGRATORS,
        "(4 / 3, -1 / 3), 2 / 3)",
        "(2 / 3, 1 / 3), 2 / 3)",
        ORDERS,
    ),
    Mutation(
        "BDF2 takes the whole time step for the effective one",
        INTEGRATORS,
        "(4 / 3, -1 / 3), 2 / 3)",
        "(4 / 3, -1 / 3), 1.0)",
        ORDERS,
    ),
    Mutation(
        "BDF2 goes on after a change",
        EULER,
        " or not known or not here.continues(past.end):",
        " or not known:",
        (f"{BDF}::test_the_first_step_and_those_after_a_change_are_of_backward_euler",),
    ),
    Mutation(
        "BDF2 goes on with another time step",
        EULER,
        "past is not None and past.time_step == dt and _sizes",
        "past is not None and _sizes",
        (f"{BDF}::test_a_step_that_failed_leaves_what_bdf2_remembers",),
    ),
    Mutation(
        "a failed step is what BDF2 remembers",
        EULER,
        "self.past, self.time = state.past, state.time",
        "self.time = state.time",
        (f"{BDF}::test_a_second_half_that_fails_takes_back_what_the_first_is_remembered_by",),
    ),
    Mutation(
        "slips of BDF2 count from the beginning of the step",
        EULER,
        "            self.contact.count_slips_from(origin.surface)\n",
        "            pass\n",
        ("tests/scenes/test_sliding.py::test_bdf2_slides_by_its_own_recurrence_and_creeps_at_the_same_speed",),
    ),
    Mutation(
        "rates count from the beginning of the step",
        EULER,
        "self.set_constants(origin, effective)",
        "self.set_constants(replace(origin, carried=here.carried), effective)",
        ("tests/scenes/test_damped_bar.py::test_what_is_carried_is_where_the_rate_counts_from",),
    ),
    Mutation(
        "a load step that failed leaves the load",
        "yasps/stepping/quasi_static.py",
        "                set_load(load)\n                motion.write(motion.start)",
        "                motion.write(motion.start)",
        (f"{STATIC}::test_a_load_that_nothing_bears_is_named_and_the_last_equilibrium_kept",),
    ),
    Mutation(
        "a load step that failed is not made smaller",
        "yasps/stepping/quasi_static.py",
        "step = max(0.5 * step, smallest)",
        "step = max(0.99 * step, smallest)",
        (f"{STATIC}::test_a_step_that_is_too_large_is_halved",),
    ),
    Mutation(
        "half-spaces are left out of the look after each frame",
        "yasps/simulation/simulation.py",
        "self.contact.check_intersection_free(self.contact.positions())",
        "self.contact.geometry.check_intersection_free(self.contact.positions())",
        (f"{SIMULATION}::test_what_is_in_a_half_space_is_seen_after_each_frame",),
    ),
    Mutation(
        "springs stay in the scene",
        DETOUR,
        "        newton.contact.ahead.hide()",
        "        pass",
        (f"{DETOURS}::test_springs_are_gone_after_a_solve_that_failed",),
    ),
    Mutation(
        "detours are never taken",
        DETOUR,
        "        if latest.worth > best.worth:",
        "        if latest.worth < 0:",
        (f"{DETOURS}::test_detours_save_iterations_and_end_at_the_same_place",),
    ),
)
