// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

// backend/codegen/preludes/merge.h stands here

// backend/cpp/preludes/expand.h stands here

// backend/codegen/preludes/expand.h stands here

extern "C" void yasps<m.tips.x>_value_lanes(Arguments a, const long* own, V* out);
extern "C" long yasps<m.tips.x.jacobian>_pull(Arguments a, long i, const V* b, long n, V* out);
extern "C" void yasps<m.tips.x.jacobian>_curve(Arguments a, long i, const double* v, double* packed, long step, long width, const int* to);
static inline void derive_pack(const V* x0, V* __restrict y0, V* __restrict y1, V* __restrict y2) {
    const V t6 = x0[0] - x0[2];
    y1[0] = t6;
    const V t7 = x0[1] - x0[3];
    y1[1] = t7;
    const V t9 = t6 * t6;
    const V t10 = t7 * t7;
    const V t11 = t9 + t10;
    const V t13 = splat(0.5) * t11;
    y0[0] = t13;
    const V t14 = -t6;
    y1[2] = t14;
    const V t15 = -t7;
    y1[3] = t15;
    y2[0] = splat(1.0);
    y2[4] = splat(1.0);
    y2[7] = splat(1.0);
    y2[9] = splat(1.0);
    y2[1] = splat(0.0);
    y2[3] = splat(0.0);
    y2[5] = splat(0.0);
    y2[8] = splat(0.0);
    y2[2] = splat(-1.0);
    y2[6] = splat(-1.0);
}

extern "C" long yasps<m.springs.stretch.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* results) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    Arguments const p2 = (Arguments)a[2];
    const yasps_sink& sink = *results;
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[4];
        long of[8];
        const double* at[8];
        for (long s = 0; s < 2; ++s) {
            connected_instances(p0 + first * 2 + s, 2, lanes, of);
            yasps<m.tips.x>_value_lanes(p1, of, r0 + s * 2);
        }
        (void)of, (void)at;
        V energy[1], gradient[4];
        V middle[10];
        derive_pack(r0, energy, gradient, middle);
        V check = sum_of_zeros(gradient, 4) + energy[0] * 0.0;
        check += sum_of_zeros(middle, 10);
        if (any_not_finite(check))
            for (long l = 0; l < lanes; ++l)
                if (check[l] != 0.0) return first + l;
        if (sink.tiles) {
            for (long l = 0; l < lanes; ++l) {
                const long i = first + l;
                const int* const kappa = sink.kappa + i * 2;
                const long* const position = sink.position + i * 3;
                double v[4];
                for (long e = 0; e < 4; ++e) v[e] = gradient[e][l];
                V triangle_of_lane[2];
                double* const triangle = (double*)triangle_of_lane;
                for (long k = 0; k < 10; ++k) triangle[k] = middle[k][l];
                int leaf[2], start[3], to[2];
                const long leaves = merge_leaves(sink, kappa, 2, leaf, start, to), width = start[leaves];
                V triangle_of_lanes[3];
                // Lanes that nobody reads hold nothing that is slow.
                for (long k = 0; k < width * (width + 1) / 2; ++k) triangle_of_lanes[k] = splat(0.0);
                double* const packed = (double*)triangle_of_lanes;
                const long step = 8;
                long at[3];
                at[0] = 0;
                for (long k = 0; k < 2; ++k) {
                    at[1 + k] = at[k] + yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + k], (const V*)0, 0, (V*)0);
                }
                V rows0[2];
                V left0[1];
                copy_rows_of_triangle(triangle, 4, 0, 2, (double*)rows0, 8);
                const long height0 = yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + 0], rows0, 1, left0);
                V rows1[2];
                V left1[1];
                copy_rows_of_triangle(triangle, 4, 2, 2, (double*)rows1, 8);
                const long height1 = yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + 1], rows1, 1, left1);
                {
                    V right[2];
                    V both[1];
                    const long breadth = (height0 + 7) / 8, across = 8 * breadth;
                    for (long r = 0; breadth && r < 2; ++r) right[(r + 1) * breadth - 1] = splat(0.0);
                    long column = 0;
                    copy_transposed((const double*)left0 + 0, 8, height0, 2, (double*)right + column, across);
                    column += height0;
                    const long height = yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + 0], right, breadth, both);
                    const double* block = (const double*)both;
                    for (long r = 0; r < height; ++r) add_merged_row(packed, step, width, to, at[0], r, at[0], height0, block + r * across);
                    block += height0;
                    (void)column, (void)block, (void)height;
                }
                {
                    V right[2];
                    V both[1];
                    const long breadth = (height0 + height1 + 7) / 8, across = 8 * breadth;
                    for (long r = 0; breadth && r < 2; ++r) right[(r + 1) * breadth - 1] = splat(0.0);
                    long column = 0;
                    copy_transposed((const double*)left0 + 2, 8, height0, 2, (double*)right + column, across);
                    column += height0;
                    copy_transposed((const double*)left1 + 0, 8, height1, 2, (double*)right + column, across);
                    column += height1;
                    const long height = yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + 1], right, breadth, both);
                    const double* block = (const double*)both;
                    for (long r = 0; r < height; ++r) add_merged_row(packed, step, width, to, at[1], r, at[0], height0, block + r * across);
                    block += height0;
                    for (long r = 0; r < height; ++r) add_merged_row(packed, step, width, to, at[1], r, at[1], height1, block + r * across);
                    block += height1;
                    (void)column, (void)block, (void)height;
                }
                for (long k = 0; k < 2; ++k) {
                    yasps<m.tips.x.jacobian>_curve(p2, (long)p0[i * 2 + k], v + k * 2, packed, step, width, to + at[k]);
                }
                const long changed = sink.project(packed, (int)width, 1, sink.mode);
                if (changed < 0) return changed == YASPS_NO_MEMORY ? changed : i;
                *sink.projected += changed;
                scatter_merged(sink, position, 2, leaves, leaf, start, packed, step);
                (void)i;
            }
        }
        for (long l = 0; l < lanes; ++l) {
            const long i = first + l;
            const int* const kappa = sink.kappa + i * 2;
            for (long k = 0; k < 2; ++k) {
                V rows[1];
                V b[2];  // one column; the others are not looked at
                for (long e = 0; e < 2; ++e) b[e] = splat(gradient[k * 2 + e][l]);
                yasps<m.tips.x.jacobian>_pull(p2, (long)p0[i * 2 + k], b, 1, rows);
                add_gradient_rows(sink, kappa, i, 2, k, 1 + k, rows);
            }
            (void)i;
        }
    }
    return -1;
}
