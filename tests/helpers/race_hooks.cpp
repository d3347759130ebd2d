// Finds races of kernels that the host runs (cuda_on_host.h): the compiler calls a function of this file at every load
// and store (-fsanitize=thread, whose own library is not linked).
//
// Threads run one after another, so a race is not seen by what it breaks but by what does not keep two accesses apart.
// Two accesses of a word by different threads of a launch, at least one a write and not both atomic, are in order if
// their block passed a __syncthreads between them, or their warp a __syncwarp. Nothing orders different blocks;
// shuffles and votes order no memory. A thread that has ended counts as having passed what the others pass.
//
// The shadow has a place for every word of 4 bytes that was touched. A narrower access counts as one of its whole word:
// kernels have none.
#include <dlfcn.h>
#include <stdint.h>
#include <string.h>

#include <memory>
#include <string>
#include <unordered_map>

extern "C" char __bss_start, _end;  // of this library: what begins as zero lies between, shared memory among it

namespace {

enum Kind : unsigned { kRead, kWrite, kAtomic };

// `code` is a place in this library, 0 where there is no access.
struct Access {
    unsigned code, block, thread, kind;
    unsigned blocks_met, warps_met;  // how many __syncthreads and __syncwarp the thread had passed
    unsigned warp() const { return thread / 32; }
};

// The last write; of reads and atomic accesses since then, as many as decide whether a later access races with any.
struct Place {
    unsigned launch;
    Access write, reads[2], atomics[2];
};

// As in race_detector.py.
struct Race {
    uint64_t address;
    uint32_t shared, found;  // found: how many there were in all
    Access first, second;
};

struct Counts {
    unsigned block, warp;
};

constexpr int kPlaces = 256;
std::unordered_map<uintptr_t, std::unique_ptr<Place[]>> shadow;
uintptr_t last_page = ~(uintptr_t)0;
Place* last_places;

unsigned launch, block, thread;
Counts passed[2048];  // by each thread of the block
bool running;         // code of a kernel, not of what plays the device
const char* stack_top;
Race race;
std::string left_out_file;
int left_out_line;

bool is_shared(uintptr_t at) { return at >= (uintptr_t)&__bss_start && at < (uintptr_t)&_end; }

// Before whatever happens from now on, in any thread that has still to run.
bool is_past(const Access& a, bool shared) {
    if (!a.code) return true;
    return a.block == block ? a.blocks_met < passed[thread].block : shared;
}
// Before what the running thread does now.
bool is_before(const Access& a, bool shared) {
    if (is_past(a, shared)) return true;
    if (a.block != block) return false;
    return a.thread == thread || (a.warp() == thread / 32 && a.warps_met < passed[thread].warp);
}

bool same_warp(const Access& a, const Access& b) { return a.block == b.block && a.warp() == b.warp(); }

// Of all that are not past, two of different warps stay: no access is after both. Else two threads of one warp, of
// those that passed the most __syncwarp.
void keep(Access (&kept)[2], const Access& now, bool shared) {
    for (Access& a : kept)
        if (is_past(a, shared)) a = {};
    if (!kept[0].code) {
        kept[0] = now;
    } else if (!same_warp(kept[0], now)) {
        if (!kept[1].code || same_warp(kept[0], kept[1])) kept[1] = now;
    } else if (!kept[1].code || same_warp(kept[0], kept[1])) {
        if (kept[0].warps_met < now.warps_met)
            kept[0] = now, kept[1] = {};
        else if (kept[0].thread != now.thread)
            kept[1] = now;
    }
}

void compare(const Access& before, const Access& now, uintptr_t at) {
    const bool shared = is_shared(at);
    if (is_before(before, shared) || race.found++) return;
    race.address = at, race.shared = shared, race.first = before, race.second = now;
}

Place& place_of(uintptr_t at) {
    const uintptr_t word = at / 4, page = word / kPlaces;
    if (page != last_page) {
        std::unique_ptr<Place[]>& places = shadow[page];
        if (!places) places.reset(new Place[kPlaces]());
        last_page = page, last_places = places.get();
    }
    Place& place = last_places[word % kPlaces];
    if (place.launch != launch) place = {}, place.launch = launch;
    return place;
}

unsigned offset_of(const void* code) {
    static const char* const base = [] {
        Dl_info info;
        dladdr((void*)&offset_of, &info);
        return (const char*)info.dli_fbase;
    }();
    return (unsigned)((const char*)code - base);
}

void touch(const void* address, uintptr_t size, Kind kind, const void* code) {
    if (!running || !size) return;
    const uintptr_t first = (uintptr_t)address;
    if ((const char*)address >= (const char*)__builtin_frame_address(0) && (const char*)address < stack_top) return;
    const Access now = {offset_of(code), block, thread, kind, passed[thread].block, passed[thread].warp};
    for (uintptr_t at = first / 4 * 4; at < first + size; at += 4) {
        const bool shared = is_shared(at);
        Place& place = place_of(at);
        compare(place.write, now, at);
        if (kind != kRead)
            for (const Access& read : place.reads) compare(read, now, at);
        if (kind != kAtomic)
            for (const Access& atomic : place.atomics) compare(atomic, now, at);
        if (kind == kRead) keep(place.reads, now, shared);
        if (kind == kAtomic) keep(place.atomics, now, shared);
        if (kind == kWrite) {  // what races with an earlier access races with this one or was reported
            place = {};
            place.launch = launch, place.write = now;
        }
    }
}

}  // namespace

namespace races {
void begin_block(unsigned number) {
    block = number;
    memset(passed, 0, sizeof(passed));
}
void go_on(unsigned number, const void* top) { thread = number, stack_top = (const char*)top, running = true; }
void pause() { running = false; }
void pass_block() { ++passed[thread].block; }
void pass_warp() { ++passed[thread].warp; }
void touch_atomic(const void* address, unsigned long size, const void* code) { touch(address, size, kAtomic, code); }
void touch_read(const void* address, unsigned long size, const void* code) { touch(address, size, kRead, code); }
bool leaves_out(const char* file, int line) { return line == left_out_line && left_out_file == file; }
}  // namespace races

#define VISIBLE extern "C" __attribute__((visibility("default")))

// Before a launch. The barrier of that line is left out; 0: none.
VISIBLE void races_begin(const char* file, int line) {
    if (shadow.size() > 1 << 13) shadow.clear(), last_page = ~(uintptr_t)0;  // a quarter of a gigabyte
    ++launch;
    race = {};
    left_out_file = file, left_out_line = line;
}
// After it: the first race, and how many there were.
VISIBLE unsigned races_end(Race* found) {
    *found = race;
    return race.found;
}

// What the compiler calls.
#define HOOK extern "C" void
#define CODE __builtin_return_address(0)
#define FOR_SIZE(N)                                                        \
    HOOK __tsan_read##N(void* at) { touch(at, N, kRead, CODE); }           \
    HOOK __tsan_write##N(void* at) { touch(at, N, kWrite, CODE); }         \
    HOOK __tsan_unaligned_read##N(void* at) { touch(at, N, kRead, CODE); } \
    HOOK __tsan_unaligned_write##N(void* at) { touch(at, N, kWrite, CODE); }
FOR_SIZE(1)
FOR_SIZE(2)
FOR_SIZE(4)
FOR_SIZE(8)
FOR_SIZE(16)
HOOK __tsan_read_range(void* at, unsigned long size) { touch(at, size, kRead, CODE); }
HOOK __tsan_write_range(void* at, unsigned long size) { touch(at, size, kWrite, CODE); }
extern "C" void* __tsan_memset(void* at, int value, unsigned long size) {
    touch(at, size, kWrite, CODE);
    return memset(at, value, size);
}
extern "C" void* __tsan_memcpy(void* to, const void* from, unsigned long size) {
    touch(from, size, kRead, CODE), touch(to, size, kWrite, CODE);
    return memcpy(to, from, size);
}
extern "C" void* __tsan_memmove(void* to, const void* from, unsigned long size) {
    touch(from, size, kRead, CODE), touch(to, size, kWrite, CODE);
    return memmove(to, from, size);
}
HOOK __tsan_func_entry(void*) {}
HOOK __tsan_func_exit() {}
HOOK __tsan_init() {}
