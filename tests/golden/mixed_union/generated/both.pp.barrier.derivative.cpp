// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

// backend/cpp/preludes/scatter.h stands here

// backend/cpp/preludes/lanes.h stands here

#if defined(__AVX512F__)
extern "C" V _ZGVeN8v_log(V a);
static inline V v_log(V a) { return _ZGVeN8v_log(a); }
#elif defined(__AVX2__)
typedef double V4 __attribute__((vector_size(32), may_alias));
extern "C" V4 _ZGVdN4v_log(V4);
static inline V v_log(V a) {
    V r;
    for (int h = 0; h < 2; ++h) ((V4*)&r)[h] = _ZGVdN4v_log(((const V4*)&a)[h]);
    return r;
}
#else
static inline V v_log(V a) {
    V r;
    for (int l = 0; l < 8; ++l) r[l] = __builtin_log(a[l]);
    return r;
}
#endif

extern "C" long yasps<both.v.x>_pull_lanes(Arguments a, const long* own, const V* b, long n, V* out, int* sizes);
extern "C" void yasps<both.v.x>_value_lanes(Arguments a, const long* own, V* out);
static inline void pull_back_pack(const V* x0, V* __restrict y0) {
    const V t6 = -x0[0];
    y0[3] = t6;
    const V t7 = -x0[1];
    y0[4] = t7;
    y0[8] = t7;
    const V t8 = -x0[2];
    y0[5] = t8;
    y0[12] = t8;
    const V t9 = -x0[3];
    y0[9] = t9;
    const V t10 = -x0[4];
    y0[10] = t10;
    y0[13] = t10;
    const V t11 = -x0[5];
    y0[14] = t11;
    y0[0] = x0[0];
    y0[15] = x0[0];
    y0[1] = x0[1];
    y0[16] = x0[1];
    y0[2] = x0[2];
    y0[17] = x0[2];
    y0[6] = x0[3];
    y0[18] = x0[3];
    y0[7] = x0[4];
    y0[19] = x0[4];
    y0[11] = x0[5];
    y0[20] = x0[5];
}

static inline void derive_uniforms_one(const double* x0, double* __restrict y0) {
    const double t3 = 1.0 / x0[0];
    y0[1] = t3;
    y0[0] = x0[1];
}

static inline void derive_pack(const V* x0, const V* x1, V* __restrict y0, V* __restrict y1, V* __restrict y2) {
    const V t9 = x0[0] - x0[3];
    const V t10 = x0[1] - x0[4];
    const V t11 = x0[2] - x0[5];
    const V t12 = t9 * t9;
    const V t13 = t10 * t10;
    const V t14 = t11 * t11;
    const V t15 = t12 + t14;
    const V t16 = t13 + t15;
    const V t17 = x1[1] * t16;
    const V t18 = v_log(t17);
    const V t19 = x1[0] - t16;
    const V t20 = t19 * t19;
    const V t21 = t18 * t20;
    const V t23 = splat(2.0) * t21;
    const V t24 = splat(1.0) / t17;
    const V t25 = t23 * t24;
    const V t26 = x1[1] * t25;
    const V t27 = t18 * t18;
    const V t28 = t19 * t27;
    const V t29 = splat(2.0) * t28;
    const V t30 = t26 - t29;
    const V t31 = splat(2.0) * t30;
    const V t32 = t9 * t31;
    y1[0] = t32;
    const V t33 = t10 * t31;
    y1[1] = t33;
    const V t34 = t11 * t31;
    y1[2] = t34;
    const V t35 = x1[1] * t24;
    const V t36 = t20 * t35;
    const V t37 = t18 * t19;
    const V t38 = splat(2.0) * t37;
    const V t39 = t36 - t38;
    const V t40 = t24 * t39;
    const V t41 = splat(2.0) * t40;
    const V t42 = t24 * t24;
    const V t43 = t23 * t42;
    const V t44 = x1[1] * t43;
    const V t45 = t41 - t44;
    const V t46 = x1[1] * t45;
    const V t47 = t18 * t35;
    const V t48 = t19 * t47;
    const V t49 = splat(2.0) * t48;
    const V t50 = t27 - t49;
    const V t51 = splat(2.0) * t50;
    const V t52 = t46 + t51;
    const V t53 = splat(2.0) * t52;
    const V t54 = t11 * t53;
    const V t55 = splat(2.0) * t54;
    const V t56 = t9 * t55;
    y2[2] = t56;
    const V t57 = t10 * t55;
    y2[4] = t57;
    const V t58 = t11 * t55;
    const V t59 = t31 + t58;
    y2[5] = t59;
    const V t60 = t10 * t53;
    const V t61 = splat(2.0) * t60;
    const V t62 = t9 * t61;
    y2[1] = t62;
    const V t63 = t10 * t61;
    const V t64 = t31 + t63;
    y2[3] = t64;
    const V t65 = t9 * t53;
    const V t66 = t9 * t65;
    const V t67 = splat(2.0) * t66;
    const V t68 = t31 + t67;
    y2[0] = t68;
    const V t69 = t18 * t21;
    y0[0] = t69;
    const V t70 = -t32;
    y1[3] = t70;
    const V t71 = -t33;
    y1[4] = t71;
    const V t72 = -t34;
    y1[5] = t72;
}

extern "C" long yasps<both.pp.barrier.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* results) {
    const int* const p0 = (const int*)a[0];
    const long* const p1 = (const long*)a[1];
    const double* const p2 = (const double*)a[2];
    Arguments const p3 = (Arguments)a[3];
    const yasps_sink& sink = *results;
    double u0_one[2];
    derive_uniforms_one(p2, u0_one);
    V u0[2];
    for (long e = 0; e < 2; ++e) u0[e] = splat(u0_one[e]);
    LaneSlot slots[2] = {};
    for (long k = 0; k < 2; ++k) {
        LaneSlot& slot = slots[0 + k];
        slot.pull = yasps<both.v.x>_pull_lanes;
        slot.arguments = p3;
        slot.size = 3;
        slot.entry = 0 + k * 3;
        slot.leaf = 0 + k * 2;
    }
    V room_rows[18];
    V room_left[108];
    V room_right[72];
    V room_both[288];
    V room_block[162];
    int room_sizes[4];
    const LaneRoom room = {room_rows, room_left, room_right, room_both, room_block, room_sizes};
    V middle_of[16][6];
    const long most = sink.mode == 2 ? 8 : 128;
    for (long start = begin; start < end; start += most) {
        const long stop = end - start < most ? end : start + most;
        for (long first = start, pack = 0; first < stop; first += 8, ++pack) {
            const long lanes = stop - first < 8 ? stop - first : 8;
            V r0[6];
            long of[8];
            const double* at[8];
            for (long s = 0; s < 2; ++s) {
                connected_instances(p0 + first * 2 + s, 2, lanes, of);
                yasps<both.v.x>_value_lanes(p3, of, r0 + s * 3);
            }
            (void)of, (void)at;
            V energy[1], gradient[6];
            V* const middle = middle_of[pack];
            derive_pack(r0, u0, energy, gradient, middle);
            V check = sum_of_zeros(gradient, 6) + energy[0] * 0.0;
            if (any_not_finite(check))
                for (long l = 0; l < lanes; ++l)
                    if (check[l] != 0.0) return first + l;
            for (long k = 0; k < 2; ++k) {
                LaneSlot& slot = slots[k];
                connected_instances(p0 + first * 2 + 0 + k, 2, lanes, slot.of);
                for (long l = 0; l < 8; ++l) slot.branch[l] = (slot.of[l] < p1[1] ? 0 : slot.of[l] < p1[2] ? 1 : 0);
            }
            for (unsigned left = (1u << lanes) - 1; left;) {
                LaneSlot taken[2];
                const unsigned same = take_branches(slots, 2, left, taken);
                left &= ~same;
                add_gradient_of_lanes(sink, taken, 2, sink.kappa + first * 4, 4, same, gradient, room.both, room.sizes);
            }
        }
        if (!sink.tiles) continue;
        const long changed = sink.project((double*)middle_of, 3, (int)(stop - start), sink.mode);
        if (changed == YASPS_NO_MEMORY) return changed;
        if (changed < 0) return start - changed - 1;
        *sink.projected += changed;
        for (long first = start, pack = 0; first < stop; first += 8, ++pack) {
            const long lanes = stop - first < 8 ? stop - first : 8;
            V* const middle = middle_of[pack];
            V hessian[21];
            pull_back_pack(middle, hessian);
            for (long k = 0; k < 2; ++k) {
                LaneSlot& slot = slots[k];
                connected_instances(p0 + first * 2 + 0 + k, 2, lanes, slot.of);
                for (long l = 0; l < 8; ++l) slot.branch[l] = (slot.of[l] < p1[1] ? 0 : slot.of[l] < p1[2] ? 1 : 0);
            }
            for (unsigned left = (1u << lanes) - 1; left;) {
                LaneSlot taken[2];
                const unsigned same = take_branches(slots, 2, left, taken);
                left &= ~same;
                if (same == (1u << lanes) - 1 && all_direct(taken, 2)) {
                    {
                        static const short entry[] = {0, 1, 2, 1, 6, 7, 2, 7, 11, 3, 4, 5, 8, 9, 10, 12, 13, 14, 15, 16, 17, 16, 18, 19, 17, 19, 20};
                        static const short place[] = {0, 2, 7};
                        const long* const position = sink.position + first * 10;
                        add_packs_3x3(sink, position, 10, lanes, hessian, entry, place, 3);
                    }
                }
                else {
                    add_hessian_of_lanes(sink, taken, 2, sink.position + first * 10, 4, same, hessian, 6, room);
                }
            }
        }
    }
    return -1;
}

extern "C" void yasps<both.pp.barrier.derivative>_branches(Arguments a, long begin, long end, long* out) {
    const int* const p0 = (const int*)a[0];
    const long* const p1 = (const long*)a[1];
    const double* const p2 = (const double*)a[2];
    Arguments const p3 = (Arguments)a[3];
    for (long i = begin; i < end; ++i) {
        unsigned long number = 0;
        {
            const long j = (long)p0[i * 2 + 0];
            number = number * 2 + (j < p1[1] ? 0 : j < p1[2] ? 1 : 0);
        }
        {
            const long j = (long)p0[i * 2 + 1];
            number = number * 2 + (j < p1[1] ? 0 : j < p1[2] ? 1 : 0);
        }
        out[i - begin] = (long)number;
    }
}
