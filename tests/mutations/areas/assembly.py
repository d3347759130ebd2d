"""Assembly on the processor: pieces, tiles, private memory, sums."""

from __future__ import annotations

from mutation import Mutation

ASSEMBLY = "tests/runtime/assembly/test_assembler.py"
DENSE = (f"{ASSEMBLY}::test_assembles_the_dense_sum",)
SHAPES = (f"{ASSEMBLY}::test_tiles_with_blocks_of_several_shapes",)
MANY = (f"{ASSEMBLY}::test_many_tiles",)
CHANGES = (f"{ASSEMBLY}::test_what_pieces_touch_is_found_again_when_indices_change",)
BORDER = ("tests/runtime/assembly/test_tiles.py",)
CODE = "runtime/assembly/assembly.cpp"

MUTATIONS = (
    Mutation(
        "a gradient block across the border of two tiles is lost",
        CODE,
        "const long last = (offset + block_size_at[offset] - 1) >> kYaspsTileBits;",
        "const long last = offset >> kYaspsTileBits;",
        BORDER,
    ),
    Mutation(
        "tiles are marked for the first chunk of each piece only",
        CODE,
        "for (long c = p; c < chunks; c += pieces) {",
        "for (long c = p; c < pieces; c += pieces) {",
        BORDER,
    ),
    Mutation(
        "marks of blocks are one tile too far",
        CODE,
        "marks[task.position[k] >> (kYaspsTileBits + kYaspsFlagBits)] = 1;",
        "marks[task.position[k] >> (kYaspsTileBits + 3)] = 1;",
        MANY,
    ),
    Mutation(
        "the first block of a tile is the last of the one before",
        CODE,
        "const long block = (inside + size - 1) / size;",
        "const long block = inside / size;",
        SHAPES,
    ),
    Mutation(
        "private tiles lie on each other",
        CODE,
        "*own.next_private += own.private_size;",
        "*own.next_private += 0;",
        MANY,
    ),
    Mutation(
        "a tile is not emptied when it is opened",
        CODE,
        "    empty(values, blocks_of_tile(*own.part->structure, tile));\n    return own.tiles[tile] = values;",
        "    return own.tiles[tile] = values;",
        DENSE,
    ),
    Mutation(
        "a tile is opened again for every block",
        CODE,
        "return own.tiles[tile] = values;",
        "return values;",
        DENSE,
    ),
    Mutation(
        "the second piece's gradient is not added",
        CODE,
        "for (long p = 1; p < cut.pieces; ++p) {",
        "for (long p = 2; p < cut.pieces; ++p) {",
        DENSE,
    ),
    Mutation(
        "private gradients are not emptied for the next assembly",
        CODE,
        "        store(from + i, d4{});",
        "",
        DENSE,
    ),
    Mutation(
        "the last doubles of a gradient's tile are not moved",
        CODE,
        "for (; i < count; ++i) {\n        to[i] = kAdd",
        "for (; i + 1 < count; ++i) {\n        to[i] = kAdd",
        DENSE,
    ),
    Mutation(
        "a tile that the first piece touches is not emptied if others touch it",
        CODE,
        "only_copies = only_copies && !w.touched[tile];",
        "",
        DENSE,
    ),
    Mutation(
        "the owner's tile is added to itself",
        CODE,
        "if (from == nullptr || from == values) continue;",
        "if (from == nullptr) continue;",
        DENSE,
    ),
    Mutation(
        "a tile that nobody asked for keeps what was there",
        CODE,
        "if (is_empty) empty(values, range);",
        "",
        SHAPES,
    ),
    Mutation(
        "a piece does its first chunk only",
        CODE,
        "c < cut.chunks && *first_bad == -1; c += cut.pieces)",
        "c < cut.pieces && *first_bad == -1; c += cut.pieces)",
        DENSE,
    ),
    Mutation(
        "of several bad instances the last is named",
        CODE,
        "bad < tasks[k].first_bad)",
        "bad > tasks[k].first_bad)",
        (f"{ASSEMBLY}::test_first_bad_instance_is_reported",),
    ),
    Mutation(
        "projected instances of one piece are counted only",
        CODE,
        "tasks[k].projected += w->projected",
        "tasks[k].projected = w->projected",
        DENSE,
    ),
    Mutation(
        "two pieces own the same tile",
        CODE,
        "if (w.owner.data[tile] < 0)\n                w.owner.data[tile] = p;",
        "if (w.owner.data[tile] < p)\n                w.owner.data[tile] = p;",
        CHANGES,
    ),
    Mutation(
        "stale marks: new placement indices are not noticed",
        "runtime/assembly/assembler.py",
        "last.kappa is call.kappa",
        "last.kappa.shape == call.kappa.shape",
        (f"{BORDER[0]}::test_new_indices_of_a_gradient_alone_are_noticed",),
    ),
    Mutation(
        "stale marks: new places of the same indices are not noticed",
        "runtime/assembly/assembler.py",
        "and last.position is position",
        "",
        (f"{ASSEMBLY}::test_new_places_for_the_same_indices_are_noticed",),
    ),
    Mutation(
        "every energy is clamped, whatever was asked for",
        "runtime/assembly/assembler.py",
        "int(call.mode),",
        "0,",
        DENSE,
    ),
    Mutation(
        "the last partial pack of instances is not run",
        "runtime/core/runtime.h",
        "const long packs = (instances + kYaspsLanes - 1) / kYaspsLanes;",
        "const long packs = instances / kYaspsLanes;",
        DENSE,
    ),
    Mutation(
        "sums: what rounding took away is not given back",
        "runtime/core/evaluation.cpp",
        "fabs(sum) < INFINITY ? sum + lost : sum;",
        "sum;",
        (f"{ASSEMBLY}::test_sum_is_exact_to_rounding",),
    ),
    Mutation(
        "sums: the error of an addition has the wrong sign",
        "runtime/core/evaluation.cpp",
        "+ (x - other);",
        "- (x - other);",
        (f"{ASSEMBLY}::test_sum_is_exact_to_rounding",),
    ),
)
