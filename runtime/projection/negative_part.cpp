// Takes the negative part out of small symmetric matrices, 8 or 16 at a time: one in each lane of one or two vectors.
//
// Householder's reduction to tridiagonal form, then QL sweeps with Wilkinson's shift (Golub & Van Loan, sec. 8.3). No
// eigenvectors are carried along: sweeps note their plane rotations, and only the vectors of negative eigenvalues,
// mostly few, are made from them. A sweep is a chain of operations that wait for each other, so that two vectors take
// hardly longer than one. Loops are rolled on purpose: unrolling them for every width costs a minute of compile time.
#include "core/runtime.h"
#include "core/vectors.h"
#include "projection/cone.h"
#include "projection/tridiagonal.h"

namespace yasps {
namespace {

// Memory for plane rotations, in multiples of n^2: 1.5 are usual. A test sets it to zero.
#ifndef YASPS_ROTATIONS
#define YASPS_ROTATIONS 2
#endif

template <class V>
inline void add_scaled(V* to, V factor, const V* v, int n) {
    for (int i = 0; i < n; ++i) to[i] = to[i] + factor * v[i];
}

// Applies the reflections to vectors x[j * n + i], so that what belonged to the tridiagonal matrix belongs to a.
template <class V>
void reflect_back(const V* a, int n, int count, V* x) {
    for (int k = n - 3; k >= 0; --k) {
        const V* const v = a + k * n + k + 1;
        const V scale = v[n - 1];
        for (int j = 0; j < count; ++j) {
            V* const to = x + j * n + k + 1;
            add_scaled(to, dot<V, const V*>(v, to, n - k - 1) * scale * -1.0, v, n - k - 1);
        }
    }
}

// Plane rotations in the order in which they were made: those of a sweep turn axes (i, i + 1), i = high - 1 .. low.
struct Sweep {
    int low, high;
};
template <class V>
struct Rotations {
    Rotation<V>* turns;
    Sweep* sweeps;
    long capacity, count, sweep_count;
    V* product;  // [n, n] columns: those made before, where memory for `turns` did not suffice
    bool has_product;
};

// One sweep on several vectors.
template <int kVectors, class V>
inline void turn_vectors(Sweep sweep, const Rotation<V>* last, int n, V* x) {
    V carried[kVectors];
#pragma GCC unroll 4
    for (int j = 0; j < kVectors; ++j) carried[j] = x[j * n + sweep.low];
    for (int i = sweep.low; i < sweep.high; ++i, --last) {
        const Rotation<V> turn = *last;
#pragma GCC unroll 4
        for (int j = 0; j < kVectors; ++j) {
            const V upper = x[j * n + i + 1];
            x[j * n + i] = turn.cosine * carried[j] + turn.sine * upper;
            carried[j] = turn.cosine * upper - turn.sine * carried[j];
        }
    }
#pragma GCC unroll 4
    for (int j = 0; j < kVectors; ++j) x[j * n + sweep.high] = carried[j];
}

// Multiplies `count` vectors x[j * n + i] by the turns; temporary holds n.
template <class V>
void apply(const Rotations<V>& t, int n, int count, V* x, V* temporary) {
    const Rotation<V>* last = t.turns + t.count - 1;
    for (long k = t.sweep_count - 1; k >= 0; --k) {
        const Sweep sweep = t.sweeps[k];
        int j = 0;
        for (; j + 1 < count; j += 2) turn_vectors<2>(sweep, last, n, x + j * n);
        if (j < count) turn_vectors<1>(sweep, last, n, x + j * n);
        last -= sweep.high - sweep.low;
    }
    for (int j = 0; t.has_product && j < count; ++j) {
        V* const to = x + j * n;
        for (int i = 0; i < n; ++i) temporary[i] = V{};
        for (int i = 0; i < n; ++i) add_scaled(temporary, to[i], t.product + i * n, n);
        for (int i = 0; i < n; ++i) to[i] = temporary[i];
    }
}

// Replaces the turns by their product. x and temporary are scratch of n x n and n.
template <class V>
void multiply_out(Rotations<V>* t, int n, V* x, V* temporary) {
    for (int i = 0; i < n * n; ++i) x[i] = V{};
    for (int i = 0; i < n; ++i) x[i * n + i] = constant<V>(1);
    apply(*t, n, n, x, temporary);
    for (int i = 0; i < n * n; ++i) t->product[i] = x[i];
    t->has_product = true;
    t->count = t->sweep_count = 0;
}

// Diagonalises the tridiagonal matrix: d becomes the eigenvalues, in no order; the product of the turns, in the order
// they were made, has the eigenvectors as columns. A sweep takes in all lanes, each with the shift for its own next
// eigenvalue: where a lane has found eigenvalues that others still seek, coupling and sine are zero and nothing turns.
// Returns lanes that did not converge. Scratch as in multiply_out.
template <class V>
Mask<V> diagonalise(V* d, V* e, int n, Rotations<V>* turns, V* x, V* temporary) {
    V negligible = negligible_coupling<V>(d, e, n);
    int low = 0, high = n - 1;
    for (int sweep = 0;; ++sweep) {
        // The first 2 x 2 block of each lane that is not diagonal yet.
        Mask<V> busy = {};
        V diagonal = {}, next = constant<V>(2), coupling = {};
        for (int i = high - 1; i >= low; --i) {
            const Mask<V> here = less(negligible, magnitude(e[i]));
            e[i] = select(here, e[i], V{});
            busy = busy | here;
            diagonal = select(here, d[i], diagonal);
            next = select(here, d[i + 1], next);
            coupling = select(here, e[i], coupling);
        }
        if (sweep == kMaxSweeps * n || !any(busy)) return busy;
        if (sweep > kManySweeps * n && sweep % n == 0) negligible = negligible * 2.0;
        while (!any(less(V{}, magnitude(e[low])))) ++low;
        while (!any(less(V{}, magnitude(e[high - 1])))) --high;
        if (turns->count + high - low > turns->capacity) multiply_out(turns, n, x, temporary);

        QlSweep<V> ql(shift_for(diagonal, next, coupling), d, high);
        Rotation<V>* turn = turns->turns + turns->count;
        for (int i = high - 1; i >= low; --i, ++turn) {
            ql.step(d, e, i);
            *turn = ql.turn;
        }
        ql.finish(d, e, low);
        turns->count += high - low;
        turns->sweeps[turns->sweep_count++] = {low, high};
    }
}

constexpr long capacity(long n) { return YASPS_ROTATIONS * n * n + n; }
template <class V>
struct Scratch {
    V *a, *x, *d, *e, *p;
    Mask<V>* rank;
    Rotations<V> turns;
};
template <class V>
Scratch<V> cut_scratch(void* memory, int n) {
    Scratch<V> s;
    V* next = static_cast<V*>(memory);
    const auto take = [&next](long count) {
        V* const taken = next;
        next += count;
        return taken;
    };
    s.a = take(n * n);
    s.x = take(n * n);
    s.d = take(n + 1);
    s.e = take(n + 1);
    s.p = take(n + 1);
    s.rank = reinterpret_cast<Mask<V>*>(take(n + 1));
    Rotation<V>* const turns = reinterpret_cast<Rotation<V>*>(take(2 * capacity(n)));
    V* const product = take(n * n);
    s.turns = {turns, reinterpret_cast<Sweep*>(next), capacity(n), 0, 0, product, false};
    return s;
}

template <class V>
void remove_negative(double* packed, int stride, const double* sizes, int n, bool flip, void* memory,
                     NegativePart* result) {
    typedef Mask<V> M;
    Scratch<V> s = cut_scratch<V>(memory, n);
    V size;
    load_lanes(sizes, &size);
    const V up = power_of_two(size, 1), down = power_of_two(size, -1);
    V trace = {};
    const double* from = packed;
    for (int i = 0; i < n; ++i) {
        for (int j = i; j < n; ++j, from += stride) {
            V entry;
            load_lanes(from, &entry);
            s.a[i * n + j] = entry * down;
        }
        trace = trace + magnitude(s.a[i * n + i]);
    }
    if (n > 1)
        tridiagonalise<V>(s.a, n, s.d, s.e);
    else
        s.d[0] = s.a[0];
    const M unfinished = diagonalise(s.d, s.e, n, &s.turns, s.x, s.p);

    V smallest = {};
    for (int i = 0; i < n; ++i) smallest = select(less(s.d[i], smallest), s.d[i], smallest);
    const M changes = less(smallest, trace * -kProjectionShift);
    result->unfinished = bits_of(unfinished);
    result->changed = bits_of(changes);
    // The negative eigenvalues of each lane are numbered; smaller ones are rounding.
    const V rounding = trace * (-4 * kEpsilon);
    const M none = each([](RegisterMask zero) { return zero - 1; }, M{});
    M found = {};
    for (int i = 0; i < n; ++i) {
        const M negative = changes & less(s.d[i], rounding);
        s.rank[i] = select(negative, found, none);
        found = found - negative;
    }
    const int count = static_cast<int>(largest_of(found));
    for (int j = 0; j < count; ++j) {
        V weight = {};
        for (int i = 0; i < n; ++i) {
            const M here = each([j](RegisterMask rank) { return RegisterMask(rank == j); }, s.rank[i]);
            s.x[j * n + i] = select(here, constant<V>(1), V{});
            weight = select(here, s.d[i], weight);
        }
        s.e[j] = weight * (flip ? -2.0 : -1.0);
    }
    apply(s.turns, n, count, s.x, s.p);
    reflect_back(s.a, n, count, s.x);
    double* at = packed;
    for (int r = 0; r < n; ++r) {
        for (int j = 0; j < count; ++j) s.p[j] = s.e[j] * s.x[j * n + r];
        for (int c = r; c < n; ++c, at += stride) {
            V before;
            load_lanes(at, &before);
            V sum = before * down;
            for (int j = 0; j < count; ++j) sum = sum + s.p[j] * s.x[j * n + c];
            store_lanes(at, select(changes, sum * up, before));
        }
    }
}

}  // namespace

long negative_part_scratch(int n) {
    // As cut_scratch takes; a sweep needs no more than one of its rotations.
    return (3L * n * n + 4L * (n + 1) + 2 * capacity(n)) * 2 * kYaspsLanes + capacity(n);
}

void remove_negative_part(double* packed, int stride, const double* sizes, int n, int packs, bool flip, double* scratch,
                          NegativePart* result) {
    *result = {};
    if (packs == 1)
        remove_negative<Eight>(packed, stride, sizes, n, flip, scratch, result);
    else
        remove_negative<Sixteen>(packed, stride, sizes, n, flip, scratch, result);
}

}  // namespace yasps
