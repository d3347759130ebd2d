// A list that grows, without exceptions.
#pragma once

#include <algorithm>

#include "core/runtime.h"

namespace yasps {

template <class T>
struct List {
    Buffer<T> items;
    long count = 0;

    T& operator[](long k) { return items[k]; }
    const T& operator[](long k) const { return items[k]; }
    T* begin() { return items.data; }
    T* end() { return items.data + count; }
    void clear() { count = 0; }

    // Room for n more; false: out of memory.
    bool grow(long n) {
        if (count + n <= items.capacity) return true;
        Buffer<T> more;
        if (!more.reserve(2 * count + n + 256)) return false;
        std::copy_n(items.data, count, more.data);
        items.swap(more);
        return true;
    }
    void add(const T& item) { items[count++] = item; }  // there is room
    bool push(const T& item) {
        if (!grow(1)) return false;
        add(item);
        return true;
    }
};

}  // namespace yasps
