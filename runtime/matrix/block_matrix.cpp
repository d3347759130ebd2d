// The structure of the global Hessian: which blocks there are and where every local block goes (paper, app. A, B).
//
// Local blocks are dropped into one bucket per block row. Within a bucket a marker array finds the distinct
// columns, which are then few enough to sort one row at a time. Rows are independent, so the result does not
// depend on the number of threads. Rows without any block cost next to nothing: contacts touch few.
#include <algorithm>
#include <atomic>
#include <new>

#include "core/runtime.h"

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

// Counts the local blocks of every row, all of which may lie in one; marks pairs without contribution with position -1.
// Returns false, and fills `where` with (instance, slot), at the first instance that names something else than a block.
bool count_rows(const Layout& layout, const int* kappa, int capacity, Range instances, int* slots, uint32_t* counts,
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
                // No branches: which of two blocks comes first is anyone's guess.
                const int row = std::min(i_block, j_block), col = std::max(i_block, j_block);
                const uint32_t flags =
                    (i_block > j_block ? kYaspsTurned : 0u) | (a != b && i_block == j_block ? kYaspsTwice : 0u);
                entries[next_entry[row]++] = {(static_cast<uint32_t>(col) << kYaspsFlagBits) + flags,
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

// Distinct columns of the a-th active row, ascending, in s.unique from the row's bucket on; counts them by block size.
void find_columns(Structure& s, const Layout& layout, long a, bool with_diagonal, int* marker) {
    const int row = s.active[a];
    // The bucket keeps one more place than it has entries, for the diagonal block.
    const long begin = s.bucket_start[row] + row;
    int* const unique = s.unique.data + begin;
    int count = 0;
    if (with_diagonal) {
        marker[row] = row;
        unique[count++] = row;
    }
    for (long e = s.bucket_start[row]; e < s.bucket_start[row + 1]; ++e) {
        const int col = static_cast<int>(s.entries[e].column >> kYaspsFlagBits);
        unique[count] = col;
        count += marker[col] != row ? 1 : 0;
        marker[col] = row;
    }
    std::sort(unique, unique + count);
    s.unique_count[a] = count;
    Share* const shares = s.shares.data + a * layout.classes;
    if (layout.classes == 1) {  // spares most scenes a look at each column
        shares[0] = {count, count > 0 ? unique[count - 1] : 0};
        return;
    }
    for (int k = 0; k < layout.classes; ++k) shares[k] = {0, 0};
    for (int u = 0; u < count; ++u) {
        Share& share = shares[layout.class_of[unique[u]]];
        ++share.blocks;
        share.last_col = unique[u];
    }
}

// Lays the groups out one after another and turns the counts per (row, size) into first block indices.
void place_groups(Structure& s, const Layout& layout) {
    const int classes = layout.classes;
    s.group_count = 0;
    long block = 0, value = 0, next_run = 0;
    for (int r = 0; r < classes; ++r) {
        for (int c = 0; c < classes; ++c) {
            Group group = {layout.class_size[r], layout.class_size[c], block, 0, value, next_run, 0};
            int reach = 0;
            for (long a = 0; a < s.active_rows; ++a) {
                const int row = s.active[a];
                if (layout.class_of[row] != r) continue;
                Share& share = s.shares[a * classes + c];
                const long count = share.blocks;
                share.blocks = group.count;
                if (count == 0) continue;
                reach = std::max(reach, layout.padded_start[share.last_col + 1]);
                s.runs[next_run++] = {group.count, layout.padded_start[row], reach};
                group.count += count;
            }
            if (group.count == 0) continue;
            group.runs = next_run - group.first_run;
            s.runs[next_run++] = {group.count, INT32_MAX, reach};
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

// Writes the coordinates of the a-th active row and the positions of all local blocks that end there.
void write_row(Structure& s, const Layout& layout, const Energies& energies, long a, long* place) {
    const int row = s.active[a];
    const int* const unique = s.unique.data + s.bucket_start[row] + row;
    for (int k = 0; k < layout.classes; ++k) {
        const Group* const group = find_group(s, layout.size[row], layout.class_size[k]);
        if (group == nullptr) continue;
        long in_group = s.shares[a * layout.classes + k].blocks;
        for (int u = 0; u < s.unique_count[a]; ++u) {
            const int col = unique[u];
            if (layout.class_of[col] != k) continue;
            const long block = group->first_block + in_group;
            const long offset = group->first_value + in_group * group->rows * group->cols;
            s.row[block] = row;
            s.col[block] = col;
            s.padded_col[block] = layout.padded_start[col];
            if (col == row) s.diagonal[row] = offset;
            place[col] = offset << kYaspsFlagBits;
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
            place[entry.column >> kYaspsFlagBits] + static_cast<long>(entry.column & (kYaspsTurned | kYaspsTwice));
    }
}

bool reserve_scratch(Structure& s, const Layout& layout, int threads, long slot_stride, Buffer<int>& slots) {
    const long n = layout.blocks;
    return s.counts.reserve(n * threads) && s.next_entry.reserve(n * threads) && s.bucket_start.reserve(n + 1) &&
           s.active.reserve(n) && s.unique_count.reserve(n) && s.marker.reserve(n * threads) &&
           s.place.reserve(n * threads) && s.shares.reserve(n * layout.classes) && s.diagonal.reserve(n) &&
           s.groups.reserve(static_cast<long>(layout.classes) * layout.classes) && slots.reserve(threads * slot_stride);
}

// Prefix sums over (row, thread): where each thread puts its next entry of each row. Lists the rows with blocks.
void place_buckets(Structure& s, long rows, bool with_diagonal, int threads) {
    long total = 0;
    s.active_rows = 0;
    for (long row = 0; row < rows; ++row) {
        s.bucket_start[row] = total;
        for (int t = 0; t < threads; ++t) {
            s.next_entry[t * rows + row] = total;
            total += s.counts[t * rows + row];
        }
        // Without a branch, which would be mispredicted: contacts touch rows at random.
        s.active[s.active_rows] = static_cast<int>(row);
        s.active_rows += with_diagonal || total > s.bucket_start[row] ? 1 : 0;
    }
    s.bucket_start[rows] = total;
}

// `layout` is s.next_layout where that is new.
int build_structure(Structure& s, const Layout& layout, const Energies& energies, bool with_diagonal, int threads,
                    long* where) {
    const long rows = layout.blocks;
    int largest_capacity = 1;
    for (long e = 0; e < energies.count; ++e)
        if (energies.capacity[e] > largest_capacity) largest_capacity = energies.capacity[e];
    Buffer<int> slots;
    // Threads keep their slots on cache lines of their own.
    const long slot_stride = (largest_capacity + 31L) / 16 * 16;
    Buffer<long> bad;  // per thread: energy or -1, instance, slot
    if (!reserve_scratch(s, layout, threads, slot_stride, slots) || !bad.reserve(3L * threads)) return kOutOfMemory;
    memset(s.counts.data, 0, static_cast<size_t>(rows * threads) * sizeof(uint32_t));

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

    place_buckets(s, rows, with_diagonal, threads);
    const long entries = s.bucket_start[rows];
    const long most_runs = (s.active_rows + layout.classes) * layout.classes;
    if (!s.entries.reserve(entries) || !s.unique.reserve(entries + rows) || !s.runs.reserve(most_runs))
        return kOutOfMemory;
    memset(s.diagonal.data, -1, static_cast<size_t>(rows) * sizeof(long));
    memset(s.marker.data, -1, static_cast<size_t>(rows * threads) * sizeof(int));
#pragma omp parallel for num_threads(threads) schedule(static)
    for (int t = 0; t < threads; ++t)
        for (long e = 0; e < energies.count; ++e)
            fill_buckets(layout, energies.kappa[e], energies.capacity[e], piece(energies.instances[e], t, threads),
                         energies.first_source[e], slots.data + t * slot_stride, s.next_entry.data + t * rows,
                         s.entries.data, energies.position[e]);
#pragma omp parallel for num_threads(threads) schedule(dynamic, 512)
    for (long a = 0; a < s.active_rows; ++a)
        find_columns(s, layout, a, with_diagonal, s.marker.data + omp_get_thread_num() * rows);

    place_groups(s, layout);
    if (!s.row.reserve(s.blocks) || !s.col.reserve(s.blocks) || !s.padded_col.reserve(s.blocks)) return kOutOfMemory;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 512)
    for (long a = 0; a < s.active_rows; ++a)
        write_row(s, layout, energies, a, s.place.data + omp_get_thread_num() * rows);
    if (&layout == &s.next_layout) s.layout.swap(s.next_layout);
    return kOk;
}

}  // namespace

void Structure::release_scratch() {
    Layout nothing;
    next_layout.swap(nothing);
    for (Buffer<int>* buffer : {&active, &unique, &unique_count, &marker}) buffer->release();
    for (Buffer<long>* buffer : {&bucket_start, &next_entry, &place}) buffer->release();
    counts.release();
    shares.release();
    entries.release();
}

bool Layout::build(long targets, const long* boundaries, const int* block_sizes, const int* order) {
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
    long given = 0;
    for (long t = 0; t < targets; ++t) {
        const int q = block_sizes[t];
        int k = 0;
        while (class_size[k] != q) ++k;
        for (long offset = boundaries[t]; offset < boundaries[t + 1]; offset += q, ++given) {
            const int block = order != nullptr ? order[given] : static_cast<int>(given);
            block_at[offset] = block;
            start[block] = static_cast<int>(offset);
            size[block] = q;
            class_of[block] = k;
        }
    }
    long inverse = 0;
    padded = 0;
    for (long block = 0; block < blocks; ++block) {
        padded_start[block] = static_cast<int>(padded);
        inverse_start[block] = inverse;
        padded += padded_size(size[block]);
        inverse += static_cast<long>(size[block]) * padded_size(size[block]);
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

}  // namespace yasps

namespace {
// Numbers builds, so that what was made for one is not taken for another at the same address.
std::atomic<long> last_build{0};
}  // namespace

extern "C" {

yasps::Structure* yasps_structure_new() { return new (std::nothrow) yasps::Structure; }
void yasps_structure_free(yasps::Structure* s) { delete s; }

// See build_structure. On failure the structure is as it was before the call, unless memory ran out.
// `where` receives (energy, instance, slot) of a slot that is not the start of a dof block. order: see Layout, or null.
// boundaries is null where targets and order are those of the last build.
int yasps_structure_build(yasps::Structure* s, long targets, const long* boundaries, const int* block_sizes,
                          const int* order, long energy_count, const long* instances, const int* capacity,
                          const int* const* kappa, long* const* position, int with_diagonal, int threads, long* where) {
    const bool fresh = boundaries != nullptr;
    s->aggregates.known = false;
    s->build = ++last_build;
    if (fresh && !s->next_layout.build(targets, boundaries, block_sizes, order)) return yasps::kOutOfMemory;
    yasps::Buffer<long> first_source;
    if (!first_source.reserve(energy_count + 1)) return yasps::kOutOfMemory;
    first_source[0] = 0;
    for (long e = 0; e < energy_count; ++e)
        first_source[e + 1] = first_source[e] + instances[e] * yasps::pairs_of(capacity[e]);
    const yasps::Energies energies = {energy_count, instances, capacity, kappa, position, first_source.data};
    const yasps::Layout& layout = fresh ? s->next_layout : s->layout;
    const int status = yasps::build_structure(*s, layout, energies, with_diagonal != 0, threads, where);
    if (with_diagonal != 0) s->release_scratch();  // the static part: seldom built again
    return status;
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
