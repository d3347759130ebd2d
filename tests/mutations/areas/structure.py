"""The block-sparse matrix of the processor: which blocks there are, where local blocks go, products."""

from __future__ import annotations

from mutation import Mutation

MATRIX = "tests/runtime/matrix/test_block_matrix.py"
SUM = (f"{MATRIX}::test_assembled_matrix_is_the_dense_sum",)
ORDER = (f"{MATRIX}::test_groups_hold_each_block_once_in_order",)
PRODUCT = (f"{MATRIX}::test_product_of_every_shape",)
FAR = (f"{MATRIX}::test_product_where_few_rows_reach_far",)
LARGE = "tests/runtime/matrix/test_large_sizes.py"
REORDERED = ("tests/runtime/matrix/test_reordering.py",)
CODE, MULTIPLY = "runtime/matrix/block_matrix.cpp", "runtime/matrix/multiply.cpp"

MUTATIONS = (
    Mutation(
        "two slots that are one block have no flag",
        CODE,
        "(a != b && i_block == j_block ? kYaspsTwice : 0u)",
        "(a < 0 && i_block == j_block ? kYaspsTwice : 0u)",
        SUM,
    ),
    Mutation(
        "the flag of transposed blocks is that of the others",
        CODE,
        "(i_block > j_block ? kYaspsTurned : 0u)",
        "(i_block < j_block ? kYaspsTurned : 0u)",
        SUM,
    ),
    Mutation(
        "the lower triangle is stored",
        CODE,
        "const int row = std::min(i_block, j_block), col = std::max(i_block, j_block);",
        "const int row = std::max(i_block, j_block), col = std::min(i_block, j_block);",
        SUM,
    ),
    Mutation(
        "prefix sums of a row's entries begin after them",
        CODE,
        "            s.next_entry[t * rows + row] = total;\n            total += s.counts[t * rows + row];",
        "            total += s.counts[t * rows + row];\n            s.next_entry[t * rows + row] = total;",
        SUM,
    ),
    Mutation(
        "an offset inside a dof block is taken for its start",
        CODE,
        "offset > layout.scalars || layout.block_at[offset - 1] < 0)",
        "offset > layout.scalars)",
        (f"{MATRIX}::test_wrong_index_is_refused_and_changes_nothing",),
    ),
    Mutation(
        "groups of blocks that are not square overlap",
        CODE,
        "value += group.count * group.rows * group.cols;",
        "value += group.count * group.rows * group.rows;",
        SUM,
    ),
    Mutation(
        "the diagonal block is not noted",
        CODE,
        "if (col == row) s.diagonal[row] = offset;",
        "if (col < row) s.diagonal[row] = offset;",
        ("tests/runtime/solvers/test_pcg.py::test_solves_sum_of_parts",),
    ),
    Mutation(
        "a block's column in padded vectors is its row's",
        CODE,
        "s.padded_col[block] = layout.padded_start[col];",
        "s.padded_col[block] = layout.padded_start[row];",
        PRODUCT,
    ),
    Mutation(
        "columns of a row are not sorted",
        CODE,
        "    std::sort(unique, unique + count);",
        "",
        ORDER,
    ),
    Mutation(
        "a diagonal block that an energy touches comes twice",
        CODE,
        "        marker[row] = row;\n",
        "",
        ORDER,
    ),
    Mutation(
        "a row's reach ends where its last column begins",
        CODE,
        "layout.padded_start[share.last_col + 1]",
        "layout.padded_start[share.last_col]",
        (
            "tests/runtime/assembly/test_determinism.py::test_product",
            f"{MATRIX}::test_assembled_matrix_is_the_dense_sum",
        ),
    ),
    Mutation(
        "what a row writes beyond a stretch is not noted",
        MULTIPLY,
        "stretch <= (cols[b] + last) / kStretch;",
        "stretch <= cols[b] / kStretch;",
        FAR,
    ),
    Mutation(
        "what rows write behind them is not emptied first",
        "runtime/solvers/pcg.cpp",
        "[&](long begin, long end) { clear(p.product, begin, end); }",
        "[](long, long) {}",
        FAR,
    ),
    Mutation(
        "the order of dof blocks is not followed",
        CODE,
        "order != nullptr ? order[given] : static_cast<int>(given)",
        "static_cast<int>(given)",
        REORDERED,
    ),
    Mutation(
        "product: a transposed block has the wrong sign",
        MULTIPLY,
        "if (kTwice) transposed[v] += entries * xi[i];",
        "if (kTwice) transposed[v] -= entries * xi[i];",
        PRODUCT,
    ),
    Mutation(
        "product: the last columns of a block are dropped",
        MULTIPLY,
        "for (int lane = 1; lane < C % 4; ++lane)",
        "for (int lane = 1; lane + 1 < C % 4; ++lane)",
        PRODUCT,
    ),
    Mutation(
        "product: 1x1 blocks are not applied transposed",
        MULTIPLY,
        "            y[cols[b]] += blocks[b] * xi;\n",
        "",
        PRODUCT,
    ),
    Mutation(
        "product: diagonal blocks of any shape count twice",
        MULTIPLY,
        "const bool diagonal = cols[b] == run->row;",
        "const bool diagonal = false;",
        PRODUCT,
    ),
    Mutation(
        "product: a diagonal block is not recognised",
        MULTIPLY,
        "if (R == C && cols[b] == run->row) {",
        "if (R > C && cols[b] == run->row) {",
        PRODUCT,
    ),
    Mutation(
        "local blocks are counted as slots are",
        "runtime/matrix/block_matrix.py",
        "count = sum(n * c * (c + 1) // 2 for n, c in",
        "count = sum(n * c for n, c in",
        (f"{LARGE}::test_local_blocks_of_all_energies_are_counted",),
    ),
    Mutation(
        "the last pair that can be numbered is refused",
        "runtime/collision/surface_pairs.py",
        "    if count > MOST_PAIRS:",
        "    if count >= MOST_PAIRS:",
        (f"{LARGE}::test_pairs_of_surface_pieces_are_counted",),
    ),
)
