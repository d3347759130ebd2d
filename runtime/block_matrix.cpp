// The structure of the global Hessian: which blocks there are and where every local block goes (paper, app. A, B).
//
// Local blocks are dropped into one bucket per block row. Within a bucket a marker array finds the distinct
// columns, which are then few enough to sort one row at a time. Rows are independent, so the result does not
// depend on the number of threads.
#include <algorithm>
#include <new>

#include "runtime.h"

namespace yasps {
namespace {

// Slots of one instance, translated from scalar offsets to dof blocks: -1 where there is no contribution.
// Returns the slot that is not the start of a block, or -1 when all are.
int read_slots(const Layout& layout, const int* kappa, int capacity, int* slots) {
    for (int a = 0; a < capacity; ++a) {
        const long offset = kappa[a];
        if (offset == 0) {
            slots[a] = -1;
            continue;
        }
        if (offset < 0 || offset > layout.scalars || layout.block_at[offset - 1] < 0) return a;
        slots[a] = layout.block_at[offset - 1];
    }
    return -1;
}

long pairs_of(long capacity) { return capacity * (capacity + 1) / 2; }

// Counts the local blocks of every row; marks pairs without contribution with position -1. Returns false, and
// fills `where` with (instance, slot), at the first instance that names something else than a block.
bool count_rows(const Layout& layout, const int* kappa, int capacity, Range instances, int* slots, int* counts,
                long* where) {
    for (long i = instances.begin; i < instances.end; ++i) {
        const int bad = read_slots(layout, kappa + i * capacity, capacity, slots);
        if (bad >= 0) {
            where[0] = i, where[1] = bad;
            return false;
        }
        for (int a = 0; a < capacity; ++a) {
            if (slots[a] < 0) continue;
            for (int b = a; b < capacity; ++b)
                if (slots[b] >= 0) ++counts[slots[a] < slots[b] ? slots[a] : slots[b]];
        }
    }
    return true;
}

void fill_buckets(const Layout& layout, const int* kappa, int capacity, Range instances, long first_source, int* slots,
                  long* next_entry, Entry* entries, long* position) {
    const long pairs = pairs_of(capacity);
    for (long i = instances.begin; i < instances.end; ++i) {
        read_slots(layout, kappa + i * capacity, capacity, slots);
        long k = i * pairs;
        for (int a = 0; a < capacity; ++a) {
            for (int b = a; b < capacity; ++b, ++k) {
                const int i_block = slots[a], j_block = slots[b];
                if (i_block < 0 || j_block < 0) {
                    position[k] = -1;
                    continue;
                }
                const bool transposed = i_block > j_block;
                const int row = transposed ? j_block : i_block;
                const int col = transposed ? i_block : j_block;
                const uint32_t flags = (transposed ? 1u : 0u) | (a != b && i_block == j_block ? 2u : 0u);
                entries[next_entry[row]++] = {static_cast<uint32_t>(col) * 4u + flags,
                                              static_cast<uint32_t>(first_source + k)};
            }
        }
    }
}

struct Energies {
    long count;
    const long* instances;     // [count]
    const int* capacity;       // [count]
    const int* const* kappa;   // [count]
    long* const* position;     // [count]
    const long* first_source;  // [count + 1]
};

// Distinct columns of one row, ascending, in s.unique from the row's bucket on; counts them by block size.
void find_columns(Structure& s, const Layout& layout, long row, bool with_diagonal, int* marker) {
    // The bucket keeps one more place than it has entries, for the diagonal block.
    const long begin = s.bucket_start[row] + row;
    int* const unique = s.unique.data + begin;
    int count = 0;
    if (with_diagonal) {
        marker[row] = static_cast<int>(row);
        unique[count++] = static_cast<int>(row);
    }
    for (long e = s.bucket_start[row]; e < s.bucket_start[row + 1]; ++e) {
        const int col = static_cast<int>(s.entries[e].column >> 2);
        if (marker[col] == row) continue;
        marker[col] = static_cast<int>(row);
        unique[count++] = col;
    }
    std::sort(unique, unique + count);
    s.unique_count[row] = count;
    long* const by_class = s.class_start.data + row * layout.classes;
    for (int k = 0; k < layout.classes; ++k) by_class[k] = 0;
    for (int u = 0; u < count; ++u) ++by_class[layout.class_of[unique[u]]];
}

// Lays the groups out one after another and turns the counts per (row, size) into first block indices.
void place_groups(Structure& s, const Layout& layout) {
    const int classes = layout.classes;
    s.group_count = 0;
    long block = 0, value = 0;
    for (int r = 0; r < classes; ++r) {
        for (int c = 0; c < classes; ++c) {
            Group group = {layout.class_size[r], layout.class_size[c], block, 0, value};
            for (long row = 0; row < layout.blocks; ++row) {
                if (layout.class_of[row] != r) continue;
                long& start = s.class_start[row * classes + c];
                const long count = start;
                start = group.count;
                group.count += count;
            }
            if (group.count == 0) continue;
            block += group.count;
            value += group.count * group.rows * group.cols;
            s.groups[s.group_count++] = group;
        }
    }
    s.blocks = block;
    s.values = value;
}

const Group* find_group(const Structure& s, int rows, int cols) {
    for (int g = 0; g < s.group_count; ++g)
        if (s.groups[g].rows == rows && s.groups[g].cols == cols) return &s.groups[g];
    return nullptr;
}

// Writes the row's coordinates and the positions of all local blocks that end there.
void write_row(Structure& s, const Layout& layout, const Energies& energies, long row, long* place) {
    s.diagonal[row] = -1;
    const int* const unique = s.unique.data + s.bucket_start[row] + row;
    for (int k = 0; k < layout.classes; ++k) {
        const Group* const group = find_group(s, layout.size[row], layout.class_size[k]);
        if (group == nullptr) continue;
        long in_group = s.class_start[row * layout.classes + k];
        for (int u = 0; u < s.unique_count[row]; ++u) {
            const int col = unique[u];
            if (layout.class_of[col] != k) continue;
            const long block = group->first_block + in_group;
            const long offset = group->first_value + in_group * group->rows * group->cols;
            s.row[block] = static_cast<int>(row);
            s.col[block] = col;
            s.padded_row[block] = layout.padded_start[row];
            s.padded_col[block] = layout.padded_start[col];
            if (col == row) s.diagonal[row] = offset;
            place[col] = offset * 4;
            ++in_group;
        }
    }
    long e = s.bucket_start[row];
    long energy = 0;
    for (; e < s.bucket_start[row + 1]; ++e) {
        const Entry entry = s.entries[e];
        const long source = entry.source;
        // Entries of one energy come together, so this seldom moves.
        while (source < energies.first_source[energy]) --energy;
        while (source >= energies.first_source[energy + 1]) ++energy;
        energies.position[energy][source - energies.first_source[energy]] =
            place[entry.column >> 2] + static_cast<long>(entry.column & 3u);
    }
}

bool reserve_scratch(Structure& s, const Layout& layout, int threads, long slot_stride, Buffer<int>& slots) {
    const long n = layout.blocks;
    return s.counts.reserve(n * threads) && s.next_entry.reserve(n * threads) && s.bucket_start.reserve(n + 1) &&
           s.unique_count.reserve(n) && s.marker.reserve(n * threads) && s.place.reserve(n * threads) &&
           s.class_start.reserve(n * layout.classes) &&
           s.groups.reserve(static_cast<long>(layout.classes) * layout.classes) && slots.reserve(threads * slot_stride);
}

// Prefix sums over (row, thread): where each thread puts its next entry of each row.
void place_buckets(Structure& s, long rows, int threads) {
    long total = 0;
    for (long row = 0; row < rows; ++row) {
        s.bucket_start[row] = total;
        for (int t = 0; t < threads; ++t) {
            s.next_entry[t * rows + row] = total;
            total += s.counts[t * rows + row];
        }
    }
    s.bucket_start[rows] = total;
}

int build_structure(Structure& s, const Energies& energies, bool with_diagonal, int threads, long* where) {
    const Layout& layout = s.next_layout;
    const long rows = layout.blocks;
    int largest_capacity = 1;
    for (long e = 0; e < energies.count; ++e)
        if (energies.capacity[e] > largest_capacity) largest_capacity = energies.capacity[e];
    Buffer<int> slots;
    // Threads keep their slots on cache lines of their own.
    const long slot_stride = (largest_capacity + 31L) / 16 * 16;
    Buffer<long> bad;  // per thread: energy or -1, instance, slot
    if (!reserve_scratch(s, layout, threads, slot_stride, slots) || !bad.reserve(3L * threads)) return kOutOfMemory;
    if (energies.first_source[energies.count] >= INT64_C(0xffffffff) || rows >= INT64_C(0x3fffffff))
        return kTooManyBlocks;
    memset(s.counts.data, 0, static_cast<size_t>(rows * threads) * sizeof(int));

#pragma omp parallel for num_threads(threads) schedule(static)
    for (int t = 0; t < threads; ++t) {
        bad[3L * t] = -1;
        for (long e = 0; e < energies.count && bad[3L * t] < 0; ++e) {
            const int capacity = energies.capacity[e];
            if (!count_rows(layout, energies.kappa[e], capacity, piece(energies.instances[e], t, threads),
                            slots.data + t * slot_stride, s.counts.data + t * rows, &bad[3L * t + 1]))
                bad[3L * t] = e;
        }
    }
    for (int t = 0; t < threads; ++t) {
        const long* const found = &bad[3L * t];
        if (found[0] < 0) continue;
        memcpy(where, found, 3 * sizeof(long));
        return kBadSlot;
    }

    place_buckets(s, rows, threads);
    const long entries = s.bucket_start[rows];
    if (!s.entries.reserve(entries) || !s.unique.reserve(entries + rows) || !s.diagonal.reserve(rows))
        return kOutOfMemory;
    memset(s.marker.data, -1, static_cast<size_t>(rows * threads) * sizeof(int));
#pragma omp parallel for num_threads(threads) schedule(static)
    for (int t = 0; t < threads; ++t)
        for (long e = 0; e < energies.count; ++e)
            fill_buckets(layout, energies.kappa[e], energies.capacity[e], piece(energies.instances[e], t, threads),
                         energies.first_source[e], slots.data + t * slot_stride, s.next_entry.data + t * rows,
                         s.entries.data, energies.position[e]);
#pragma omp parallel for num_threads(threads) schedule(dynamic, 512)
    for (long row = 0; row < rows; ++row)
        find_columns(s, layout, row, with_diagonal, s.marker.data + omp_get_thread_num() * rows);

    place_groups(s, layout);
    if (!s.row.reserve(s.blocks) || !s.col.reserve(s.blocks) || !s.padded_row.reserve(s.blocks) ||
        !s.padded_col.reserve(s.blocks))
        return kOutOfMemory;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 512)
    for (long row = 0; row < rows; ++row)
        write_row(s, layout, energies, row, s.place.data + omp_get_thread_num() * rows);
    s.layout.swap(s.next_layout);
    return kOk;
}

}  // namespace

bool Layout::build(long targets, const long* boundaries, const int* block_sizes) {
    scalars = boundaries[targets];
    blocks = 0, classes = 0, largest = 0;
    if (!class_size.reserve(targets)) return false;
    for (long t = 0; t < targets; ++t) {
        const int q = block_sizes[t];
        blocks += (boundaries[t + 1] - boundaries[t]) / q;
        if (q > largest) largest = q;
        int k = 0;
        while (k < classes && class_size[k] < q) ++k;
        if (k < classes && class_size[k] == q) continue;
        for (int m = classes; m > k; --m) class_size[m] = class_size[m - 1];
        class_size[k] = q;
        ++classes;
    }
    if (!block_at.reserve(scalars) || !start.reserve(blocks) || !size.reserve(blocks) || !class_of.reserve(blocks) ||
        !padded_start.reserve(blocks + 1) || !inverse_start.reserve(blocks + 1))
        return false;
    for (long i = 0; i < scalars; ++i) block_at[i] = -1;
    long block = 0, inverse = 0;
    padded = 0;
    for (long t = 0; t < targets; ++t) {
        const int q = block_sizes[t];
        int k = 0;
        while (class_size[k] != q) ++k;
        for (long offset = boundaries[t]; offset < boundaries[t + 1]; offset += q, ++block) {
            block_at[offset] = static_cast<int>(block);
            start[block] = static_cast<int>(offset);
            size[block] = q;
            class_of[block] = k;
            padded_start[block] = static_cast<int>(padded);
            inverse_start[block] = inverse;
            padded += padded_size(q);
            inverse += static_cast<long>(q) * padded_size(q);
        }
    }
    padded_start[blocks] = static_cast<int>(padded);
    inverse_start[blocks] = inverse;
    return padded < INT32_MAX;
}

void Layout::swap(Layout& other) {
    std::swap(scalars, other.scalars);
    std::swap(blocks, other.blocks);
    std::swap(padded, other.padded);
    std::swap(classes, other.classes);
    std::swap(largest, other.largest);
    class_size.swap(other.class_size);
    block_at.swap(other.block_at);
    start.swap(other.start);
    size.swap(other.size);
    class_of.swap(other.class_of);
    padded_start.swap(other.padded_start);
    inverse_start.swap(other.inverse_start);
}

Range Layout::blocks_of_part(long t, long parts) const {
    const int* const begin = padded_start.data;
    const int* const end = begin + blocks;
    const Range range = piece(padded, t, parts);
    return {std::lower_bound(begin, end, range.begin) - begin, std::lower_bound(begin, end, range.end) - begin};
}

}  // namespace yasps

extern "C" {

yasps::Structure* yasps_structure_new() { return new (std::nothrow) yasps::Structure; }
void yasps_structure_free(yasps::Structure* s) { delete s; }

// See build_structure. On failure the structure is as it was before the call, unless memory ran out.
// `where` receives (energy, instance, slot) of a slot that is not the start of a dof block.
int yasps_structure_build(yasps::Structure* s, long targets, const long* boundaries, const int* block_sizes,
                          long energy_count, const long* instances, const int* capacity, const int* const* kappa,
                          long* const* position, int with_diagonal, int threads, long* where) {
    if (!s->next_layout.build(targets, boundaries, block_sizes)) return yasps::kOutOfMemory;
    yasps::Buffer<long> first_source;
    if (!first_source.reserve(energy_count + 1)) return yasps::kOutOfMemory;
    first_source[0] = 0;
    for (long e = 0; e < energy_count; ++e)
        first_source[e + 1] = first_source[e] + instances[e] * yasps::pairs_of(capacity[e]);
    const yasps::Energies energies = {energy_count, instances, capacity, kappa, position, first_source.data};
    return yasps::build_structure(*s, energies, with_diagonal != 0, threads, where);
}

// sizes: scalars, dof blocks, global blocks, doubles in HessianBlocks, number of groups.
void yasps_structure_sizes(const yasps::Structure* s, long* sizes) {
    sizes[0] = s->layout.scalars;
    sizes[1] = s->layout.blocks;
    sizes[2] = s->blocks;
    sizes[3] = s->values;
    sizes[4] = s->group_count;
}

// groups[g] = rows, cols, first block, number of blocks, first value.
void yasps_structure_groups(const yasps::Structure* s, long* groups) {
    for (int g = 0; g < s->group_count; ++g) {
        const yasps::Group& group = s->groups[g];
        const long fields[5] = {group.rows, group.cols, group.first_block, group.count, group.first_value};
        memcpy(groups + 5L * g, fields, sizeof(fields));
    }
}

// Scalar offsets of the block's first row and first column, for all blocks.
void yasps_structure_coordinates(const yasps::Structure* s, int* rows, int* cols) {
    for (long b = 0; b < s->blocks; ++b) {
        rows[b] = s->layout.start[s->row[b]];
        cols[b] = s->layout.start[s->col[b]];
    }
}
}
