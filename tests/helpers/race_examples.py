"""Small kernels with and without a race, for tests of what finds races."""

from __future__ import annotations

HEAD = """
struct State { double values[3]; long count; };
__device__ __forceinline__ long here() { return blockIdx.x * (long)blockDim.x + threadIdx.x; }
"""


def kernel(name: str, body: str) -> str:
    """Of 64 threads a block; `a` is shared memory, t the thread's number and i that in the grid."""
    return f"""
extern "C" __global__ void {name}(double* out, long n) {{
    const int t = threadIdx.x;
    const long i = here();
    {body}
}}
"""


SHARED = "__shared__ double a[64]; a[t] = t;"

# Name, what it does, whether that is a race. Threads wait for each other in all of them, or in none.
WAITING = [
    ("warp_in_order", f"{SHARED} __syncwarp(); out[i] = a[t ^ 1];", False),
    ("shuffle_orders_nothing", f"{SHARED} __shfl_down_sync(~0u, t, 1); out[i] = a[t ^ 1];", True),
    ("vote_orders_nothing", f"{SHARED} __any_sync(~0u, t); out[i] = a[t ^ 1];", True),
    ("warps_are_not_in_order", f"{SHARED} __syncwarp(); out[i] = a[63 - t];", True),
    ("block_in_order", f"{SHARED} __syncthreads(); out[i] = a[63 - t];", False),
    ("read_before_it_is_written_again", f"{SHARED} __syncthreads(); out[i] = a[63 - t]; a[t] = 0;", True),
    ("blocks_are_not_in_order", "if (i == 0) out[0] = 1; __syncthreads(); if (i == 64) out[1] = out[0];", True),
    ("atomic_then_read", "atomicAdd(out + blockIdx.x, 1.0); __syncthreads(); if (t == 5) out[blockIdx.x] *= 2;", False),
    ("another_warp_read", "const double x = out[0]; __syncwarp(); if (i == 0) out[0] = x;", True),
    ("all_have_read", "const double x = out[blockIdx.x]; __syncthreads(); if (t == 0) out[blockIdx.x] = x;", False),
    ("left_early", "if (t >= 32) return; out[i] = 1; __syncwarp(); out[i ^ 1] = 2;", False),
]
ALONE = [
    ("own_place", "out[i] = t;", False),
    ("own_array", "double x[4]; for (int k = 0; k < 4; ++k) x[k] = k + t; out[i] = x[t % 4];", False),
    ("all_read", "if (i > 0) out[i] = out[0];", False),
    ("all_write", "out[blockIdx.x] = 1;", True),
    ("blocks_write", "if (t == 0) out[0] = 1;", True),
    ("all_add", "atomicAdd(out, 1.0);", False),
    ("largest_and_least", "atomicMax((long long*)out, (long long)i); atomicMin((long long*)out, 3ll);", False),
    ("add_and_read", "atomicAdd(out, 1.0); if (i == 70) out[i] = out[0];", True),
    ("add_and_ldg", "if (i == 0) atomicAdd(out, 1.0); else if (i == 70) out[i] = __ldg(out);", True),
    ("add_and_write", "if (i == 0) atomicAdd(out, 1.0); else out[0] = 1;", True),
    ("half_of_a_number", "if (i == 0) out[0] = 1; if (i == 1) ((int*)out)[1] = 1;", True),
    ("both_halves", "if (i < 2) ((int*)out)[i] = 1;", False),
    ("whole_structures", "if (i > 0) *(State*)(out + 4 * i) = *(State*)out;", False),
    ("part_of_a_structure", "if (i == 0) *(State*)out = State{}; if (i == 1) out[2] = 1;", True),
    ("last_read_is_its_own", "const double x = out[n - 1]; if (i == n - 1) out[i] = x;", True),
]

# Threads follow scripts, [steps, threads]: 0 nothing, 1 __syncwarp, 2 __syncthreads, 3 a shuffle, else 4 place + kind:
# 0 reads, 1 writes, 2 adds; place - 1 is where.
FOLLOW = """
extern "C" __global__ void follow(const int* script, long steps, long threads, double* data) {
    const long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
    double sum = 0;
    for (long step = 0; step < steps; ++step) {
        const int order = script[step * threads + i];
        double* const at = data + order / 4 - 1;
        if (order == 1) __syncwarp();
        if (order == 2) __syncthreads();
        if (order == 3) sum += __shfl_down_sync(~0u, sum, 1);
        if (order < 4) continue;
        if (order % 4 == 0) sum += *at;
        if (order % 4 == 1) *at = sum;
        if (order % 4 == 2) atomicAdd(at, 1.0);
    }
}
"""
