// Pairs of surface pieces that may come close while all vertices move straight from one place to another.
//
// Two bounding volume trees (or one with itself) are descended together; of what is near in them, pairs with a common
// vertex, of classes that do not meet, or with a gap between them in the direction of each other are left out.
//
// A loose point is an edge from a vertex to itself. It meets triangles as all vertices do, edges that are in no
// triangle, and other such points; the edges of a triangle are part of that.
#include <algorithm>
#include <new>

#include "collision/collision_tree.h"
#include "collision/pair_distance.h"
#include "core/runtime.h"

namespace yasps {
namespace {

// A lower bound of the distance of two moving sets of vertices, against `reach`: they stay apart if they do so along
// the line through their middles. Vertices move straight, so that the gap there is a concave function of time and least
// at an end of the motion.
bool may_come_near(const int* first, int first_count, const int* second, int second_count, const Point* start,
                   const Point* end, double reach) {
    const auto middle = [&](const int* ids, int count) {
        Point sum = {0, 0, 0};
        for (int c = 0; c < count; ++c) sum = sum + (start[ids[c]] + end[ids[c]]);
        return (1.0 / count) * sum;
    };
    const Point line = middle(second, second_count) - middle(first, first_count);
    const double limit = reach * sqrt(square(line));
    for (const Point* const x : {start, end}) {
        double last = -INFINITY, next = INFINITY;
        for (int c = 0; c < first_count; ++c) last = std::max(last, dot(line, x[first[c]]));
        for (int c = 0; c < second_count; ++c) next = std::min(next, dot(line, x[second[c]]));
        if (!(next - last > limit)) return true;
    }
    return false;
}

struct Pairs {
    Buffer<int> rows;  // [count, 4]
    long count = 0;

    bool add(const int* first, int first_count, const int* second, int second_count) {
        if (4 * (count + 1) > rows.capacity) {
            Buffer<int> more;
            if (!more.reserve(8 * count + 4096)) return false;
            for (long k = 0; k < 4 * count; ++k) more[k] = rows[k];
            rows.swap(more);
        }
        int* const row = &rows[4 * count++];
        for (int c = 0; c < first_count; ++c) row[c] = first[c];
        for (int c = 0; c < second_count; ++c) row[first_count + c] = second[c];
        return true;
    }
};

// Two nodes that still have to be looked at.
struct Task {
    Branch a, b;
};

// What all pieces have in common; of all vertices each. Null: nothing has a radius, all classes meet.
struct Scene {
    const double* radii;
    const int* classes;
    const uint8_t* meet;  // [class_count, class_count]
    long class_count;

    bool may_meet(int v, int w) const { return classes == nullptr || meet[classes[v] * class_count + classes[w]] != 0; }
    double most_radius(const int* ids, int count) const {
        double most = 0;
        for (int c = 0; c < count; ++c) most = std::max(most, radii[ids[c]]);
        return most;
    }
};

// Looks for pairs of a piece of one tree and one of another, or of two pieces of the same.
struct Search {
    const Tree &a, &b;
    const Scene& scene;
    const Point *start, *end;
    double reach;
    float reach_of_boxes;

    Search(const Tree& first, const Tree& second, const Scene& of, const Point* from, const Point* to, double distance)
        : a(first), b(second), scene(of), start(from), end(to), reach(distance) {
        // Each number is rounded about five times.
        constexpr float kRounding = 32 * 6e-8F;
        const bool some = a.count > 0 && b.count > 0;
        const float size = some ? std::max(a.nodes[0].box.largest(), b.nodes[0].box.largest()) : 0;
        reach_of_boxes = static_cast<float>(distance) * 1.001F + kRounding * size;
    }

    // Takes one step: writes up to three tasks that remain to `rest`, or adds pairs. Returns how many remain, -1 if
    // there is no memory.
    int step(const Task task, Task* rest, Pairs* found) const {
        const Tree::Node &one = a.nodes[task.a.node], &other = b.nodes[task.b.node];
        if (one.label >= 0 && one.label == other.label) return 0;
        const bool same = is_same(task);
        if (!same && !may_meet(one.box, other.box, reach_of_boxes)) return 0;
        if (task.a.is_leaf() && task.b.is_leaf()) return look_at(task, found) ? 0 : -1;
        if (same) {
            const Branch first = task.a.first(), second = task.a.second();
            rest[0] = {first, first}, rest[1] = {second, second}, rest[2] = {first, second};
            return 3;
        }
        if (task.a.blocks >= task.b.blocks)
            rest[0] = {task.a.first(), task.b}, rest[1] = {task.a.second(), task.b};
        else
            rest[0] = {task.a, task.b.first()}, rest[1] = {task.a, task.b.second()};
        return 2;
    }
    bool is_same(const Task& task) const { return &a == &b && task.a.node == task.b.node; }

    // Adds what two blocks have; false: out of memory.
    bool look_at(const Task& task, Pairs* found) const {
        const int left = kBlock * task.a.block, right = kBlock * task.b.block;
        const int rows = a.end_of(task.a.block + 1) - left;
        const Block &one = a.blocks[task.a.block], &other = b.blocks[task.b.block];
        for (int i = 0; i < rows; ++i) {
            const i8 apart = other.apart_from(one, i, reach_of_boxes);
            int near[kBlock], count = 0;
#pragma GCC unroll 8
            for (int j = 0; j < kBlock; ++j) {  // without branches: which are near is hard to guess
                near[count] = right + j;
                count += apart[j] == 0;
            }
            for (int n = 0; n < count; ++n) {
                if (is_same(task) && near[n] <= left + i) continue;
                if (!look_at(left + i, near[n], found)) return false;
            }
        }
        return true;
    }

    bool look_at(int left, int right, Pairs* found) const {
        if (a.label[left] >= 0 && a.label[left] == b.label[right]) return true;
        const int *first = a.at(left), *second = b.at(right);
        for (int i = 0; i < a.arity; ++i)
            for (int j = 0; j < b.arity; ++j)
                if (first[i] == second[j]) return true;
        if (!scene.may_meet(first[0], second[0])) return true;
        double far = reach;
        if (scene.radii != nullptr) far += scene.most_radius(first, a.arity) + scene.most_radius(second, b.arity);
        if (!may_come_near(first, a.arity, second, b.arity, start, end, far)) return true;
        if (&a == &b && second[0] < first[0]) std::swap(first, second);
        return found->add(first, a.arity, second, b.arity);
    }

    bool finish(const Task& task, Pairs* found) const {
        Task stack[256];  // a step down in one of both trees adds at most two, and no tree is deeper than 32
        int height = 0;
        stack[height++] = task;
        while (height > 0) {
            --height;
            const int more = step(stack[height], stack + height, found);
            if (more < 0) return false;
            height += more;
        }
        return true;
    }

    // Every thread adds to its own list; found: [threads].
    bool run(Pairs* found, int threads) const {
        constexpr int kTasks = 64;
        Task tasks[kTasks + 3];
        int first = 0, count = 0;
        if (a.count > 0 && b.count > 0) tasks[count++] = {{0, 0, a.block_count()}, {0, 0, b.block_count()}};
        for (; first < count && count < kTasks; ++first) {
            const int more = step(tasks[first], tasks + count, found);
            if (more < 0) return false;
            count += more;
        }
        bool fine = true;
#pragma omp parallel for num_threads(threads) schedule(dynamic) reduction(&& : fine)
        for (int k = first; k < count; ++k) fine = finish(tasks[k], &found[omp_get_thread_num()]) && fine;
        return fine;
    }
};

struct Surface {
    static constexpr int kMostThreads = 64;
    Scene scene;
    Tree vertices, edges, triangles, points, free_edges;
    Pairs edge_edge[kMostThreads], vertex_triangle[kMostThreads];
};

long total(const Pairs* lists) {
    long sum = 0;
    for (int t = 0; t < Surface::kMostThreads; ++t) sum += lists[t].count;
    return sum;
}

void copy(const Pairs* lists, int* rows) {
    for (int t = 0; t < Surface::kMostThreads; ++t) rows = std::copy_n(lists[t].rows.data, 4 * lists[t].count, rows);
}

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

void yasps_surface_free(void* surface) { delete static_cast<Surface*>(surface); }

// Null: out of memory. Pieces: the vertices of each, and how many; vertices, edges, triangles, points as edges, edges
// in no triangle. labels: [all vertices]; pieces whose vertices all have one label >= 0 do not meet others of it.
// radii, classes: [all vertices], or null; meet: [class_count, class_count]; these three are kept, not copied.
void* yasps_surface_new(const int* const* pieces, const long* counts, const int* labels, const double* radii,
                        const int* classes, const uint8_t* meet, long class_count) {
    Surface* const s = new (std::nothrow) Surface;
    if (s == nullptr) return nullptr;
    s->scene = {radii, classes, meet, class_count};
    Tree* const trees[5] = {&s->vertices, &s->edges, &s->triangles, &s->points, &s->free_edges};
    constexpr int kArities[5] = {1, 2, 3, 2, 2};
    for (int k = 0; k < 5; ++k)
        if (!trees[k]->take(pieces[k], static_cast<int>(counts[k]), kArities[k], labels)) {
            delete s;
            return nullptr;
        }
    return s;
}

// Finds all pairs of edges and of vertex and triangle that may come within `reach` (and their radii) while every vertex
// moves straight from start to end ([all vertices, 3]); sort: look for a better order of the trees first. Their numbers
// go to counts[2]; the pairs, in no special order, stay in the surface until the next call.
int yasps_surface_find(void* surface, const double* start, const double* end, double reach, int sort, long* counts,
                       int threads) {
    Surface& s = *static_cast<Surface*>(surface);
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const int used = std::min(threads, Surface::kMostThreads);
    Tree* const trees[5] = {&s.edges, &s.triangles, &s.vertices, &s.points, &s.free_edges};
    const int tree_count = s.points.count > 0 ? 5 : 3;
#pragma omp parallel for num_threads(used) schedule(dynamic)
    for (int k = 0; k < tree_count; ++k) {
        if (sort) trees[k]->sort(from);
        trees[k]->fit(from, to, s.scene.radii);
    }
    for (int t = 0; t < Surface::kMostThreads; ++t) s.edge_edge[t].count = s.vertex_triangle[t].count = 0;
    const auto search = [&](const Tree& a, const Tree& b, Pairs* found) {
        return Search(a, b, s.scene, from, to, reach).run(found, used);
    };
    if (!search(s.edges, s.edges, s.edge_edge) || !search(s.vertices, s.triangles, s.vertex_triangle))
        return kOutOfMemory;
    if (s.points.count > 0 &&
        (!search(s.points, s.points, s.edge_edge) || !search(s.points, s.free_edges, s.edge_edge)))
        return kOutOfMemory;
    counts[0] = total(s.edge_edge);
    counts[1] = total(s.vertex_triangle);
    return kOk;
}

// Copies the pairs last found: int [counts[k], 4] each.
void yasps_surface_pairs(const void* surface, int* edge_edge, int* vertex_triangle) {
    const Surface& s = *static_cast<const Surface*>(surface);
    copy(s.edge_edge, edge_edge);
    copy(s.vertex_triangle, vertex_triangle);
}
}
