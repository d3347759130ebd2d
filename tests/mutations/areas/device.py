"""Device code, run on the host in a device's place (tests/helpers/cuda_on_host.py)."""

from __future__ import annotations

from mutation import Mutation

DEVICES = ("tests/properties/test_scenes.py::test_kernels_of_devices",)
LAYERS = ("tests/properties/test_scenes.py::test_layers_of_layers_on_devices",)
MATRIX = "tests/runtime/matrix/cuda/test_block_matrix.py"
POSITIONS = (f"{MATRIX}::test_structure_and_positions_are_those_of_the_cpu",)
PRODUCT = ("tests/runtime/matrix/cuda/test_product.py",)
SOLVER = "tests/runtime/solvers/cuda/test_pcg.py"
SOLVES = (f"{SOLVER}::test_solves_as_the_cpu_does",)
GENERAL = ("tests/runtime/projection/cuda/test_projection.py::test_agrees_with_numpy_and_the_cpu",)
ISOTROPIC = ("tests/runtime/projection/cuda/test_isotropic.py::test_isotropic",)
NOT_FINITE = ("tests/backend/cpp/test_not_finite.py::test_on_a_device",)
STRUCTURE, PCG, MULTIPLY = (
    "runtime/matrix/cuda/structure.cu",
    "runtime/solvers/cuda/pcg.cu",
    "runtime/matrix/cuda/multiply.cu",
)
GATHER, SHARED = "runtime/matrix/cuda/gathered_multiply.cu", "runtime/core/cuda/grid.cuh"

MUTATIONS = (
    Mutation(
        "blocks of a slot with itself are expanded from both sides",
        "backend/cuda/expand.py",
        'begin = "s" if other is one else "0"',
        'begin = "0"',
        DEVICES,
    ),
    Mutation(
        "two slots that are the same unknowns add a block once",
        "backend/cuda/preludes/kernel.cuh",
        "both ? b[r * C + c] + b[c % R * C + r % C] : b[r * C + c]",
        "b[r * C + c]",
        DEVICES,
    ),
    Mutation(
        "merged slots add an entry of the diagonal once",
        "backend/codegen/preludes/merge.h",
        "r != c && to[r] == to[c] ? 2.0 * value : value",
        "value",
        DEVICES,
    ),
    Mutation(
        "structure: transposed blocks are flagged the wrong way round",
        STRUCTURE,
        "(i > j ? kYaspsTurned : 0u) | (i == j",
        "(i < j ? kYaspsTurned : 0u) | (i == j",
        POSITIONS,
    ),
    Mutation(
        "structure: the second slot of a pair counts from 0",
        STRUCTURE,
        "        b += a;\n",
        "",
        POSITIONS,
    ),
    Mutation(
        "structure: lower and upper triangle exchanged",
        STRUCTURE,
        "const long row = i < j ? first : second, col = i < j ? second : first;",
        "const long row = i < j ? second : first, col = i < j ? first : second;",
        POSITIONS,
    ),
    Mutation(
        "structure: flags make different blocks",
        STRUCTURE,
        "((keys[e] ^ keys[e - 1]) & kKeyMask) != 0;",
        "(keys[e] ^ keys[e - 1]) != 0;",
        POSITIONS,
    ),
    Mutation(
        "structure: the diagonal block is not noted",
        STRUCTURE,
        "if (row == col) diagonal[row] = in_values;",
        "if (row < col && row > col) diagonal[row] = in_values;",
        POSITIONS,
    ),
    Mutation(
        "structure: of the contributions to a block the last is left out",
        STRUCTURE,
        "const long end = first_entry[block + 1];",
        "const long end = first_entry[block + 1] - 1;",
        (f"{MATRIX}::test_deterministic_sums_go_in_the_order_of_the_sources",),
    ),
    Mutation(
        "structure: a wrong index is not complained about",
        STRUCTURE,
        "if (same_slot && first == -2) complain(bad, s);",
        "",
        (f"{MATRIX}::test_wrong_index_is_refused_and_changes_nothing",),
    ),
    Mutation(
        "gradient: contributions of a dof block begin one too late",
        STRUCTURE,
        "for (long p = ranges[2 * start]; p < end; p += q)",
        "for (long p = ranges[2 * start] + q; p < end; p += q)",
        ("tests/runtime/assembly/cuda/test_gradient.py::test_sums_go_in_the_order_of_the_sources",),
    ),
    Mutation(
        "pcg: beta upside down",
        PCG,
        "const double mix = squared / s.squared",
        "const double mix = s.squared / squared",
        SOLVES,
    ),
    Mutation(
        "pcg: the residual grows",
        PCG,
        "const double residual = r[i] - step * q[i];",
        "const double residual = r[i] + step * q[i];",
        SOLVES,
    ),
    Mutation(
        "pcg: the first residual's norm is that of g",
        PCG,
        "const double squared = sum_of(partial + 3 * count, count);",
        "const double squared = sum_of(partial + 2 * count, count);",
        (f"{SOLVER}::test_starts_where_it_ended",),
    ),
    Mutation(
        "pcg: negative curvature is not noticed",
        PCG,
        "const bool usable = is_finite(curvature) && curvature > 0;",
        "const bool usable = is_finite(curvature);",
        (f"{SOLVER}::test_indefinite_matrix_with_definite_diagonal_blocks",),
    ),
    Mutation(
        "sums: lanes next to each other are not added",
        SHARED,
        "for (int by = 16; by > 0; by /= 2) value += __shfl_down_sync",
        "for (int by = 16; by > 1; by /= 2) value += __shfl_down_sync",
        SOLVES,
    ),
    Mutation(
        "sums: lanes take from themselves",
        SHARED,
        "value += __shfl_down_sync(~0u, value, by);",
        "value += __shfl_down_sync(~0u, value, 0);",
        SOLVES,
    ),
    Mutation(
        "sums: warps do not wait for each other",
        SHARED,
        "    __syncthreads();\n    double total = 0;",
        "    double total = 0;",
        SOLVES,
    ),
    Mutation(
        "sums: what the last blocks left is not added",
        SHARED,
        "for (long i = threadIdx.x; i < count; i += kThreads) sum += partial[i];",
        "if (threadIdx.x < count) sum += partial[threadIdx.x];",
        (f"{SOLVER}::test_sums_of_many_blocks",),
    ),
    Mutation(
        "sums: the stride of a grid is that of a block",
        "runtime/assembly/cuda/sum.cu",
        "i < count; i += threads_of_grid()) sum += values[i];",
        "i < count; i += blockDim.x) sum += values[i];",
        ("tests/runtime/device/test_small_kernels.py::test_sums_of_any_length",),
    ),
    Mutation(
        "preconditioner: a sign in the inverse of the factor",
        "runtime/solvers/inverse.h",
        "a[i * q + j] = -sum * a[i * q + i];",
        "a[i * q + j] = sum * a[i * q + i];",
        (f"{SOLVER}::test_block_diagonal_system_takes_one_iteration",),
    ),
    Mutation(
        "preconditioner: the upper triangle is not that of the inverse",
        "runtime/solvers/cuda/preconditioner.cu",
        "for (int j = 0; j < i; ++j) a[j * q + i] = a[i * q + j];",
        "for (int j = 0; j < i; ++j) a[i * q + j] = a[j * q + i];",
        (f"{SOLVER}::test_block_diagonal_system_takes_one_iteration",),
    ),
    Mutation(
        "preconditioner: the number of a bad block is taken for its first scalar",
        "runtime/solvers/cuda/preconditioner.cu",
        "(long long)(4 * place.first + status)",
        "(long long)(4 * block + status)",
        (f"{SOLVER}::test_bad_diagonal_block_is_named",),
    ),
    Mutation(
        "product: diagonal blocks count twice",
        MULTIPLY,
        "    if (row != col) {\n",
        "    if (row >= 0) {\n",
        PRODUCT,
    ),
    Mutation(
        "product: rows of a warp are summed from the wrong lane",
        MULTIPLY,
        "const int before = __shfl_up_sync(~0u, row, 1);",
        "const int before = __shfl_down_sync(~0u, row, 1);",
        PRODUCT,
    ),
    Mutation(
        "product: the last lanes add themselves",
        MULTIPLY,
        "const bool same = lane + by < 32 && further == row && row >= 0;",
        "const bool same = further == row && row >= 0;",
        PRODUCT,
    ),
    Mutation(
        "product: lanes do not wait for the block they read",
        MULTIPLY,
        "        __syncwarp();\n        double product = 0;",
        "        double product = 0;",
        PRODUCT,
    ),
    Mutation(
        "product: every warp takes the first list",
        MULTIPLY,
        "        chunk -= chunks;\n",
        "",
        PRODUCT,
    ),
    Mutation(
        "gathered product: the last entry of a row is left out",
        GATHER,
        "bounds[none + key] = i + 1;",
        "bounds[none + key] = i;",
        PRODUCT,
    ),
    Mutation(
        "gathered product: half of a team is not added",
        GATHER,
        "for (int by = kTeam / 2; by > 0; by /= 2) {",
        "for (int by = kTeam / 4; by > 0; by /= 2) {",
        PRODUCT,
    ),
    Mutation(
        "gathered product: transposed blocks are read as they are",
        GATHER,
        "const int down = transposed ? 1 : length, along = transposed ? Q : 1;",
        "const int down = length, along = 1;",
        PRODUCT,
    ),
    Mutation(
        "gathered product: teams do not wait for each other",
        GATHER,
        "        parts[team][lane] = sum;\n        __syncthreads();\n",
        "        parts[team][lane] = sum;\n",
        PRODUCT,
    ),
    Mutation(
        "projection: abs and clamp exchanged",
        "runtime/projection/cuda/projection.cu",
        "e[count] = d[i] * (flip ? -2.0 : -1.0);",
        "e[count] = d[i] * (flip ? -1.0 : -2.0);",
        GENERAL,
    ),
    Mutation(
        "projection: the reflections' product lacks a sign",
        "runtime/projection/cuda/projection.cu",
        "sum *= -scale;",
        "sum *= scale;",
        GENERAL,
    ),
    Mutation(
        "projection: the last pivot is not looked at",
        "runtime/projection/cuda/projection.cu",
        "if (!(pivot > 0.0)) return false;",
        "if (!(pivot > 0.0) && i + 1 < n) return false;",
        GENERAL,
    ),
    Mutation(
        "projection by singular values: flip and twist exchanged",
        "runtime/projection/cuda/isotropic.cu",
        "(across < 0) == smaller ?",
        "(across < 0) != smaller ?",
        ISOTROPIC,
    ),
    Mutation(
        "projection by singular values: eigenvectors of pairs are not of unit length",
        "runtime/projection/cuda/isotropic.cu",
        "mode.squared_norm = 2.0;",
        "mode.squared_norm = 1.0;",
        ISOTROPIC,
    ),
    Mutation(
        "singular values: the third column of U is the second",
        "runtime/projection/three_by_three.h",
        "u.c[2] = cross(u.c[0], u.c[1]);",
        "u.c[2] = u.c[1];",
        ISOTROPIC,
    ),
    Mutation(
        "rotations are no rotations",
        "runtime/projection/three_by_three.h",
        "q = q * r.cosine - old * r.sine;",
        "q = q * r.cosine + old * r.sine;",
        ISOTROPIC,
    ),
    Mutation(
        "indices from others: the number of instances is a valid one",
        "runtime/device/cuda/check_indices.cu",
        "indices[k] >= most)",
        "indices[k] > most)",
        ("tests/runtime/device/test_small_kernels.py::test_indices_from_others",),
    ),
    Mutation(
        "kernels: the last entry may be infinite",
        "backend/cuda/preludes/kernel.cuh",
        "for (int k = 0; k < N; ++k) zero += x[k] * 0.0;",
        "for (int k = 0; k + 1 < N; ++k) zero += x[k] * 0.0;",
        NOT_FINITE,
    ),
    Mutation(
        "kernels: any instance that is not finite is named, not the first",
        "backend/cuda/preludes/kernel.cuh",
        "atomicMin(sink.outcome, (unsigned long long)i);",
        "*sink.outcome = (unsigned long long)i;",
        NOT_FINITE,
    ),
    Mutation(
        "kernels: an expanded block that is both goes one way only",
        "backend/cuda/preludes/kernel.cuh",
        "if (where & (kYaspsTurned | kYaspsTwice)) add_to(to + c * rows + r, row[c]);",
        "if (where & kYaspsTurned) add_to(to + c * rows + r, row[c]);",
        DEVICES,
    ),
    Mutation(
        "kernels: every instance adds to the first one's place in the gradient",
        "backend/cuda/preludes/kernel.cuh",
        "sink.gradient_at[i * capacity + p]",
        "sink.gradient_at[p]",
        (
            "tests/frontend/execution/test_cuda_scene.py::test_deterministic_scenes_give_the_same_bits_in_any_order_of_threads",
        ),
    ),
    Mutation(
        "kernels: instances behind the last thread are not visited",
        "backend/cuda/derivative.py",
        "for (long i = thread; i < count; i += ",
        "for (long i = thread; i < count; i += count + ",
        ("tests/frontend/execution/test_cuda_scene.py::test_threads_with_a_workspace_take_several_instances",),
    ),
    Mutation(
        "dense: the width of merged leaves lacks the last",
        "backend/codegen/preludes/merge.h",
        "    start[leaves] = width;\n",
        "    start[leaves] = leaves ? start[leaves - 1] : 0;\n",
        LAYERS,
    ),
)
