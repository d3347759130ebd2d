// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void value_index(int* __restrict y0) {
    y0[0] = 0;
}

extern "C" void yasps<still.v.x.kappa>_value(Arguments a, long i, int* out) {
    value_index(out);
}
