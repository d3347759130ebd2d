"""Contact: pairs, their energies, how far a step may go."""

from __future__ import annotations

from mutation import Mutation

VALUES = "tests/contact/test_contact_values.py"
IPCTK = (f"{VALUES}::test_potential_gradient_and_hessian_are_those_of_ipctk",)
FOLLOW = (f"{VALUES}::test_pairs_follow_the_vertices",)
GEOMETRY = "tests/contact/test_collision_geometry.py"
POTENTIAL = (f"{GEOMETRY}::test_active_set_reproduces_ipctk_barrier_potential",)
IMPROVED = "tests/contact/test_improved_max.py"
THICKNESS = "tests/contact/test_thickness.py"
POINTS = "tests/contact/test_loose_points.py"
MOTION = "tests/contact/test_collision_motion.py"
BEFORE = (f"{MOTION}::test_candidates_made_of_earlier_ones_serve_as_well_as_fresh_ones",)
KEPT = (f"{MOTION}::test_kept_candidates_find_what_ipctk_finds_anew",)
SAFE = (f"{MOTION}::test_step_bounds_are_ipctks_and_safe", f"{GEOMETRY}::test_step_bound_stops_before_the_ground")
MANY = "tests/runtime/collision/test_many_pairs.py"
ALONE = (f"{MANY}::test_a_pair_is_the_same_among_others_as_alone",)
FIRST = (f"{MANY}::test_a_step_is_bounded_by_the_first_pair_to_meet",)
ORDINARY = ("tests/runtime/collision/test_pair_distance.py::test_ordinary_pairs_have_every_kind",)
THREADS = (f"{MANY}::test_all_threads_find_the_same_to_the_last_bit",)
LOOK = "tests/contact/test_look_ahead.py"
AHEAD = (f"{LOOK}::test_what_meets_is_what_bounds_a_step",)
BARRIER = "yasps/contact/barrier.py"
DISTANCES = "yasps/contact/distances.py"
WHERE = "yasps/contact/kinds.py"
FRICTION = "yasps/contact/friction.py"
SLIPS = "tests/contact/test_friction.py"
RUBBING = "tests/contact/test_friction_contact.py"
STEPS = "tests/simulation/test_friction_steps.py"
SLIDING = (f"{SLIPS}::test_static_and_kinetic_friction_against_quadrature",)
CLOSEST = ("tests/contact/test_kinds.py::test_closest_points_and_tangent_planes",)
CODE, PAIRS, NEAR, MAX, ENTRY, THICK, TREE, PACKS, WAYS = (
    "yasps/contact/barrier_contact.py",
    "runtime/collision/close_pairs.cpp",
    "runtime/collision/near_pairs.cpp",
    "runtime/collision/improved_max.h",
    "runtime/collision/close_entry.h",
    "runtime/collision/thickness.h",
    "runtime/collision/collision_tree.h",
    "runtime/collision/pair_packs.h",
    "runtime/collision/free_ways.h",
)

MUTATIONS = (
    Mutation(
        "ways through half-spaces are free",
        CODE,
        "            self.check_free_way(self._accepted, where)",
        "            self.geometry.check_way(self._accepted, where)",
        ("tests/simulation/test_bad_input.py::test_what_is_put_through_a_half_space_is_noticed",),
    ),
    Mutation(
        "the barrier has one gap too few",
        BARRIER,
        "return scale * gap * gap * ratio * ratio",
        "return scale * gap * ratio * ratio",
        IPCTK,
    ),
    Mutation(
        "the reach is not squared",
        "yasps/contact/contact_parts.py",
        "value=distance**2)",
        "value=distance)",
        IPCTK,
    ),
    Mutation(
        "the mollifier is linear",
        BARRIER,
        "return ratio * (2 - ratio)",
        "return ratio",
        IPCTK,
    ),
    Mutation(
        "mollified point-point with the wrong other ends",
        WHERE,
        "        (0, 1),\n        ((0, 2), (1, 3)),",
        "        (0, 1),\n        ((0, 3), (1, 2)),",
        IPCTK,
    ),
    Mutation(
        "mollified point-edge with the wrong edges",
        WHERE,
        "        (0, 1),\n        ((0, 3), (1, 2)),",
        "        (0, 1),\n        ((0, 1), (2, 3)),",
        IPCTK,
    ),
    Mutation(
        "pairs that share an entry count once",
        CODE,
        "energy = pairs.weight * law.energy(",
        "energy = law.energy(",
        IPCTK,
    ),
    Mutation(
        "the distance of lines is measured between their first points",
        DISTANCES,
        "offset, first, second = x.row(2) - x.row(0), x.row(1) - x.row(0), x.row(3) - x.row(2)",
        "offset, first, second = x.row(1) - x.row(0), x.row(1) - x.row(0), x.row(3) - x.row(2)",
        IPCTK,
    ),
    Mutation(
        "the plane of a triangle goes through the wrong corners",
        DISTANCES,
        "x.row(2) - x.row(1), x.row(3) - x.row(1)",
        "x.row(2) - x.row(1), x.row(3) - x.row(0)",
        IPCTK,
    ),
    Mutation(
        "the distance to a line is divided by one edge length",
        DISTANCES,
        "return area.dot(area) / edge.dot(edge)",
        "return area.dot(area) / edge.norm()",
        IPCTK,
    ),
    Mutation(
        "the active set is not renewed where as many pairs are close",
        "yasps/contact/active_set.py",
        "all(np.array_equal(mine[name], others[name]) for name in mine)",
        "all(mine[name].shape == others[name].shape for name in mine)",
        ("tests/stepping/test_newton.py", VALUES),
    ),
    Mutation(
        "candidates of an earlier way are kept whatever comes",
        CODE,
        "not geometry.covers(self._kept, start, end)",
        "self._kept.surface is None",
        ("tests/stepping/test_newton.py::test_free_step_agrees_with_the_geometry_and_serves_all_positions_on_the_way",),
    ),
    Mutation(
        "candidates reach as far as one of both sides may move",
        "yasps/contact/collision_geometry.py",
        "reach + 2 * allowed",
        "reach + allowed",
        (f"{MOTION}::test_both_sides_of_a_pair_may_use_up_their_margin",),
    ),
    Mutation(
        "vertices that strayed are looked for in one of two nodes",
        NEAR,
        "!(one.strayed || other.strayed)",
        "!one.strayed",
        BEFORE,
    ),
    Mutation(
        "vertices that strayed are looked for in one of two blocks",
        NEAR,
        "one.strayed >> i & 1 ? 0xff : other.strayed",
        "other.strayed",
        BEFORE,
    ),
    Mutation(
        "rows that stayed are not held against pieces that strayed",
        NEAR,
        "other.strayed != 0 ? rows : rows & one.strayed",
        "rows & one.strayed",
        BEFORE,
    ),
    Mutation(
        "pairs of vertices that strayed are kept, too",
        NEAR,
        "list.count += !(strayed[v[0]] | strayed[v[1]] | strayed[v[2]] | strayed[v[3]]);",
        "++list.count;",
        BEFORE,
    ),
    Mutation(
        "pairs are kept for the end of a part of a way that is not its end",
        "runtime/collision/ways.cpp",
        "finish = way.nearest_time(last)",
        "finish = 1",
        BEFORE,
    ),
    Mutation(
        "positions are covered at the time that is best for most alone",
        "runtime/collision/ways.cpp",
        "if (time >= 0) squared = way.most_off(at, time);",
        "(void)time;",
        (f"{MOTION}::test_places_between_covered_ones_are_covered",),
    ),
    Mutation(
        "vertices stray that have left the way at its end alone",
        "runtime/collision/ways.cpp",
        "std::max(square(first[v] - from), square(last[v] - to))",
        "square(first[v] - from)",
        BEFORE,
    ),
    Mutation(
        "candidates of less reach are made use of",
        "yasps/contact/collision_geometry.py",
        " and before.distance >= reach",
        "",
        (f"{MOTION}::test_earlier_candidates_of_less_reach_or_another_surface_are_not_used",),
    ),
    Mutation(
        "candidates of less margin are made use of",
        "yasps/contact/collision_geometry.py",
        "shared >= margin and ",
        "",
        (f"{MOTION}::test_earlier_candidates_of_less_reach_or_another_surface_are_not_used",),
    ),
    Mutation(
        "fixed vertices meet each other",
        "yasps/contact/surface_arguments.py",
        "alone = ~still & (labels < 0)",
        "alone = labels < 0",
        (f"{VALUES}::test_groups_and_fixed_vertices_meet_all_others",),
    ),
    Mutation(
        "vertices of no group are a group",
        "yasps/contact/surface_arguments.py",
        "packed[alone] = packed.max(initial=0) + 1 + np.arange(int(alone.sum()))",
        "packed[alone] = packed.max(initial=0) + 1",
        (f"{VALUES}::test_groups_and_fixed_vertices_meet_all_others",),
    ),
    Mutation(
        "other ends stay where two points are exchanged",
        ENTRY,
        "if (b < a) std::swap(a, b), std::swap(a_other, b_other);",
        "if (b < a) std::swap(a, b);",
        IPCTK,
    ),
    Mutation(
        "the other end of a mollified edge is the end itself",
        ENTRY,
        "own[end], edge[0], edge[1], own[1 - end]);",
        "own[end], edge[0], edge[1], own[end]);",
        POTENTIAL,
    ),
    Mutation(
        "thresholds of mollifiers from the lengths, not their squares",
        PAIRS,
        "1e-3 * square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]])",
        "1e-3 * sqrt(square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]]))",
        (f"{GEOMETRY}::test_threshold_comes_from_rest_lengths",),
    ),
    Mutation(
        "equal entries are dropped without their weight",
        PAIRS,
        "entry.weight += entries[next].weight;",
        "entry.weight += 0;",
        POTENTIAL,
    ),
    Mutation(
        "the side of a triangle from its last corner leads to the second",
        ENTRY,
        "corner[k == 2 ? 0 : k + 1]);",
        "corner[k == 2 ? 1 : k + 1]);",
        POTENTIAL,
    ),
    Mutation(
        "the vertices of an edge pair count as mollified where they are not",
        ENTRY,
        "const bool mollified = square(cross(p[1] - p[0], p[3] - p[2])) < threshold;",
        "const bool mollified = square(cross(p[1] - p[0], p[3] - p[2])) < 10 * threshold;",
        POTENTIAL,
    ),
    Mutation(
        "pairs within half the reach only",
        NEAR,
        "most_radii<kSplit>(start.radius) + constant<Eight>(reach);",
        "most_radii<kSplit>(start.radius) + constant<Eight>(0.5 * reach);",
        KEPT,
    ),
    Mutation(
        "only where a motion ends is looked for pairs",
        NEAR,
        "bits_of(along<kSplit>(line, q).is_beyond(far)) &",
        "",
        KEPT,
    ),
    Mutation(
        "vertices without a group are one",
        TREE,
        "its_label < 0 ? i8{} : label == its_label;",
        "label == its_label;",
        POTENTIAL,
    ),
    Mutation(
        "neighbours on the surface repel",
        TREE,
        "joined |= vertices[c] == other.vertices[d][place];",
        "joined |= vertices[c] == -1 - other.vertices[d][place];",
        POTENTIAL,
    ),
    Mutation(
        "a pair of pieces in one block is found from one side only",
        NEAR,
        "i8{0, 1, 2, 3, 4, 5, 6, 7} <= i;",
        "i8{0, 1, 2, 3, 4, 5, 6, 7} <= i + 1;",
        POTENTIAL,
    ),
    Mutation(
        "the weights of a triangle's corners change places",
        WHERE,
        "[constant(-1.0), 1 - u - v, u, v]",
        "[constant(-1.0), 1 - u - v, v, u]",
        CLOSEST,
    ),
    Mutation(
        "the closest point of a first edge is measured from its end",
        WHERE,
        "s, t = offset.cross(second).dot(normal) / area, offset.cross(first).dot(normal) / area\n"
        "    return concat_rows([s - 1, -s, 1 - t, t])",
        "s, t = offset.cross(second).dot(normal) / area, offset.cross(first).dot(normal) / area\n"
        "    return concat_rows([-s, s - 1, 1 - t, t])",
        CLOSEST,
    ),
    Mutation(
        "closest points of nearly parallel edges are not projected back",
        WHERE,
        "s = _within(_along(x.row(2) + t * second, x.row(0), x.row(1)))",
        "s = 1 * s",
        CLOSEST,
    ),
    Mutation(
        "a tangent basis that is orthonormal for normals of length 1 only",
        WHERE,
        "x, y, z = normal / normal.norm()",
        "x, y, z = normal",
        CLOSEST,
    ),
    Mutation(
        "the normal of nearly parallel edges is the vector product of both",
        WHERE,
        "return (x.row(2) - x.row(0) + s * first + t * second).T",
        "return first.cross(second).T",
        CLOSEST,
    ),
    Mutation(
        "all edges count as those of closed surfaces",
        MAX,
        "const int own = 1 - static_cast<int>(next - k);",
        "const int own = -1;",
        (IMPROVED,),
    ),
    Mutation(
        "corners at the rim count as those inside a surface",
        MAX,
        "if (corner.around != 0) {",
        "if ((corner.around = 1) != 0) {",
        (IMPROVED,),
    ),
    Mutation(
        "the second point's area counts as the first's",
        PAIRS,
        "entry.times[entry.vertices[0] == vertex ? 0 : 1] = times;",
        "entry.times[0] = times;",
        (IMPROVED,),
    ),
    Mutation(
        "edge pairs with improved max are merged",
        ENTRY,
        "std::equal(a.edges, a.edges + 2, b.edges) &&",
        "std::equal(a.edges, a.edges, b.edges) &&",
        (IMPROVED,),
    ),
    Mutation(
        "edges have the share of one of their triangles",
        MAX,
        "share = std::min(share, near(sides_[next].triangle).share);",
        "share = std::min(share, near(sides_[k].triangle).share);",
        (f"{THICKNESS}::test_energy_is_continuous_where_the_closest_feature_changes",),
    ),
    Mutation(
        "boxes are no larger by the radii",
        TREE,
        "of[v] = {at - around, at + around, along, along};",
        "of[v] = {at - around, at, along, along};",
        (THICKNESS,),
    ),
    Mutation(
        "a tenth of the distance is kept, not of the gap",
        "runtime/collision/time_apart.h",
        "const double keep = offset + kKept * gap,",
        "const double keep = kKept * distance,",
        (THICKNESS,),
    ),
    Mutation(
        "pieces of one object keep their whole thickness",
        THICK,
        "if (objects[v[0]] != objects[v[split]]) return 1;",
        "if (objects[v[0]] != objects[v[split]] || v[0] >= 0) return 1;",
        (THICKNESS,),
    ),
    Mutation(
        "radii inside a triangle are those of its first corner",
        THICK,
        "if (r[1] == r[2] && r[1] == r[3]) return r[1];",
        "if (r[1] >= 0) return r[1];",
        (THICKNESS,),
    ),
    Mutation(
        "points do not meet each other",
        NEAR,
        "edges(s.points, s.points, s.point_point) && edges",
        "edges",
        (f"{POINTS}::test_pairs_of_many_points_are_all_that_are_near",),
    ),
    Mutation(
        "classes that do not meet are found",
        NEAR,
        "if (!scene.may_meet(first[0], second[0])) return;",
        "if (!scene.may_meet(first[0], first[0])) return;",
        ("tests/contact/test_contact_classes.py",),
    ),
    Mutation(
        "friction's potential with half its cubic term",
        FRICTION,
        "y * share * (1 - share / 3)",
        "y * share * (1 - share / 6)",
        SLIDING,
    ),
    Mutation(
        "friction falls to the kinetic coefficient without the integral of mu f1",
        FRICTION,
        "q**4 * (2.5 - q * (3 - q))",
        "q**3 * (10 - q * (15 - 6 * q)) * q",
        SLIDING,
    ),
    Mutation(
        "friction falls from rest on",
        FRICTION,
        "slip.norm() / width - 1 / (KINETIC_FROM - 1)",
        "slip.norm() / width",
        (f"{SLIPS}::test_all_static_friction_is_there_before_it_falls",),
    ),
    Mutation(
        "friction of the sum of both ways instead of their difference",
        FRICTION,
        "kind.tangents(lagged).T * (way.T * kind.weights(lagged))",
        "kind.tangents(lagged).T * (way.T * kind.weights(lagged).abs())",
        ("tests/contact/test_friction_pairs.py::test_friction_of_pairs",),
    ),
    Mutation(
        "normal forces of friction without the mollifier",
        FRICTION,
        "return pairs.mollified(-2 * distance * (pairs.weight * slope), lagged)",
        "return -2 * distance * (pairs.weight * slope)",
        (f"{RUBBING}::test_normal_forces_are_those_of_the_barrier",),
    ),
    Mutation(
        "slips count from where friction was lagged",
        FRICTION,
        'way = x - pairs.corners("previous_positions", self._previous)',
        'way = x - pairs.corners("previous_positions", self._lagged)',
        (f"{RUBBING}::test_slips_count_from_the_positions_before_the_step",),
    ),
    Mutation(
        "pairs without friction are in it",
        FRICTION,
        "has_friction = self._coefficients.value > 0",
        "has_friction = self._coefficients.value >= 0",
        (f"{RUBBING}::test_only_pairs_with_friction_are_in_it",),
    ),
    Mutation(
        "way and normal of a half-space are one matrix",
        FRICTION,
        "slip = slip_of(kind, way.block(0, 0, kind.arity, 3), lagged)",
        "slip = slip_of(kind, way, lagged)",
        (f"{RUBBING}::test_hessians_are_projected_where_they_are_2x2",),
    ),
    Mutation(
        "friction is lagged at the positions before the step",
        "yasps/contact/barrier_contact.py",
        "            self.friction.start_step(before)\n            self.lag()",
        "            self.friction.start_step(before)",
        (f"{RUBBING}::test_slips_count_from_the_positions_before_the_step",),
    ),
    Mutation(
        "a failed step keeps its lag",
        "yasps/contact/barrier_contact.py",
        "            self.friction.load(past.lag)",
        "            pass",
        (f"{STEPS}::test_a_step_that_fails_leaves_the_lag_of_the_one_before",),
    ),
    Mutation(
        "friction counts as settled after one pass",
        "yasps/stepping/time_stepper.py",
        "again.iterations == 1:",
        "again.iterations >= 1:",
        (f"{STEPS}::test_a_cube_slides_to_rest", f"{STEPS}::test_friction_that_does_not_settle_is_said"),
    ),
    Mutation(
        "forces of the old lag say that friction has settled",
        "yasps/stepping/time_stepper.py",
        "return left <= min(",
        "return True or left <= min(",
        (f"{STEPS}::test_forces_say_when_friction_has_settled",),
    ),
    Mutation(
        "closest points of a meeting are those of other corners",
        "runtime/collision/meetings.cpp",
        "g[2] = dot(cross(offset, last), normal) / square(normal);",
        "g[2] = dot(cross(last, offset), normal) / square(normal);",
        AHEAD,
    ),
    Mutation(
        "what meets by half-spaces is not looked for",
        "yasps/contact/half_spaces.py",
        "meets = self._gaps(end, plane) < KEPT * gaps",
        "meets = self._gaps(end, plane) < -KEPT * gaps",
        (f"{LOOK}::test_constraints_keep_what_falls_out_of_the_others_and_half_spaces",),
    ),
    Mutation(
        "constraints forget the radii",
        "yasps/contact/look_ahead.py",
        "kept = found.offsets[sure] + KEPT",
        "kept = KEPT",
        (f"{LOOK}::test_constraints_keep_what_falls_out_of_the_others_and_half_spaces",),
    ),
    Mutation(
        "lanes beyond the last pair are measured, too",
        PAIRS,
        "near_lanes<kSplit>(ask, pack) & ((1U << lanes) - 1);",
        "near_lanes<kSplit>(ask, pack);",
        POTENTIAL,
    ),
    Mutation(
        "a pair is left out by a distance that is not sure",
        PAIRS,
        "closest.squared)) & closest.sure);",
        "closest.squared)));",
        (f"{MANY}::test_a_normal_that_is_mostly_rounding_hides_no_pair",),
    ),
    Mutation(
        "pairs near the reach are left out",
        PAIRS,
        "far * far * (1 + 1e-9)",
        "far * far * 0.9",
        POTENTIAL,
    ),
    Mutation(
        "pairs beyond the line of their middles are measured from the first lane on",
        PAIRS,
        "near_count += within >> l & 1;",
        "near_count += within >> (l ^ 1) & 1;",
        ALONE,
    ),
    Mutation(
        "pairs are left out without their radii",
        PAIRS,
        "most_radii<kSplit>(pack.radius) + constant<Eight>(ask.reach);",
        "constant<Eight>(ask.reach);",
        (THICKNESS,),
    ),
    Mutation(
        "thickness is whole for pairs that are near at rest",
        PAIRS,
        "apart_at_rest >> l & 1 ? 1 : thickness.share(v, kSplit, ask.rest);",
        "1;",
        (THICKNESS,),
    ),
    Mutation(
        "nearly parallel edges are as good as others",
        PACKS,
        "closest.sure = ~bits_of(between) | bits_of(less(u_length * v_length * kSlanted, size));",
        "closest.sure = ~0U;",
        ("tests/runtime/collision/test_pair_distance.py::test_edges_at_every_angle",),
    ),
    Mutation(
        "an end of an edge is nearest although its inside is",
        PACKS,
        "const auto begun = less(zero, along), ended = ~less(along, length), between = begun & ~ended;",
        "const auto begun = less(zero, along), ended = ~less(along * 2.0, length), between = begun & ~ended;",
        ORDINARY,
    ),
    Mutation(
        "sides are nearest to what is inside of them",
        PACKS,
        "const auto outwards = ~less(dot(normal, across[k]), zero);",
        "const auto outwards = less(dot(normal, across[k]), zero);",
        ORDINARY,
    ),
    Mutation(
        "what is apart at the start is free",
        WAYS,
        "after[c] = before[c] + dot(closest.way, move[c]);",
        "after[c] = before[c];",
        FIRST,
    ),
    Mutation(
        "the first pairs bound the step",
        "runtime/collision/step_bound.cpp",
        "for (long begin = 0, most = kFirstRound; begin < total && *step >= 0;",
        "for (long begin = 0, most = kFirstRound; begin < 1 && *step >= 0;",
        FIRST,
    ),
    Mutation(
        "what is found lies in the order of the threads",
        "runtime/collision/chunks.h",
        "spans_[chunk].place = place;",
        "spans_[chunk].place = spans_[chunk].thread > 0 ? spans_[chunk].begin + lists_[0].count : spans_[chunk].begin;",
        THREADS,
    ),
    Mutation(
        "entries are not sorted in their buckets",
        PAIRS,
        "    std::sort(entries + bucket.begin, entries + bucket.end, before);",
        "",
        (f"{GEOMETRY}::test_rows_are_sorted_unique_and_independent_of_triangle_order",),
    ),
)
