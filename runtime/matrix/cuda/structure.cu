// The structure of the global Hessian on the device: which blocks there are and where every local block goes (paper,
// appendices A and B; block_matrix.cpp does the same on the host). And, for sums in a fixed order, where every
// contribution waits until it is added.
//
// Every local block ("entry") becomes a key (shape, row, col). Sorted, equal keys lie together, and the number of
// distinct keys before an entry is its global block. The sort is stable, so entries of one block keep their order.
// All is bound by memory. Bytes per entry, at least: keys 12 written (kappa comes from the cache), the sort 24 for each
// 8 bits of the key, heads 16, their prefix sums 16, place 20 read and 8 written to any place (a sector of 32).

#include "core/sink.h"

namespace {

// Flags of PositionInData ride in the two highest bits of a key, which are not sorted by.
const int kFlagsShift = 64 - kYaspsFlagBits;
const unsigned long long kKeyMask = (1ull << kFlagsShift) - 1;

// One energy in the table that the host sends, which ends with a row of the number of all sources.
struct Energy {
    long first_source;  // where its sources begin among those of all energies
    const int* kappa;
    long capacity;
};

// The index arrays of all energies. A source is one of their local blocks (or, for a gradient, slots).
struct Energies {
    const Energy* table;
    long count;

    __device__ long of(long source) const {
        long first = 0, end = count;
        while (end - first > 1) {
            const long middle = (first + end) / 2;
            if (table[middle].first_source <= source)
                first = middle;
            else
                end = middle;
        }
        return first;
    }
};

__device__ __forceinline__ long thread() { return blockIdx.x * (long)blockDim.x + threadIdx.x; }

// Says that this source names no dof block; the host learns of the first such source. 0: there was none.
__device__ __forceinline__ void complain(unsigned long long* bad, long source) {
    atomicMax(bad, (1ull << 32) - (unsigned long long)source);
}

// What lies at a 1-based scalar offset: class << 32 | dof block; -1 for no contribution; -2 where no dof block starts.
__device__ __forceinline__ long name_of(int offset, const long* names, long size) {
    if (offset == 0) return -1;
    if (offset < 0 || offset > size) return -2;
    return names[offset - 1];
}

__device__ __forceinline__ bool starts(const unsigned long long* keys, long e) {
    return e == 0 || ((keys[e] ^ keys[e - 1]) & kKeyMask) != 0;
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_layout(long size, const long* targets, long* names, int* block_size_at, int* block_start,
                           int* block_size) {
    // targets: end, scalars per instance, class of that size, first dof block.
    const long i = thread();
    if (i >= size) return;
    long begin = 0;
    while (i >= targets[0]) begin = targets[0], targets += 4;
    const long q = targets[1], block = targets[3] + (i - begin) / q;
    const bool at_start = (i - begin) % q == 0;
    names[i] = at_start ? targets[2] << 32 | block : -2;
    block_size_at[i] = at_start ? (int)q : 0;
    if (!at_start) return;
    block_start[block] = (int)i;
    block_size[block] = (int)q;
}

// The key of every entry: first those of the energies, then a diagonal block for each dof block where these are wanted.
// Entries without contribution get the shape after the last, so that they come last. bits: of a dof block's number.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_keys(long entries, long pairs, const void* table, long energies, const long* names, long size,
                         const int* block_start, long bits, long classes, unsigned long long* keys,
                         unsigned int* sources, unsigned long long* bad) {
    const long s = thread();
    if (s >= entries) return;
    sources[s] = (unsigned int)s;
    long first, second;
    bool same_slot = true;
    if (s >= pairs) {
        first = second = names[block_start[s - pairs]];
    } else {
        const Energies all = {(const Energy*)table, energies};
        const Energy& energy = all.table[all.of(s)];
        const unsigned int capacity = (unsigned int)energy.capacity;
        const unsigned int local = (unsigned int)(s - energy.first_source),
                           per_instance = capacity * (capacity + 1) / 2;
        const int* const kappa = energy.kappa + (long)(local / per_instance) * capacity;
        unsigned int a = 0, b = local % per_instance;  // pairs (0, 0), (0, 1), .., (1, 1), ..
        while (b >= capacity - a) b -= capacity - a++;
        b += a;
        same_slot = a == b;
        first = name_of(kappa[a], names, size);
        second = same_slot ? first : name_of(kappa[b], names, size);
        if (same_slot && first == -2) complain(bad, s);
    }
    if (first < 0 || second < 0) {
        keys[s] = (unsigned long long)(classes * classes) << 2 * bits;
        return;
    }
    const long i = (int)first, j = (int)second;
    const unsigned long long flags = (i > j ? kYaspsTurned : 0u) | (i == j && !same_slot ? kYaspsTwice : 0u);
    const long row = i < j ? first : second, col = i < j ? second : first;
    const unsigned long long shape = (unsigned long long)((row >> 32) * classes + (col >> 32));
    keys[s] =
        flags << kFlagsShift | shape << 2 * bits | (unsigned long long)(int)row << bits | (unsigned long long)(int)col;
}

// 1 where a global block begins among the sorted keys, else 0.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_heads(long entries, const unsigned long long* keys, long bits, long shapes, long* heads) {
    const long e = thread();
    if (e >= entries) return;
    const bool used = (keys[e] & kKeyMask) >> 2 * bits < (unsigned long long)shapes;
    heads[e] = used && starts(keys, e) ? 1 : 0;
}

// For every shape, and the end: the first of its entries, and how many blocks there are before it.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_groups(long entries, const unsigned long long* keys, const long* heads_before, long bits,
                           long shapes, const long* bad, long* answer) {
    const long shape = thread();
    if (shape > shapes) return;
    if (shape == 0) answer[0] = *bad;
    long first = 0, end = entries;
    while (first < end) {
        const long middle = (first + end) / 2;
        if ((keys[middle] & kKeyMask) >> 2 * bits < (unsigned long long)shape)
            first = middle + 1;
        else
            end = middle;
    }
    answer[1 + 2 * shape] = first;
    answer[2 + 2 * shape] =
        first < entries ? heads_before[first] : heads_before[entries - 1] + (starts(keys, entries - 1) ? 1 : 0);
}

// Writes the coordinates of every block, and the position of every entry of the energies.
// shapes_at: for every shape (values of a block, offset of block 0 in `values`, offset of entry 0 among contributions),
// as if all entries had this shape. Then the address of every energy's PositionInData.
// first_entry: null, or where each block's entries begin; positions then lead to a place for each contribution.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_place(long entries, long pairs, const unsigned long long* keys, const unsigned int* sources,
                          const long* heads_before, const void* table, long energies, const long* shapes_at, long bits,
                          long shapes, long used, long blocks, const int* block_start, int* rows, int* cols,
                          long* diagonal, unsigned int* first_entry) {
    const long e = thread();
    if (e >= entries) return;
    if (e == 0 && first_entry) first_entry[blocks] = (unsigned int)used;
    const unsigned long long key = keys[e];
    const long source = sources[e];
    long position = -1;
    if (e < used) {
        const bool head = starts(keys, e);
        const long block = heads_before[e] + (head ? 1 : 0) - 1;
        const long* const shape = shapes_at + 3 * (long)((key & kKeyMask) >> 2 * bits);
        const long in_values = shape[1] + block * shape[0];
        if (head) {
            const long mask = (1l << bits) - 1, row = (long)(key >> bits) & mask, col = (long)key & mask;
            rows[block] = block_start[row];
            cols[block] = block_start[col];
            if (row == col) diagonal[row] = in_values;
            if (first_entry) first_entry[block] = (unsigned int)e;
        }
        position = (first_entry ? shape[2] + e * shape[0] : in_values) << kYaspsFlagBits | (long)(key >> kFlagsShift);
    }
    if (source >= pairs) return;
    const Energies all = {(const Energy*)table, energies};
    const long energy = all.of(source);
    ((long*)shapes_at[3 * shapes + energy])[source - all.table[energy].first_source] = position;
}

extern "C" __global__ void __launch_bounds__(kYaspsThreads) yasps_structure_fill(long count, long value, long* out) {
    const long i = thread();
    if (i < count) out[i] = value;
}

// Adds the contributions to the blocks of one shape, one after another. Floor: each contribution is read once; the
// threads of a block read neighbours. A block with very many contributions is the work of few threads.
// contributions: where entry 0 would be if all had this shape.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_structure_sum(long count, long block_values, const unsigned int* first_entry, const double* contributions,
                        double* values) {
    const long v = thread();
    if (v >= count) return;
    const long block = v / block_values, k = v % block_values;
    const long end = first_entry[block + 1];
    double sum = 0.0;
#pragma unroll 8
    for (long e = first_entry[block]; e < end; ++e) sum += contributions[e * block_values + k];
    values[v] = sum;
}

// The key of a slot is the scalar offset of its dof block, `size` without contribution.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_gradient_keys(long slots, const void* table, long energies, const int* block_size_at, long size,
                        unsigned long long* keys, unsigned int* sources, unsigned long long* bad) {
    const long s = thread();
    if (s >= slots) return;
    const Energies all = {(const Energy*)table, energies};
    const Energy& energy = all.table[all.of(s)];
    const int offset = energy.kappa[s - energy.first_source];
    const bool good = offset > 0 && offset <= size && block_size_at[offset - 1] > 0;
    if (!good && offset != 0) complain(bad, s);
    keys[s] = (unsigned long long)(good ? offset - 1 : size);
    sources[s] = (unsigned int)s;
}

// How many scalars every sorted slot contributes to.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_gradient_lengths(long slots, const unsigned long long* keys, const int* block_size_at, long size,
                           long* lengths) {
    const long e = thread();
    if (e >= slots) return;
    const long offset = (long)keys[e];
    lengths[e] = offset < size ? block_size_at[offset] : 0;
}

extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_gradient_total(long slots, const unsigned long long* keys, const int* block_size_at, long size,
                         const long* lengths_before, const long* bad, long* answer) {
    if (thread() != 0) return;
    const long offset = (long)keys[slots - 1];
    answer[0] = *bad;
    answer[1] = lengths_before[slots - 1] + (offset < size ? block_size_at[offset] : 0);
}

// ranges: at the offset of each dof block, where its contributions begin and end; zero before.
// positions_at: the address of every energy's positions.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_gradient_place(long slots, const unsigned long long* keys, const unsigned int* sources,
                         const long* lengths_before, const void* table, long energies, const long* positions_at,
                         const int* block_size_at, long size, long* ranges) {
    const long e = thread();
    if (e >= slots) return;
    const long offset = (long)keys[e], source = sources[e];
    const bool used = offset < size;
    if (used) {
        if (e == 0 || keys[e] != keys[e - 1]) ranges[2 * offset] = lengths_before[e];
        if (e + 1 == slots || keys[e] != keys[e + 1])
            ranges[2 * offset + 1] = lengths_before[e] + block_size_at[offset];
    }
    const Energies all = {(const Energy*)table, energies};
    const long energy = all.of(source);
    ((long*)positions_at[energy])[source - all.table[energy].first_source] = used ? lengths_before[e] : -1;
}

// Adds the contributions to every scalar, one after another.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_gradient_sum(long size, const int* block_size_at, const long* ranges, const double* contributions,
                       double* values) {
    const long i = thread();
    if (i >= size) return;
    long start = i;
    while (block_size_at[start] == 0) --start;
    const long q = block_size_at[start], end = ranges[2 * start + 1];
    double sum = 0.0;
#pragma unroll 8
    for (long p = ranges[2 * start]; p < end; p += q) sum += contributions[p + i - start];
    values[i] = sum;
}
