"""States in files, runs that go on, and scenes as programs."""

from __future__ import annotations

from mutation import Mutation

CHECKPOINTS = "tests/simulation/test_checkpoints.py"
PROGRAM = "tests/program/test_scene_program.py"

MUTATIONS = (
    Mutation(
        "a state is restored without the scene's numbers",
        "yasps/simulation/state.py",
        "        simulation.scene.set_numbers(numbers)\n",
        "",
        (f"{CHECKPOINTS}::test_numbers_that_were_set_on_the_way_are_restored",),
    ),
    Mutation(
        "a state is restored without the step before it",
        "yasps/simulation/state.py",
        "    stepper.remember(past)\n",
        "",
        ("tests/stepping/test_integrators.py::test_a_restored_state_goes_on_with_bdf2",),
    ),
    Mutation(
        "pins that were released are held again",
        "yasps/simulation/driven_bodies.py",
        'driven.is_released = bool(state[f"is_released/{k}"])',
        "pass",
        (f"{CHECKPOINTS}::test_pins_that_were_moved_and_released_are_restored",),
    ),
    Mutation(
        "pins forget where they were told to be",
        "yasps/simulation/driven_bodies.py",
        'driven.motion = np.array(state[f"motion/{k}"])',
        "pass",
        (f"{CHECKPOINTS}::test_pins_that_were_moved_and_released_are_restored",),
    ),
    Mutation(
        "what auto has learned is forgotten",
        "yasps/simulation/state.py",
        '.direct_solves_left = int(state["direct_solves_left"])',
        ".direct_solves_left = 0",
        (f"{CHECKPOINTS}::test_what_auto_has_learned_belongs_to_the_state",),
    ),
    Mutation(
        "any state is taken",
        "yasps/simulation/fingerprint.py",
        "        if there[name] != here[name]:",
        "        if False:",
        (f"{CHECKPOINTS}::test_a_state_of_something_else_is_refused_by_name",),
    ),
    Mutation(
        "formulas are not told apart",
        "frontend/language/scene_numbers.py",
        "words += [node.op_class.name, *",
        "words += [*",
        ("tests/frontend/language/test_scene_numbers.py",),
    ),
    Mutation(
        "a state that fails is half restored",
        "yasps/simulation/state.py",
        "        simulation.scene.set_numbers(before)\n",
        "",
        (f"{CHECKPOINTS}::test_a_state_that_does_not_fit_what_stands_here_changes_nothing",),
    ),
    Mutation(
        "a state is written over the one before",
        "yasps/simulation/state_files.py",
        'unfinished = file.with_name(f".{file.name}.unfinished")',
        "unfinished = file",
        (f"{CHECKPOINTS}::test_a_file_that_can_not_be_written_leaves_the_one_before",),
    ),
    Mutation(
        "a run keeps one checkpoint",
        "yasps/simulation/checkpoints.py",
        "            self.file.replace(self.earlier)\n",
        "            pass\n",
        (f"{CHECKPOINTS}::test_a_damaged_file_is_refused_and_the_earlier_one_taken",),
    ),
    Mutation(
        "checkpoints are written at the start and at the end",
        "yasps/simulation/frames.py",
        "                    checkpoints.save_if_due(simulation)\n",
        "                    pass\n",
        (f"{CHECKPOINTS}::test_states_are_written_when_they_are_due",),
    ),
    Mutation(
        "direct solutions depend on the number of threads",
        "runtime/solvers/direct.py",
        "18: -1, 34: 16}",
        "18: -1, 34: 0}",
        ("tests/runtime/solvers/test_direct.py::test_a_grid_of_springs_is_solved_to_rounding",),
    ),
    Mutation(
        "a program that failed its check ends well",
        "yasps/program/scene_program.py",
        '            print(f"{self.name}: {error}", file=sys.stderr)\n            return 1\n',
        '            print(f"{self.name}: {error}", file=sys.stderr)\n            return 0\n',
        (f"{PROGRAM}::test_a_check_that_fails_is_said",),
    ),
    Mutation(
        "a seed changes nothing",
        "yasps/program/scene_program.py",
        "velocity + speed * noise",
        "velocity",
        (f"{PROGRAM}::test_a_seed_jitters_the_start_a_little_and_reproducibly",),
    ),
)
