"""Results files, and what is made of them."""

from __future__ import annotations

from mutation import Mutation

VTKHDF, SERIES, RECORDER = (f"yasps/output/{name}.py" for name in ("vtkhdf", "series", "recorder"))
MOTION, CAMERA, TUBES = (f"yasps/output/{name}.py" for name in ("motion_pictures", "camera", "tubes"))
PAGE, USD, EXPORTS = (f"yasps/output/{name}.py" for name in ("html_page", "usd_file", "exports"))
IN_SERIES = "tests/output/test_series.py"
IN_EXPORTS = "tests/output/test_exports.py"
IN_PAGE = "tests/output/test_html_page.py"
IN_MOTION = "tests/output/test_motion_pictures.py"

MUTATIONS = (
    Mutation(
        "pictures: depths have too few digits",
        "yasps/output/pictures.py",
        "nearest = max(1e-3 * self._diagonal, 0.02 *",
        "nearest = max(1e-3 * self._diagonal, 0.0 *",
        ("tests/output/test_pictures.py::test_nothing_shows_through_what_lies_close_above_it",),
    ),
    Mutation(
        "a run that is resumed keeps one frame less",
        VTKHDF,
        'self._frames = int(np.searchsorted(times, until, side="right"))',
        'self._frames = int(np.searchsorted(times, until, side="left"))',
        (f"{IN_SERIES}::test_a_resumed_file_is_that_of_an_uninterrupted_run",),
    ),
    Mutation(
        "frames behind those that are kept stay visible",
        VTKHDF,
        "if self._frames_in_file > self._frames:",
        "if False:",
        (f"{IN_SERIES}::test_frames_that_are_cut_off_are_gone_before_they_are_written_over",),
    ),
    Mutation(
        "what is beside the frames is not compared",
        VTKHDF,
        "if not holds(file, name, values):",
        'if "yasps" not in name and not holds(file, name, values):',
        (f"{IN_SERIES}::test_a_file_of_another_scene_is_not_resumed",),
    ),
    Mutation(
        "a frame is read a vertex too early",
        SERIES,
        "first = (frame % len(self)) * self.number_of_points",
        "first = max(0, (frame % len(self)) * self.number_of_points - 1)",
        (f"{IN_SERIES}::test_a_file_says_all_of_a_run",),
    ),
    Mutation(
        "forces of bodies are those of their neighbours",
        RECORDER,
        "forces[starts[k] : starts[k + 1]]",
        "forces[starts[k - 1] : starts[k - 1] + len(body.positions())]",
        (f"{IN_SERIES}::test_a_file_says_all_of_a_run",),
    ),
    Mutation(
        "the camera forgets that what is near looks large",
        CAMERA,
        "one, other = (across + tangent * depth).max(), (tangent * depth - across).max()",
        "one, other = across.max(), (-across).max()",
        ("tests/output/test_pictures.py::test_the_camera_sees_the_whole_box_and_not_much_more",),
    ),
    Mutation(
        "a camera that follows lags at the ends",
        MOTION,
        'np.pad(values, width, mode="reflect", reflect_type="odd")',
        'np.pad(values, width, mode="edge")',
        (f"{IN_MOTION}::test_the_camera_sees_the_whole_motion_or_follows",),
    ),
    Mutation(
        "folds are edges",
        MOTION,
        "x = series.positions(0)  # which tells creases",
        "x = series.positions(chosen[0])  # which tells creases",
        (f"{IN_MOTION}::test_folds_that_come_later_are_smooth",),
    ),
    Mutation(
        "rings end before they close",
        TUBES,
        "while len(ends[vertex]) == 2 and vertex != start:",
        "while len(ends[vertex]) == 2 and len(chain) < 3:",
        (f"{IN_EXPORTS}::test_edges_are_joined_to_chains",),
    ),
    Mutation(
        "pages add differences to the wrong frame",
        PAGE,
        "steps[1:] -= steps[:-1].copy()",
        "steps[1:] -= steps[0]",
        (f"{IN_PAGE}::test_a_page_holds_the_motion",),
    ),
    Mutation(
        "colours of USD are those of screens",
        USD,
        "np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).tolist()",
        "srgb.tolist()",
        (f"{IN_EXPORTS}::test_usd_has_the_motion_of_each_body",),
    ),
    Mutation(
        "glTF is a mirror image",
        EXPORTS,
        "np.stack([x, z, -y], axis=1)",
        "np.stack([x, z, y], axis=1)",
        (f"{IN_EXPORTS}::test_gltf_has_a_frame_with_y_up",),
    ),
)
