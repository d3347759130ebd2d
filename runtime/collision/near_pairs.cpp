// Pairs of surface pieces that may come close while all vertices move straight from one place to another.
//
// Two bounding volume trees (or one with itself) are descended together; of what is near in them, pairs with a common
// vertex, of classes that do not meet, or with a gap between them in the direction of each other are left out.
//
// Of pairs that were found before, those are taken over of which no vertex has strayed from the way they were found
// for; then only pairs of which one has are looked for.
//
// A loose point is an edge from a vertex to itself. It meets triangles as all vertices do, edges that are in no
// triangle, and other such points; the edges of a triangle are part of that.
#include <algorithm>
#include <new>

#include "collision/chunks.h"
#include "collision/collision_tree.h"
#include "collision/list.h"
#include "collision/pair_distance.h"
#include "collision/pair_packs.h"
#include "core/runtime.h"

namespace yasps {
namespace {

struct Row {
    int vertices[4];
};
typedef List<Row> Pairs;

// Where vertices are at both ends of their way.
struct Ends {
    Places start, end;
};

// Drops those of `rows` from `first` on that stay apart, a lower bound of their distance against `reach`: they do if
// they do so along the line through their middles. Vertices move straight, so that the gap there is a concave function
// of time and least at an end of the motion.
template <int kSplit>
void drop_apart(const Ends& ends, double reach, long first, Pairs* rows) {
    if (rows->count == first) return;
    const int* const pairs = rows->items[0].vertices;
    long to = first;
    for (long k = first; k < rows->count; k += kPack) {
        const int lanes = static_cast<int>(std::min<long>(kPack, rows->count - k));
        int numbers[kPack];
        for (int l = 0; l < kPack; ++l) numbers[l] = l;
        const PairPack start = gather(ends.start, pairs + 4 * k, numbers, lanes);
        const PairPack end = gather(ends.end, pairs + 4 * k, numbers, lanes);
        PointPack q[4], moved[4], sum[4];
        start.relative(q), end.relative(moved);
        for (int c = 0; c < 4; ++c) sum[c] = q[c] + moved[c];
        // The first vertex moves, too, but both middles are taken relative to it.
        const PointPack line = line_of_middles<kSplit>(sum);
        const Eight far = most_radii<kSplit>(start.radius) + constant<Eight>(reach);
        const unsigned apart =
            bits_of(along<kSplit>(line, q).is_beyond(far)) & bits_of(along<kSplit>(line, moved).is_beyond(far));
        for (int l = 0; l < lanes; ++l) {
            (*rows)[to] = (*rows)[k + l];
            to += !(apart >> l & 1);
        }
    }
    rows->count = to;
}

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
};

// Looks for pairs of a piece of one tree and one of another, or of two pieces of the same.
// kSplit: vertices of the first of both, of four in all.
template <int kSplit>
struct Search {
    const Tree &a, &b;
    const Scene& scene;
    const Ends& ends;
    double reach;
    float reach_of_boxes;

    Search(const Tree& first, const Tree& second, const Scene& of, const Ends& way, double distance)
        : a(first), b(second), scene(of), ends(way), reach(distance) {
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
        if ((one.label >= 0 && one.label == other.label) || !(one.strayed || other.strayed)) return 0;
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

    // Adds what two blocks have and whose boxes meet; false: out of memory.
    bool look_at(const Task& task, Pairs* found) const {
        const long left = kBlock * task.a.block, right = kBlock * task.b.block;
        const Block &one = a.blocks[task.a.block], &other = b.blocks[task.b.block];
        if (!found->grow(kBlock * kBlock)) return false;
        const unsigned rows = bits_of(one.apart_from(b.nodes[task.b.node].box, reach_of_boxes)) ^ 0xff;
        const unsigned wanted_rows = other.strayed != 0 ? rows : rows & one.strayed;
        for (unsigned left_rows = wanted_rows; left_rows != 0; left_rows &= left_rows - 1) {
            const int i = __builtin_ctz(left_rows);
            i8 apart = other.apart_from(one, i, reach_of_boxes) | other.joined_with<4 - kSplit, kSplit>(one, i);
            if (is_same(task)) apart |= i8{0, 1, 2, 3, 4, 5, 6, 7} <= i;
            const unsigned wanted = one.strayed >> i & 1 ? 0xff : other.strayed;
            for (unsigned near = ~bits_of(apart) & wanted; near != 0; near &= near - 1)
                add(&a.vertices[kSplit * (left + i)], &b.vertices[(4 - kSplit) * (right + __builtin_ctz(near))], found);
        }
        return true;
    }

    // There is room.
    void add(const int* first, const int* second, Pairs* found) const {
        if (!scene.may_meet(first[0], second[0])) return;
        if (&a == &b && second[0] < first[0]) std::swap(first, second);
        Row row;
        for (int c = 0; c < kSplit; ++c) row.vertices[c] = first[c];
        for (int c = kSplit; c < 4; ++c) row.vertices[c] = second[c - kSplit];
        found->add(row);
    }

    bool finish(const Task& task, Pairs* found) const {
        constexpr long kMany = 512;  // pairs that are still in the cache
        Task stack[256];             // a step down in one of both trees adds at most two, and no tree is deeper than 32
        int height = 0;
        stack[height++] = task;
        long looked_at = found->count;
        const auto drop = [&] {
            drop_apart<kSplit>(ends, reach, looked_at, found);
            looked_at = found->count;
        };
        while (height > 0) {
            --height;
            const int more = step(stack[height], stack + height, found);
            if (more < 0) return false;
            height += more;
            if (found->count - looked_at >= kMany) drop();
        }
        drop();
        return true;
    }

    // False: out of memory.
    bool run(ChunkLists<Row>* found, int threads) const {
        constexpr int kTasks = 64;
        Task tasks[kTasks + 3];
        Pairs none;
        int first = 0, count = 0;
        if (a.count > 0 && b.count > 0) tasks[count++] = {{0, 0, a.block_count()}, {0, 0, b.block_count()}};
        for (; first < count && count < kTasks; ++first) {
            const Task task = tasks[first];
            if (task.a.is_leaf() && task.b.is_leaf()) break;  // it has pairs, and no more tasks
            count += step(task, tasks + count, &none);
        }
        return found->run(count - first, threads, [&](long k, Pairs& list) { return finish(tasks[first + k], &list); });
    }
};

struct Surface {
    Scene scene;
    Tree vertices, edges, triangles, points, free_edges;
    Ends ends;
    VertexBoxes boxes;
    // Pairs taken over, of edges, two points, and a point and an edge; then the same of vertex and triangle.
    ChunkLists<Row> kept_edge_edge, edge_edge, point_point, point_edge, kept_vertex_triangle, vertex_triangle;
};

// Takes over those of the pairs, [count, 4], of which nothing strayed and which do not stay apart. False: out of
// memory.
template <int kSplit>
bool keep(const int* pairs, long count, const uint8_t* strayed, const Ends& ends, double reach, int threads,
          ChunkLists<Row>* kept) {
    constexpr long kChunk = 1024;
    return kept->run((count + kChunk - 1) / kChunk, threads, [&](long chunk, Pairs& list) {
        const long begin = kChunk * chunk, end = std::min(count, begin + kChunk), first = list.count;
        if (!list.grow(end - begin)) return false;
        for (long k = begin; k < end; ++k) {
            const int* const v = pairs + 4 * k;
            list[list.count] = {{v[0], v[1], v[2], v[3]}};
            list.count += !(strayed[v[0]] | strayed[v[1]] | strayed[v[2]] | strayed[v[3]]);
        }
        drop_apart<kSplit>(ends, reach, first, &list);
        return true;
    });
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
// moves straight from start to end ([vertices, 3]); sort: look for a better order of the trees first. Their numbers
// go to counts[2]; the pairs, the same for any number of threads, stay in the surface until the next call.
// strayed: [vertices], or null: all. The others move as they did when edge_edge and vertex_triangle were found
// ([count, 4]) with this reach or more, or for a part of that way, all at the same time; so their pairs are among
// these.
int yasps_surface_find(void* surface, const double* start, const double* end, long vertices, double reach, int sort,
                       const uint8_t* strayed, const int* edge_edge, long edge_count, const int* vertex_triangle,
                       long triangle_count, long* counts, int threads) {
    Surface& s = *static_cast<Surface*>(surface);
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const int used = std::min(threads, kMostThreads);
    if (!s.ends.start.take(from, nullptr, s.scene.radii, vertices, used) ||
        !s.ends.end.take(to, nullptr, s.scene.radii, vertices, used) ||
        !s.boxes.take(from, to, s.scene.radii, vertices, used))
        return kOutOfMemory;
    Tree* const trees[5] = {&s.edges, &s.triangles, &s.vertices, &s.points, &s.free_edges};
    const int tree_count = s.points.count > 0 ? 5 : 3;
#pragma omp parallel for num_threads(used) schedule(dynamic)
    for (int k = 0; k < tree_count; ++k) {
        if (sort) trees[k]->sort(from);
        trees[k]->fit(s.boxes.of.data, strayed);
    }
    const auto edges = [&](const Tree& a, const Tree& b, ChunkLists<Row>& found) {
        return Search<2>(a, b, s.scene, s.ends, reach).run(&found, used);
    };
    const Search<1> of_triangles(s.vertices, s.triangles, s.scene, s.ends, reach);
    const bool fine = keep<2>(edge_edge, edge_count, strayed, s.ends, reach, used, &s.kept_edge_edge) &&
                      keep<1>(vertex_triangle, triangle_count, strayed, s.ends, reach, used, &s.kept_vertex_triangle) &&
                      edges(s.edges, s.edges, s.edge_edge) && of_triangles.run(&s.vertex_triangle, used) &&
                      edges(s.points, s.points, s.point_point) && edges(s.points, s.free_edges, s.point_edge);
    if (!fine) return kOutOfMemory;
    counts[0] = s.kept_edge_edge.total() + s.edge_edge.total() + s.point_point.total() + s.point_edge.total();
    counts[1] = s.kept_vertex_triangle.total() + s.vertex_triangle.total();
    return kOk;
}

// Copies the pairs last found: int [counts[k], 4] each.
void yasps_surface_pairs(const void* surface, int* edge_edge, int* vertex_triangle, int threads) {
    const Surface& s = *static_cast<const Surface*>(surface);
    const int used = std::min(threads, kMostThreads);
    Row* to = reinterpret_cast<Row*>(edge_edge);
    for (const ChunkLists<Row>* const found : {&s.kept_edge_edge, &s.edge_edge, &s.point_point, &s.point_edge})
        found->copy(to, used), to += found->total();
    to = reinterpret_cast<Row*>(vertex_triangle);
    for (const ChunkLists<Row>* const found : {&s.kept_vertex_triangle, &s.vertex_triangle})
        found->copy(to, used), to += found->total();
}
}
