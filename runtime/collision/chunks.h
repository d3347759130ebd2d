// Work that several threads do in chunks, and what they find.
#pragma once

#include <algorithm>

#include "collision/list.h"
#include "core/runtime.h"

namespace yasps {

constexpr int kMostThreads = 64;

// What is found in each chunk, in the order of the chunks, whichever thread had them.
template <class T>
class ChunkLists {
  public:
    // work(chunk, list) adds to the list; a bool, false: out of memory. threads: at most kMostThreads.
    template <class Work>
    bool run(long chunks, int threads, const Work& work) {
        chunks_ = 0;
        if (!spans_.reserve(chunks)) return false;
        for (List<T>& list : lists_) list.clear();
        bool fine = true;
#pragma omp parallel for num_threads(threads) schedule(dynamic) reduction(&& : fine) if (threads > 1)
        for (long chunk = 0; chunk < chunks; ++chunk) {
            const int thread = omp_get_thread_num();
            List<T>& list = lists_[thread];
            const long begin = list.count;
            fine = work(chunk, list) && fine;
            spans_[chunk] = {thread, begin, list.count, 0};
        }
        long place = 0;
        for (long chunk = 0; chunk < chunks; ++chunk) {
            spans_[chunk].place = place;
            place += spans_[chunk].end - spans_[chunk].begin;
        }
        chunks_ = chunks;
        return fine;
    }
    void clear() {
        chunks_ = 0;
        for (List<T>& list : lists_) list.clear();
    }
    long total() const {
        long sum = 0;
        for (const List<T>& list : lists_) sum += list.count;
        return sum;
    }
    // Copies all that was found, [total()].
    void copy(T* to, int threads) const {
#pragma omp parallel for num_threads(threads) schedule(static) if (threads > 1)
        for (long chunk = 0; chunk < chunks_; ++chunk) {
            const Span& span = spans_[chunk];
            std::copy_n(lists_[span.thread].items.data + span.begin, span.end - span.begin, to + span.place);
        }
    }
    // What this thread found.
    const List<T>& of_thread(int thread) const { return lists_[thread]; }

  private:
    struct Span {
        int thread;
        long begin, end;  // in its list
        long place;       // among all
    };
    List<T> lists_[kMostThreads];
    Buffer<Span> spans_;
    long chunks_ = 0;
};

}  // namespace yasps
