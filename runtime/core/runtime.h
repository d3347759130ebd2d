// What the files of the solver runtime share: memory, vector types, the block-sparse structure and the C API.
//
// Every function that Python calls is extern "C" and allocates through Buffer, so that running out of memory is
// a status and not an exception that cannot cross the language border.
#pragma once

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#ifdef _OPENMP
#include <omp.h>
#else
inline int omp_get_thread_num() { return 0; }
inline int omp_get_num_threads() { return 1; }
#endif

#include "core/sink.h"

static_assert(sizeof(long) == 8, "the runtime's C interface passes 64-bit integers as long");

namespace yasps {

// Vectors of 4 and 8 doubles. The compiler splits them where the processor's registers are narrower.
typedef double d4 __attribute__((vector_size(32), may_alias));
typedef double d4_unaligned __attribute__((vector_size(32), aligned(8), may_alias));
typedef double d8 __attribute__((vector_size(64), may_alias));
typedef double d8_unaligned __attribute__((vector_size(64), aligned(8), may_alias));
typedef long l4 __attribute__((vector_size(32)));
typedef long l8 __attribute__((vector_size(64)));

inline d4 load(const double* p) { return *reinterpret_cast<const d4*>(p); }
inline d4 load_unaligned(const double* p) { return *reinterpret_cast<const d4_unaligned*>(p); }
inline void store(double* p, d4 v) { *reinterpret_cast<d4*>(p) = v; }
inline double sum_of(d4 v) { return (v[0] + v[1]) + (v[2] + v[3]); }

enum Status { kOk = 0, kOutOfMemory = 1, kBadSlot = 2 };

// Memory that only grows and is reused between calls: aligned to a cache line, uninitialised.
template <class T>
struct Buffer {
    T* data = nullptr;
    long capacity = 0;
    void* allocated = nullptr;  // where `data` begins, or up to a cache line before

    Buffer() = default;
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer() { free(allocated); }

    T& operator[](long i) { return data[i]; }
    const T& operator[](long i) const { return data[i]; }

    // Makes room for n items. What was there is lost when the buffer has to grow. False: out of memory.
    bool reserve(long n) { return fits(n) || replace(n, malloc(bytes_of(n))); }
    // As reserve, and new memory is zero (the system need not provide it before it is written); memory that was
    // already there is left as it is.
    bool reserve_zero(long n) { return fits(n) || replace(n, calloc(bytes_of(n), 1)); }
    void release() {
        free(allocated);
        data = nullptr, allocated = nullptr, capacity = 0;
    }
    void swap(Buffer& other) {
        const auto exchange = [](auto& a, auto& b) {
            const auto before = a;
            a = b, b = before;
        };
        exchange(data, other.data), exchange(capacity, other.capacity), exchange(allocated, other.allocated);
    }

  private:
    bool fits(long n) const { return data != nullptr && n <= capacity; }
    static long room_for(long n) { return n + n / 4 + 1; }  // never nothing
    static size_t bytes_of(long n) { return static_cast<size_t>(room_for(n)) * sizeof(T) + 2 * kLine; }
    bool replace(long n, void* fresh) {
        if (fresh == nullptr) return false;
        free(allocated);
        allocated = fresh;
        data = reinterpret_cast<T*>((reinterpret_cast<uintptr_t>(fresh) + kLine - 1) / kLine * kLine);
        capacity = room_for(n);
        return true;
    }
    static constexpr size_t kLine = 64;
};

struct Range {
    long begin, end;
};
// Part t of n items cut into `parts` contiguous pieces.
inline Range piece(long n, long t, long parts) { return {n * t / parts, n * (t + 1) / parts}; }

// Chunk c of `chunks` of instances; borders are multiples of the number of lanes.
inline Range chunk_of(long instances, long c, long chunks) {
    const long packs = (instances + kYaspsLanes - 1) / kYaspsLanes;
    const Range range = piece(packs, c, chunks);
    const long end = range.end * kYaspsLanes;
    return {range.begin * kYaspsLanes, end < instances ? end : instances};
}

// Where the blocks of unknowns ("dof blocks") lie in the global vectors. Solver vectors are kept padded: every
// block starts at a multiple of four doubles and the gaps hold zero, so that blocks load as aligned vectors.
struct Layout {
    long scalars = 0;            // length of the gradient
    long blocks = 0;             // number of dof blocks
    long padded = 0;             // length of a padded vector
    int classes = 0;             // number of distinct block sizes
    int largest = 0;             // the largest block size
    Buffer<int> class_size;      // [classes], ascending
    Buffer<int> block_at;        // [scalars]: the block that starts at this scalar offset, or -1
    Buffer<int> start;           // [blocks]: scalar offset; ascending unless the blocks were reordered
    Buffer<int> size;            // [blocks]
    Buffer<int> class_of;        // [blocks]: index into class_size
    Buffer<int> padded_start;    // [blocks + 1]
    Buffer<long> inverse_start;  // [blocks + 1]: where the preconditioner keeps the block, rows padded

    // Dof block k in the order of the scalars becomes block order[k]; null: the blocks keep that order.
    bool build(long targets, const long* boundaries, const int* block_sizes, const int* order);
    void swap(Layout& other);
};
inline int padded_size(int size) { return (size + 3) & ~3; }

// All blocks of one shape: rows x cols, sorted by (row, col).
struct Group {
    int rows, cols;
    long first_block, count;
    long first_value;      // offset in doubles of the group's first block in HessianBlocks
    long first_run, runs;  // its rows; one more Run follows them to mark the end
};

// The blocks of one row in a group.
struct Run {
    long first;  // block, counted in the group
    int row;     // as offset into padded vectors
    int reach;   // end in padded vectors of the furthest column of this row or one before it in the group
};

// One local block on its way to its row's bucket.
struct Entry {
    uint32_t column;  // dof block and flags as in PositionInData
    uint32_t source;  // index into the PositionInData of all energies laid end to end
};

// What one row has of the blocks of one column size.
struct Share {
    long blocks;   // how many; then the first one, counted in the group
    int last_col;  // dof block
};

// Dof blocks that move together in the coarse space of the two-level preconditioner (solvers/aggregates.cpp).
struct Aggregates {
    bool known = false;
    int count = 0;
    long unknowns = 0;      // of the coarse space: what the aggregates' blocks have, each aggregate once
    long length = 0;        // of padded vectors of these
    Buffer<int> of;         // [blocks]: the aggregate of each, or -1
    Buffer<int> width;      // [count]: scalars of a block
    Buffer<int> weight;     // [count]: blocks
    Buffer<int> first;      // [count + 1]: the first unknown of each
    Buffer<int> padded_of;  // [unknowns]: the place in padded vectors
};

// The sparsity of a symmetric matrix, upper triangle only (paper, appendix B).
struct Structure {
    Layout layout;
    long blocks = 0;      // number of unique global blocks
    long values = 0;      // doubles in HessianBlocks
    int group_count = 0;  // shapes that occur
    long build = 0;       // which build of the process this is, from 1 on
    Buffer<Group> groups;
    Buffer<int> row, col;    // [blocks]: dof blocks, row <= col
    Buffer<int> padded_col;  // [blocks]: col as offset into padded vectors
    Buffer<Run> runs;
    Buffer<long> diagonal;          // [layout.blocks]: offset of the diagonal block, or -1
    mutable Aggregates aggregates;  // found when first asked for, forgotten at the next build

    // Scratch of the build, kept for the next one if there soon is one.
    Layout next_layout;
    Buffer<int> active, unique, unique_count, marker;
    Buffer<uint32_t> counts;  // local blocks of all energies together are fewer than 2^32
    Buffer<long> bucket_start, next_entry, place;
    Buffer<Share> shares;  // [active rows, classes]
    Buffer<Entry> entries;
    long active_rows = 0;  // rows with blocks; `active` lists them
    void release_scratch();
};

// Adds to y what the stored blocks of some rows, and their transposes, contribute to H x. Everything is padded, rows
// too. Writes y from the first row on up to reach_of the same rows. See multiply.cpp.
void multiply_rows(const Structure& s, const double* values, Range rows, const double* x, double* y);
long reach_of(const Structure& s, Range rows);
// The first run of the group in this row or a later one; the one behind the last where there is none.
const Run* first_run(const Structure& s, const Group& group, long row);
// Sets touched[i / kStretch] for all places i behind these rows that multiply_rows writes.
constexpr long kStretch = 64;
void mark_stretches(const Structure& s, Range rows, bool* touched);
// Doubles of HessianBlocks in the rows before this one.
long values_before(const Structure& s, long row);

void pack(const Layout& layout, Range blocks, const double* compact, double* padded);
void unpack(const Layout& layout, Range blocks, const double* padded, double* compact);

struct NegativePart {
    unsigned changed, unfinished;  // bit sets of lanes: had a negative eigenvalue; eigenvalues were not found
};
// Removes the negative eigenvalues of 8 or 16 (packs = 1, 2) symmetric n x n matrices, or their signs (flip), in place.
// packed[k * stride + lane], aligned to 64 bytes, is entry k of the upper triangle, row by row; all are finite.
// sizes[lane] is the sum of their absolute values. Lanes without negative eigenvalues keep every bit. See
// negative_part.cpp.
void remove_negative_part(double* packed, int stride, const double* sizes, int n, int packs, bool flip, double* scratch,
                          NegativePart* result);
long negative_part_scratch(int n);  // doubles, aligned to 64 bytes

}  // namespace yasps

extern "C" {

typedef long (*yasps_energy_kernel)(const void* const* args, long begin, long end, const yasps_sink* sink);
typedef void (*yasps_value_kernel)(const void* const* args, long begin, long end, double* out);

long yasps_project(double* packed, int width, int lanes, int mode);
long yasps_project_isotropic(double* packed, const double* deformation, int width, int lanes, int mode);
long yasps_project_two_vectors(double* packed, const double* vectors, int width, int lanes, int mode);
}
