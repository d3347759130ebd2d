// A barrier for the threads of a parallel region that meet every few microseconds.
//
// A thread that waits spins first and then sleeps. Where all run at the same time the others come soon, and a long spin
// is faster, since it takes long to wake a thread. Where other programs use the processors, it keeps away the very
// thread that it waits for. Which of the two holds is seen from the long spins alone, by whether the others came: while
// they do, all spins are long; else fewer and fewer are, and then every 256th (adaptive spinning: Karlin, Li, Manasse
// & Owicki 1991, Empirical studies of competitive spinning for a shared-memory multiprocessor).
#pragma once

#include <pthread.h>
#include <time.h>

#include <atomic>

#include "core/runtime.h"

namespace yasps {

class TeamBarrier {
  public:
    TeamBarrier() = default;
    TeamBarrier(const TeamBarrier&) = delete;
    TeamBarrier& operator=(const TeamBarrier&) = delete;
    ~TeamBarrier() {
        pthread_cond_destroy(&passed_);
        pthread_mutex_destroy(&mutex_);
    }

    // Returns when all threads of the region have called it; then what they wrote before can be read.
    void wait() {
        const int team = omp_get_num_threads();
        if (team == 1) return;
        const unsigned round = round_.load(std::memory_order_relaxed);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == team) {
            arrived_.store(0, std::memory_order_relaxed);
            round_.store(round + 1);
            if (sleepers_.load() > 0) wake_sleepers();
            return;
        }
        const int gap = gap_.load(std::memory_order_relaxed), left = left_.load(std::memory_order_relaxed);
        if (left > 0) {
            left_.store(left - 1, std::memory_order_relaxed);
            if (!spin(round, kShort)) sleep(round);
            return;
        }
        const bool met = spin(round, kLong);
        const int next = met ? gap / 2 : gap < kRarest / 8 ? 8 * (gap + 1) : kRarest;
        if (next != gap) gap_.store(next, std::memory_order_relaxed);
        if (next > 0) left_.store(next, std::memory_order_relaxed);
        if (!met) sleep(round);
    }

  private:
    static constexpr long kShort = 3000, kLong = 300000;  // ns; to wake a thread takes 10 to 100 us
    static constexpr int kRarest = 256;

    static long now() {
        timespec time;
        clock_gettime(CLOCK_MONOTONIC, &time);
        return 1000000000 * time.tv_sec + time.tv_nsec;
    }

    static void pause() {
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        asm volatile("isb");
#endif
    }

    // Whether the round ended within this time.
    bool spin(unsigned round, long limit) const {
        const long start = now();
        do {
            for (int k = 0; k < 16; ++k) {
                if (round_.load(std::memory_order_acquire) != round) return true;
                pause();
            }
        } while (now() - start < limit);
        return false;
    }

    // A sleeper is counted before it looks at the round; the last thread ends the round before it looks at the count.
    // So one of them sees the other, and the mutex keeps the call that wakes from coming before the sleep.
    void sleep(unsigned round) {
        pthread_mutex_lock(&mutex_);
        sleepers_.fetch_add(1);
        while (round_.load() == round) pthread_cond_wait(&passed_, &mutex_);
        sleepers_.fetch_sub(1);
        pthread_mutex_unlock(&mutex_);
    }
    void wake_sleepers() {
        pthread_mutex_lock(&mutex_);
        pthread_cond_broadcast(&passed_);
        pthread_mutex_unlock(&mutex_);
    }

    // Lines of their own: the first is read in a loop while the others are written.
    alignas(64) std::atomic<unsigned> round_{0};
    alignas(64) std::atomic<int> arrived_{0};
    std::atomic<int> sleepers_{0};
    std::atomic<int> gap_{0};   // waits with a short spin after each with a long one
    std::atomic<int> left_{0};  // of these
    pthread_mutex_t mutex_ = PTHREAD_MUTEX_INITIALIZER;
    pthread_cond_t passed_ = PTHREAD_COND_INITIALIZER;
};

}  // namespace yasps
