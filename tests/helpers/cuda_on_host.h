// Stands in for CUDA where device code is built for the host: a launch runs block after block, the threads of a block
// as fibers, so that __syncthreads and the warp's functions do what they do on a device. Within a block, threads run
// in turn up to the next function that waits. Where no function waits (NO_FIBERS), threads are a loop: that compiles
// and runs faster. With FIND_RACES, race_hooks.cpp is told what it must know to find races. Only for tests.
#include <math.h>
#ifndef NO_FIBERS
#include <setjmp.h>
#include <string.h>
#include <ucontext.h>

#include <vector>
#endif

#define __global__
#define __device__
#define __host__
#define __forceinline__ inline
#define __noinline__ __attribute__((noinline))
#define __restrict__ __restrict
#define __shared__ static
#define __constant__ static
#define __launch_bounds__(...)

struct Triple {
    unsigned x, y, z;
};
static Triple threadIdx, blockIdx, blockDim, gridDim;
static const int warpSize = 32;

#ifdef FIND_RACES
namespace races {  // of race_hooks.cpp
void begin_block(unsigned number);
void go_on(unsigned thread, const void* stack_top);  // from here on it is code of the kernel that runs,
void pause();                                        // and from here on not
void pass_block();
void pass_warp();
void touch_atomic(const void* address, unsigned long size, const void* code);
void touch_read(const void* address, unsigned long size, const void* code);
bool leaves_out(const char* file, int line);  // the barrier there
}  // namespace races
#define OF_DEVICE __attribute__((noinline, no_sanitize("thread")))
#define TOUCH(kind, at) races::touch_##kind(at, sizeof(*at), __builtin_return_address(0))
#else
namespace races {
static inline void begin_block(unsigned) {}
static inline void go_on(unsigned, const void*) {}
static inline void pause() {}
}  // namespace races
#define OF_DEVICE
#define TOUCH(kind, at)
#endif

namespace fibers {
#ifdef NO_FIBERS
static void launch(void (*kernel)(void*), void* arguments, unsigned grid, unsigned block, bool backwards) {
    gridDim = {grid, 1, 1}, blockDim = {block, 1, 1};
    for (unsigned k = 0; k < grid * block; ++k) {
        const unsigned thread = backwards ? grid * block - 1 - k : k;
        blockIdx = {thread / block, 0, 0}, threadIdx = {thread % block, 0, 0};
        if (k % block == 0) races::begin_block(thread / block);
        races::go_on(thread % block, __builtin_frame_address(0));
        kernel(arguments);
        races::pause();
    }
}
}  // namespace fibers
#else
struct Fiber {
    ucontext_t context;  // to begin
    jmp_buf at;          // to go on: unlike swapcontext, this asks nothing of the system
    char* stack;         // as long as the library lives; what no thread has used of it takes no memory
    bool begun, done;
};
constexpr unsigned long STACK = 1 << 18;
static std::vector<Fiber> all;
static jmp_buf scheduler;
static int current;
static void (*body)(void*);
static void* given;
static long slots[2][2048];  // what threads say to their warp, by turns
static int turn[2048];

// Threads that have to meet: a warp, or the block. Those that have ended are not waited for.
struct Group {
    int alive, arrived;
    long meeting;
};
static Group block_group, warps[64];

static void leave(Group& group) {
    --group.alive;
    if (group.arrived && group.arrived == group.alive) group.arrived = 0, ++group.meeting;
}

// Code of the kernel goes on in the running fiber.
static void go_on() { races::go_on(current, all[current].stack + STACK); }
static void run() {
    go_on();
    body(given);
    races::pause();
    all[current].done = true;
    leave(block_group), leave(warps[current / 32]);
    _longjmp(scheduler, 1);
}
// Until the thread waits or ends.
static __noinline__ void resume(Fiber* fiber) {
    if (_setjmp(scheduler)) return;
    if (fiber->begun) _longjmp(fiber->at, 1);
    fiber->begun = true;
    setcontext(&fiber->context);
}
static __noinline__ void wait() {
    if (!_setjmp(all[current].at)) _longjmp(scheduler, 1);
}
static void meet(Group& group) {
    const long meeting = group.meeting;
    if (++group.arrived == group.alive) group.arrived = 0, ++group.meeting;
    while (group.meeting == meeting) wait();
}

static void launch(void (*kernel)(void*), void* arguments, unsigned grid, unsigned block, bool backwards) {
    body = kernel, given = arguments;
    gridDim = {grid, 1, 1}, blockDim = {block, 1, 1};
    if (all.size() < block) all.resize(block);
    for (unsigned b = 0; b < grid; ++b) {
        blockIdx = {backwards ? grid - 1 - b : b, 0, 0};
        races::begin_block(blockIdx.x);
        block_group = {(int)block, 0, 0};
        for (unsigned w = 0; w < 64; ++w)
            warps[w] = {(int)block - 32 * (int)w < 32 ? (int)block - 32 * (int)w : 32, 0, 0};
        for (unsigned t = 0; t < block; ++t) {
            Fiber& fiber = all[t];
            if (fiber.stack == nullptr) fiber.stack = new char[STACK];
            fiber.begun = fiber.done = false;
            turn[t] = 0;
            getcontext(&fiber.context);
            fiber.context.uc_stack.ss_sp = fiber.stack;
            fiber.context.uc_stack.ss_size = STACK;
            fiber.context.uc_link = nullptr;
            makecontext(&fiber.context, run, 0);
        }
        for (bool running = true; running;) {
            running = false;
            for (unsigned k = 0; k < block; ++k) {
                const unsigned t = backwards ? block - 1 - k : k;
                if (all[t].done) continue;
                current = t, threadIdx = {t, 0, 0};
                resume(&all[t]);
                running = running || !all[t].done;
            }
        }
    }
}
template <class T>
static T from_lane(T value, int lane) {
    static_assert(sizeof(T) <= 8, "as on a device");
    races::pause();
    const int self = current, half = turn[self] ^= 1;
    memcpy(&slots[half][self], &value, sizeof(T));
    meet(warps[self / 32]);
    const int source = self / 32 * 32 + lane;
    T result = value;
    if (lane >= 0 && lane < 32 && source < (int)blockDim.x) memcpy(&result, &slots[half][source], sizeof(T));
    go_on();
    return result;
}
static void sync_block() {
    races::pause();
    meet(block_group);
    go_on();
}
static void sync_warp(unsigned = ~0u) {
    races::pause();
    meet(warps[current / 32]);
    go_on();
}
}  // namespace fibers

#ifdef FIND_RACES
#define __syncthreads() (races::leaves_out(__FILE__, __LINE__) ? (void)0 : (fibers::sync_block(), races::pass_block()))
#define __syncwarp(...) \
    (races::leaves_out(__FILE__, __LINE__) ? (void)0 : (fibers::sync_warp(__VA_ARGS__), races::pass_warp()))
#else
#define __syncthreads() fibers::sync_block()
#define __syncwarp(...) fibers::sync_warp(__VA_ARGS__)
#endif
static inline void __threadfence() {}
template <class T>
static T __shfl_sync(unsigned, T value, int lane) {
    return fibers::from_lane(value, lane & 31);
}
template <class T>
static T __shfl_down_sync(unsigned, T value, int by) {
    const int lane = fibers::current % 32 + by;
    return fibers::from_lane(value, lane < 32 ? lane : fibers::current % 32);
}
template <class T>
static T __shfl_up_sync(unsigned, T value, int by) {
    const int lane = fibers::current % 32 - by;
    return fibers::from_lane(value, lane >= 0 ? lane : fibers::current % 32);
}
template <class T>
static T __shfl_xor_sync(unsigned, T value, int mask) {
    return fibers::from_lane(value, (fibers::current % 32) ^ mask);
}
static unsigned __ballot_sync(unsigned, int predicate) {
    races::pause();
    unsigned bits = 0;
    const int self = fibers::current, half = fibers::turn[self] ^= 1;
    fibers::slots[half][self] = predicate != 0;
    fibers::meet(fibers::warps[self / 32]);
    for (int lane = 0; lane < 32; ++lane) {
        const int source = self / 32 * 32 + lane;
        if (source < (int)blockDim.x && !fibers::all[source].done && fibers::slots[half][source]) bits |= 1u << lane;
    }
    fibers::go_on();
    return bits;
}
static int __any_sync(unsigned mask, int predicate) { return __ballot_sync(mask, predicate) != 0; }
static int __all_sync(unsigned mask, int predicate) { return !__ballot_sync(mask, !predicate); }
#endif
static inline int __popc(unsigned x) { return __builtin_popcount(x); }
static inline int __ffs(int x) { return __builtin_ffs(x); }
static inline int __clz(int x) { return x ? __builtin_clz(x) : 32; }

template <class T, class U>
OF_DEVICE static T atomicAdd(T* at, U value) {
    TOUCH(atomic, at);
    const T before = *at;
    *at = before + (T)value;
    return before;
}
template <class T, class U>
OF_DEVICE static T atomicMin(T* at, U value) {
    TOUCH(atomic, at);
    const T before = *at;
    if ((T)value < before) *at = (T)value;
    return before;
}
template <class T, class U>
OF_DEVICE static T atomicMax(T* at, U value) {
    TOUCH(atomic, at);
    const T before = *at;
    if ((T)value > before) *at = (T)value;
    return before;
}
template <class T>
OF_DEVICE static T __ldg(const T* at) {
    TOUCH(read, at);
    return *at;
}
static inline double rsqrt(double x) { return 1.0 / sqrt(x); }
