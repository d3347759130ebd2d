// backend/kernel_prelude.h stands here

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

extern "C" long yasps<both.v.x>_pull(Arguments, long, const double*, long, double*);
extern "C" void yasps<both.v.x>_value(Arguments, long, double*);
static inline void derive_pack(const V* x0, V* y0, V* y1) {
    const V t7 = x0[0] - x0[3];
    const V t8 = x0[1] - x0[4];
    const V t9 = x0[2] - x0[5];
    const V t11 = t7 * t7;
    const V t12 = t8 * t8;
    const V t13 = t9 * t9;
    const V t14 = t11 + t12;
    const V t15 = t13 + t14;
    const V t16 = t15 / splat(2.5);
    const V t17 = v_log(t16);
    const V t18 = splat(2.5) - t15;
    const V t19 = t18 * t18;
    const V t20 = t17 * t19;
    const V t21 = t20 + t20;
    const V t22 = splat(1.0) / t16;
    const V t23 = t21 * t22;
    const V t24 = t23 / splat(2.5);
    const V t25 = t17 * t17;
    const V t26 = t18 * t25;
    const V t27 = t26 + t26;
    const V t28 = t24 - t27;
    const V t30 = splat(2.0) * t28;
    const V t31 = t7 * t30;
    const V t32 = -t31;
    const V t33 = t8 * t30;
    const V t34 = -t33;
    const V t35 = t9 * t30;
    const V t36 = -t35;
    const V t37 = splat(2.0) * t9;
    const V t38 = t37 / splat(2.5);
    const V t39 = t22 * t38;
    const V t40 = t19 * t39;
    const V t41 = t18 * t37;
    const V t42 = t41 + t41;
    const V t43 = t17 * t42;
    const V t44 = t40 - t43;
    const V t45 = t44 + t44;
    const V t46 = t22 * t45;
    const V t47 = t16 * t16;
    const V t48 = splat(1.0) / t47;
    const V t49 = t38 * t48;
    const V t50 = t21 * t49;
    const V t51 = t46 - t50;
    const V t52 = t51 / splat(2.5);
    const V t53 = t25 * t37;
    const V t54 = t17 * t39;
    const V t55 = t54 + t54;
    const V t56 = t18 * t55;
    const V t57 = t53 - t56;
    const V t58 = t57 + t57;
    const V t59 = t52 + t58;
    const V t60 = splat(2.0) * t59;
    const V t61 = t7 * t60;
    const V t62 = t8 * t60;
    const V t63 = t9 * t60;
    const V t64 = t30 + t63;
    const V t65 = splat(2.0) * t8;
    const V t66 = t65 / splat(2.5);
    const V t67 = t22 * t66;
    const V t68 = t19 * t67;
    const V t69 = t18 * t65;
    const V t70 = t69 + t69;
    const V t71 = t17 * t70;
    const V t72 = t68 - t71;
    const V t73 = t72 + t72;
    const V t74 = t22 * t73;
    const V t75 = t48 * t66;
    const V t76 = t21 * t75;
    const V t77 = t74 - t76;
    const V t78 = t77 / splat(2.5);
    const V t79 = t25 * t65;
    const V t80 = t17 * t67;
    const V t81 = t80 + t80;
    const V t82 = t18 * t81;
    const V t83 = t79 - t82;
    const V t84 = t83 + t83;
    const V t85 = t78 + t84;
    const V t86 = splat(2.0) * t85;
    const V t87 = t7 * t86;
    const V t88 = t8 * t86;
    const V t89 = t30 + t88;
    const V t90 = splat(2.0) * t7;
    const V t91 = t90 / splat(2.5);
    const V t92 = t22 * t91;
    const V t93 = t19 * t92;
    const V t94 = t18 * t90;
    const V t95 = t94 + t94;
    const V t96 = t17 * t95;
    const V t97 = t93 - t96;
    const V t98 = t97 + t97;
    const V t99 = t22 * t98;
    const V t100 = t48 * t91;
    const V t101 = t21 * t100;
    const V t102 = t99 - t101;
    const V t103 = t102 / splat(2.5);
    const V t104 = t25 * t90;
    const V t105 = t17 * t92;
    const V t106 = t105 + t105;
    const V t107 = t18 * t106;
    const V t108 = t104 - t107;
    const V t109 = t108 + t108;
    const V t110 = t103 + t109;
    const V t111 = splat(2.0) * t110;
    const V t112 = t7 * t111;
    const V t113 = t30 + t112;
    y0[0] = t31;
    y0[1] = t33;
    y0[2] = t35;
    y0[3] = t32;
    y0[4] = t34;
    y0[5] = t36;
    y1[0] = t113;
    y1[1] = t87;
    y1[2] = t61;
    y1[3] = t89;
    y1[4] = t62;
    y1[5] = t64;
}

static inline void pull_back_pack(const V* x0, V* y0) {
    const V t6 = -x0[0];
    const V t7 = -x0[1];
    const V t8 = -x0[2];
    const V t9 = -x0[3];
    const V t10 = -x0[4];
    const V t11 = -x0[5];
    y0[0] = x0[0];
    y0[1] = x0[1];
    y0[2] = x0[2];
    y0[3] = t6;
    y0[4] = t7;
    y0[5] = t8;
    y0[6] = x0[3];
    y0[7] = x0[4];
    y0[8] = t7;
    y0[9] = t9;
    y0[10] = t10;
    y0[11] = x0[5];
    y0[12] = t8;
    y0[13] = t10;
    y0[14] = t11;
    y0[15] = x0[0];
    y0[16] = x0[1];
    y0[17] = x0[2];
    y0[18] = x0[3];
    y0[19] = x0[4];
    y0[20] = x0[5];
}

extern "C" long yasps<both.pp.barrier.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* sink) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[6];
        for (long l = 0; l < 8; ++l) {
            const long i = first + (l < lanes ? l : lanes - 1);
            double g0[6];
            for (long s = 0; s < 2; ++s) {
                const long j = p0[i * 2 + s];
                yasps<both.v.x>_value(p1, j, (g0 + s * 3));
            }
            for (long e = 0; e < 6; ++e) r0[e][l] = g0[e];
        }
        V gradient[6];
        V middle[6];
        derive_pack(r0, gradient, middle);
        V check = splat(0.0);
        for (long k = 0; k < 6; ++k) check += gradient[k] * 0.0;
        for (long k = 0; k < 6; ++k) check += middle[k] * 0.0;
        for (long l = 0; l < lanes; ++l)
            if (check[l] != 0.0) return first + l;  // not finite
        if (sink->blocks) {
            const long changed = sink->project((double*)middle, 3, (int)lanes, sink->mode);
            if (changed < 0) return first - changed - 1;
            *sink->projected += changed;
            V hessian[21];
            pull_back_pack(middle, hessian);
            for (long l = 0; l < lanes; ++l) {
                const long i = first + l;
                const int* const kappa = sink->kappa + i * 4;
                const long* const position = sink->position + i * 10;
                (void)kappa;
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = r; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(6, 0 + r, 0 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    double left[36], turned[36];
                    double both[144], block[144];
                    const long height = yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 0], b, 3, left);
                    if (height) {
                        for (long r = 0; r < height; ++r)
                            for (long c = 0; c < 3; ++c) turned[c * height + r] = left[r * 3 + c];
                        yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 0], turned, height, both);
                        long row = 0;
                        for (long p = 0; p < 2; ++p) {
                            if (!kappa[p]) continue;
                            const long rows = sink->block_size_at[kappa[p] - 1];
                            long col = 0;
                            for (long q = 0; q < 2; ++q) {
                                if (!kappa[q]) continue;
                                const long cols = sink->block_size_at[kappa[q] - 1];
                                if (q >= p) {
                                    for (long r = 0; r < rows; ++r)
                                        for (long c = 0; c < cols; ++c)
                                            block[r * cols + c] = both[(col + c) * height + row + r];
                                    add_block(sink->blocks, position[p * 4 - p * (p - 1) / 2 + q - p], block, rows, cols);
                                }
                                col += cols;
                            }
                            row += rows;
                        }
                    }
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(6, 0 + r, 3 + c)][l];
                    double left[36], turned[36];
                    double both[144], block[144];
                    const long height = yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 0], b, 3, left);
                    if (height) {
                        for (long r = 0; r < height; ++r)
                            for (long c = 0; c < 3; ++c) turned[c * height + r] = left[r * 3 + c];
                        yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 1], turned, height, both);
                        long row = 0;
                        for (long p = 0; p < 2; ++p) {
                            if (!kappa[p]) continue;
                            const long rows = sink->block_size_at[kappa[p] - 1];
                            long col = 0;
                            for (long q = 2; q < 4; ++q) {
                                if (!kappa[q]) continue;
                                const long cols = sink->block_size_at[kappa[q] - 1];
                                {
                                    for (long r = 0; r < rows; ++r)
                                        for (long c = 0; c < cols; ++c)
                                            block[r * cols + c] = both[(col + c) * height + row + r];
                                    add_block(sink->blocks, position[p * 4 - p * (p - 1) / 2 + q - p], block, rows, cols);
                                }
                                col += cols;
                            }
                            row += rows;
                        }
                    }
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = r; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(6, 3 + r, 3 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    double left[36], turned[36];
                    double both[144], block[144];
                    const long height = yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 1], b, 3, left);
                    if (height) {
                        for (long r = 0; r < height; ++r)
                            for (long c = 0; c < 3; ++c) turned[c * height + r] = left[r * 3 + c];
                        yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 1], turned, height, both);
                        long row = 0;
                        for (long p = 2; p < 4; ++p) {
                            if (!kappa[p]) continue;
                            const long rows = sink->block_size_at[kappa[p] - 1];
                            long col = 0;
                            for (long q = 2; q < 4; ++q) {
                                if (!kappa[q]) continue;
                                const long cols = sink->block_size_at[kappa[q] - 1];
                                if (q >= p) {
                                    for (long r = 0; r < rows; ++r)
                                        for (long c = 0; c < cols; ++c)
                                            block[r * cols + c] = both[(col + c) * height + row + r];
                                    add_block(sink->blocks, position[p * 4 - p * (p - 1) / 2 + q - p], block, rows, cols);
                                }
                                col += cols;
                            }
                            row += rows;
                        }
                    }
                }
            }
        }
        for (long l = 0; l < lanes; ++l) {
            const long i = first + l;
            const int* const kappa = sink->kappa + i * 4;
            {
                double b[3], rows[12];
                for (long e = 0; e < 3; ++e) b[e] = gradient[0 + e][l];
                yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 0], b, 1, rows);
                const double* row = rows;
                for (long k = 0; k < 2; ++k) {
                    if (!kappa[k]) continue;
                    const long size = sink->block_size_at[kappa[k] - 1];
                    for (long e = 0; e < size; ++e) sink->gradient[kappa[k] - 1 + e] += *row++;
                }
            }
            {
                double b[3], rows[12];
                for (long e = 0; e < 3; ++e) b[e] = gradient[3 + e][l];
                yasps<both.v.x>_pull(p1, (long)p0[i * 2 + 1], b, 1, rows);
                const double* row = rows;
                for (long k = 2; k < 4; ++k) {
                    if (!kappa[k]) continue;
                    const long size = sink->block_size_at[kappa[k] - 1];
                    for (long e = 0; e < size; ++e) sink->gradient[kappa[k] - 1 + e] += *row++;
                }
            }
            (void)i;
        }
    }
    return -1;
}
