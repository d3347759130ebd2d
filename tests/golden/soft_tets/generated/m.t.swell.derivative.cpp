// backend/kernel_prelude.h stands here

static inline void pull_back_pack(const V* x0, V* y0) {
    const V t45 = x0[0] + x0[6];
    const V t46 = x0[3] + t45;
    const V t47 = x0[1] + x0[14];
    const V t48 = x0[11] + t47;
    const V t49 = x0[2] + x0[21];
    const V t50 = x0[18] + t49;
    const V t51 = x0[3] + x0[27];
    const V t52 = x0[24] + t51;
    const V t53 = x0[4] + x0[32];
    const V t54 = x0[25] + t53;
    const V t55 = x0[5] + x0[36];
    const V t56 = x0[26] + t55;
    const V t57 = x0[6] + x0[39];
    const V t58 = x0[27] + t57;
    const V t59 = x0[7] + x0[40];
    const V t60 = x0[28] + t59;
    const V t61 = x0[8] + x0[41];
    const V t62 = x0[29] + t61;
    const V t63 = x0[1] + x0[7];
    const V t64 = x0[4] + t63;
    const V t65 = x0[9] + x0[15];
    const V t66 = x0[12] + t65;
    const V t67 = x0[10] + x0[22];
    const V t68 = x0[19] + t67;
    const V t69 = x0[11] + x0[28];
    const V t70 = x0[25] + t69;
    const V t71 = x0[12] + x0[33];
    const V t72 = x0[30] + t71;
    const V t73 = x0[13] + x0[37];
    const V t74 = x0[31] + t73;
    const V t75 = x0[14] + x0[40];
    const V t76 = x0[32] + t75;
    const V t77 = x0[15] + x0[42];
    const V t78 = x0[33] + t77;
    const V t79 = x0[16] + x0[43];
    const V t80 = x0[34] + t79;
    const V t81 = x0[2] + x0[8];
    const V t82 = x0[5] + t81;
    const V t83 = x0[10] + x0[16];
    const V t84 = x0[13] + t83;
    const V t85 = x0[17] + x0[23];
    const V t86 = x0[20] + t85;
    const V t87 = x0[18] + x0[29];
    const V t88 = x0[26] + t87;
    const V t89 = x0[19] + x0[34];
    const V t90 = x0[31] + t89;
    const V t91 = x0[20] + x0[38];
    const V t92 = x0[35] + t91;
    const V t93 = x0[21] + x0[41];
    const V t94 = x0[36] + t93;
    const V t95 = x0[22] + x0[43];
    const V t96 = x0[37] + t95;
    const V t97 = x0[23] + x0[44];
    const V t98 = x0[38] + t97;
    const V t99 = t46 + t58;
    const V t100 = t52 + t99;
    const V t101 = t64 + t76;
    const V t102 = t70 + t101;
    const V t103 = t82 + t94;
    const V t104 = t88 + t103;
    const V t105 = t66 + t78;
    const V t106 = t72 + t105;
    const V t107 = t84 + t96;
    const V t108 = t90 + t107;
    const V t109 = t86 + t98;
    const V t110 = t92 + t109;
    const V t111 = -t46;
    const V t112 = -t48;
    const V t113 = -t50;
    const V t114 = -t52;
    const V t115 = -t54;
    const V t116 = -t56;
    const V t117 = -t58;
    const V t118 = -t60;
    const V t119 = -t62;
    const V t120 = -t64;
    const V t121 = -t66;
    const V t122 = -t68;
    const V t123 = -t70;
    const V t124 = -t72;
    const V t125 = -t74;
    const V t126 = -t76;
    const V t127 = -t78;
    const V t128 = -t80;
    const V t129 = -t82;
    const V t130 = -t84;
    const V t131 = -t86;
    const V t132 = -t88;
    const V t133 = -t90;
    const V t134 = -t92;
    const V t135 = -t94;
    const V t136 = -t96;
    const V t137 = -t98;
    y0[0] = t100;
    y0[1] = t102;
    y0[2] = t104;
    y0[3] = t111;
    y0[4] = t112;
    y0[5] = t113;
    y0[6] = t114;
    y0[7] = t115;
    y0[8] = t116;
    y0[9] = t117;
    y0[10] = t118;
    y0[11] = t119;
    y0[12] = t106;
    y0[13] = t108;
    y0[14] = t120;
    y0[15] = t121;
    y0[16] = t122;
    y0[17] = t123;
    y0[18] = t124;
    y0[19] = t125;
    y0[20] = t126;
    y0[21] = t127;
    y0[22] = t128;
    y0[23] = t110;
    y0[24] = t129;
    y0[25] = t130;
    y0[26] = t131;
    y0[27] = t132;
    y0[28] = t133;
    y0[29] = t134;
    y0[30] = t135;
    y0[31] = t136;
    y0[32] = t137;
    y0[33] = x0[0];
    y0[34] = x0[1];
    y0[35] = x0[2];
    y0[36] = x0[3];
    y0[37] = x0[4];
    y0[38] = x0[5];
    y0[39] = x0[6];
    y0[40] = x0[7];
    y0[41] = x0[8];
    y0[42] = x0[9];
    y0[43] = x0[10];
    y0[44] = x0[11];
    y0[45] = x0[12];
    y0[46] = x0[13];
    y0[47] = x0[14];
    y0[48] = x0[15];
    y0[49] = x0[16];
    y0[50] = x0[17];
    y0[51] = x0[18];
    y0[52] = x0[19];
    y0[53] = x0[20];
    y0[54] = x0[21];
    y0[55] = x0[22];
    y0[56] = x0[23];
    y0[57] = x0[24];
    y0[58] = x0[25];
    y0[59] = x0[26];
    y0[60] = x0[27];
    y0[61] = x0[28];
    y0[62] = x0[29];
    y0[63] = x0[30];
    y0[64] = x0[31];
    y0[65] = x0[32];
    y0[66] = x0[33];
    y0[67] = x0[34];
    y0[68] = x0[35];
    y0[69] = x0[36];
    y0[70] = x0[37];
    y0[71] = x0[38];
    y0[72] = x0[39];
    y0[73] = x0[40];
    y0[74] = x0[41];
    y0[75] = x0[42];
    y0[76] = x0[43];
    y0[77] = x0[44];
}

static inline void derive_pack(const V* x0, V* y0, V* y1) {
    const V t12 = x0[0] - x0[9];
    const V t13 = x0[1] - x0[10];
    const V t14 = x0[2] - x0[11];
    const V t15 = x0[0] - x0[6];
    const V t16 = x0[1] - x0[7];
    const V t17 = x0[2] - x0[8];
    const V t18 = x0[0] - x0[3];
    const V t19 = x0[1] - x0[4];
    const V t20 = x0[2] - x0[5];
    const V t21 = t14 * t16;
    const V t22 = t13 * t17;
    const V t23 = t21 - t22;
    const V t24 = t14 * t15;
    const V t25 = t12 * t17;
    const V t26 = t24 - t25;
    const V t27 = t13 * t15;
    const V t28 = t12 * t16;
    const V t29 = t27 - t28;
    const V t30 = t14 * t19;
    const V t31 = t13 * t20;
    const V t32 = t30 - t31;
    const V t33 = t14 * t18;
    const V t34 = t12 * t20;
    const V t35 = t33 - t34;
    const V t36 = t13 * t18;
    const V t37 = t12 * t19;
    const V t38 = t36 - t37;
    const V t39 = t17 * t19;
    const V t40 = t16 * t20;
    const V t41 = t39 - t40;
    const V t42 = t17 * t18;
    const V t43 = t15 * t20;
    const V t44 = t42 - t43;
    const V t45 = t16 * t18;
    const V t46 = t15 * t19;
    const V t47 = t45 - t46;
    const V t49 = t18 * t23;
    const V t50 = t19 * t26;
    const V t51 = t20 * t29;
    const V t52 = splat(0.5) + t51;
    const V t53 = t49 + t52;
    const V t54 = t53 - t50;
    const V t56 = splat(6.0) * t54;
    const V t57 = t23 * t56;
    const V t58 = t26 * t56;
    const V t59 = t29 * t56;
    const V t60 = t32 * t56;
    const V t61 = t35 * t56;
    const V t62 = t38 * t56;
    const V t63 = t41 * t56;
    const V t64 = t44 * t56;
    const V t65 = t47 * t56;
    const V t66 = t57 + t63;
    const V t67 = t66 - t60;
    const V t68 = t61 - t64;
    const V t69 = t68 - t58;
    const V t70 = t59 + t65;
    const V t71 = t70 - t62;
    const V t72 = t16 * t56;
    const V t73 = t15 * t56;
    const V t74 = t19 * t56;
    const V t75 = t18 * t56;
    const V t76 = splat(6.0) * t47;
    const V t77 = t23 * t76;
    const V t78 = t26 * t76;
    const V t79 = t29 * t76;
    const V t80 = t32 * t76;
    const V t81 = t35 * t76;
    const V t82 = t38 * t76;
    const V t83 = t41 * t76;
    const V t84 = t44 * t76;
    const V t85 = t47 * t76;
    const V t86 = t72 + t77;
    const V t87 = t73 + t78;
    const V t88 = t74 + t80;
    const V t89 = t75 + t81;
    const V t90 = t17 * t56;
    const V t91 = t20 * t56;
    const V t92 = splat(6.0) * t44;
    const V t93 = t23 * t92;
    const V t94 = t26 * t92;
    const V t95 = t29 * t92;
    const V t96 = t32 * t92;
    const V t97 = t35 * t92;
    const V t98 = t38 * t92;
    const V t99 = t41 * t92;
    const V t100 = t44 * t92;
    const V t101 = t90 + t93;
    const V t102 = t73 - t95;
    const V t103 = t91 + t96;
    const V t104 = t98 - t75;
    const V t105 = splat(6.0) * t41;
    const V t106 = t23 * t105;
    const V t107 = t26 * t105;
    const V t108 = t29 * t105;
    const V t109 = t32 * t105;
    const V t110 = t35 * t105;
    const V t111 = t38 * t105;
    const V t112 = t41 * t105;
    const V t113 = t90 - t107;
    const V t114 = t108 - t72;
    const V t115 = t110 - t91;
    const V t116 = t74 - t111;
    const V t117 = t13 * t56;
    const V t118 = t12 * t56;
    const V t119 = splat(6.0) * t38;
    const V t120 = t23 * t119;
    const V t121 = t26 * t119;
    const V t122 = t29 * t119;
    const V t123 = t32 * t119;
    const V t124 = t35 * t119;
    const V t125 = t38 * t119;
    const V t126 = t117 + t120;
    const V t127 = t118 + t121;
    const V t128 = t14 * t56;
    const V t129 = splat(6.0) * t35;
    const V t130 = t23 * t129;
    const V t131 = t26 * t129;
    const V t132 = t29 * t129;
    const V t133 = t32 * t129;
    const V t134 = t35 * t129;
    const V t135 = t128 + t130;
    const V t136 = t132 - t118;
    const V t137 = splat(6.0) * t32;
    const V t138 = t23 * t137;
    const V t139 = t26 * t137;
    const V t140 = t29 * t137;
    const V t141 = t32 * t137;
    const V t142 = t139 - t128;
    const V t143 = t117 - t140;
    const V t144 = splat(6.0) * t29;
    const V t145 = t23 * t144;
    const V t146 = t26 * t144;
    const V t147 = t29 * t144;
    const V t148 = splat(6.0) * t26;
    const V t149 = t23 * t148;
    const V t150 = t26 * t148;
    const V t151 = t23 * t23;
    const V t152 = splat(6.0) * t151;
    const V t153 = -t57;
    const V t154 = -t59;
    const V t155 = -t61;
    const V t156 = -t63;
    const V t157 = -t65;
    const V t158 = -t149;
    const V t159 = -t138;
    const V t160 = -t126;
    const V t161 = -t101;
    const V t162 = -t146;
    const V t163 = -t131;
    const V t164 = -t87;
    const V t165 = -t122;
    const V t166 = -t133;
    const V t167 = -t109;
    const V t168 = -t88;
    const V t169 = -t124;
    const V t170 = -t97;
    const V t171 = -t82;
    const V t172 = -t99;
    const V t173 = -t84;
    y0[0] = t67;
    y0[1] = t69;
    y0[2] = t71;
    y0[3] = t153;
    y0[4] = t58;
    y0[5] = t154;
    y0[6] = t60;
    y0[7] = t155;
    y0[8] = t62;
    y0[9] = t156;
    y0[10] = t64;
    y0[11] = t157;
    y1[0] = t152;
    y1[1] = t158;
    y1[2] = t145;
    y1[3] = t159;
    y1[4] = t135;
    y1[5] = t160;
    y1[6] = t106;
    y1[7] = t161;
    y1[8] = t86;
    y1[9] = t150;
    y1[10] = t162;
    y1[11] = t142;
    y1[12] = t163;
    y1[13] = t127;
    y1[14] = t113;
    y1[15] = t94;
    y1[16] = t164;
    y1[17] = t147;
    y1[18] = t143;
    y1[19] = t136;
    y1[20] = t165;
    y1[21] = t114;
    y1[22] = t102;
    y1[23] = t79;
    y1[24] = t141;
    y1[25] = t166;
    y1[26] = t123;
    y1[27] = t167;
    y1[28] = t103;
    y1[29] = t168;
    y1[30] = t134;
    y1[31] = t169;
    y1[32] = t115;
    y1[33] = t170;
    y1[34] = t89;
    y1[35] = t125;
    y1[36] = t116;
    y1[37] = t104;
    y1[38] = t171;
    y1[39] = t112;
    y1[40] = t172;
    y1[41] = t83;
    y1[42] = t100;
    y1[43] = t173;
    y1[44] = t85;
}

extern "C" long yasps<m.t.swell.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* sink) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    V middle_of[16][45];
    for (long start = begin; start < end; start += 128) {
        const long stop = end - start < 128 ? end : start + 128;
        for (long first = start, pack = 0; first < stop; first += 8, ++pack) {
            const long lanes = stop - first < 8 ? stop - first : 8;
            V r0[12];
            for (long l = 0; l < 8; ++l) {
                const long i = first + (l < lanes ? l : lanes - 1);
                double g0[12];
                for (long s = 0; s < 4; ++s) {
                    const long j = p0[i * 4 + s];
                    for (long e = 0; e < 3; ++e) (g0 + s * 3)[e] = p1[j * 3 + e];
                }
                for (long e = 0; e < 12; ++e) r0[e][l] = g0[e];
            }
            V gradient[12];
            V* const middle = middle_of[pack];
            derive_pack(r0, gradient, middle);
            V check = splat(0.0);
            for (long k = 0; k < 12; ++k) check += gradient[k] * 0.0;
            for (long k = 0; k < 45; ++k) check += middle[k] * 0.0;
            for (long l = 0; l < lanes; ++l)
                if (check[l] != 0.0) return first + l;  // not finite
            for (long l = 0; l < lanes; ++l) {
                const long i = first + l;
                const int* const kappa = sink->kappa + i * 4;
                for (long e = 0; e < 3; ++e)
                    sink->gradient[kappa[0] - 1 + e] += gradient[0 + e][l];
                for (long e = 0; e < 3; ++e)
                    sink->gradient[kappa[1] - 1 + e] += gradient[3 + e][l];
                for (long e = 0; e < 3; ++e)
                    sink->gradient[kappa[2] - 1 + e] += gradient[6 + e][l];
                for (long e = 0; e < 3; ++e)
                    sink->gradient[kappa[3] - 1 + e] += gradient[9 + e][l];
                (void)i;
            }
        }
        if (!sink->blocks) continue;
        const long changed = sink->project((double*)middle_of, 9, (int)(stop - start), sink->mode);
        if (changed < 0) return start - changed - 1;
        *sink->projected += changed;
        for (long first = start, pack = 0; first < stop; first += 8, ++pack) {
            const long lanes = stop - first < 8 ? stop - first : 8;
            V* const middle = middle_of[pack];
            V hessian[78];
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
                            b[r * 3 + c] = hessian[packed(12, 0 + r, 0 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    add_block(sink->blocks, position[0 * 4 - 0 * (0 - 1) / 2 + 0 - 0], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 0 + r, 3 + c)][l];
                    add_block(sink->blocks, position[0 * 4 - 0 * (0 - 1) / 2 + 1 - 0], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 0 + r, 6 + c)][l];
                    add_block(sink->blocks, position[0 * 4 - 0 * (0 - 1) / 2 + 2 - 0], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 0 + r, 9 + c)][l];
                    add_block(sink->blocks, position[0 * 4 - 0 * (0 - 1) / 2 + 3 - 0], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = r; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 3 + r, 3 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    add_block(sink->blocks, position[1 * 4 - 1 * (1 - 1) / 2 + 1 - 1], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 3 + r, 6 + c)][l];
                    add_block(sink->blocks, position[1 * 4 - 1 * (1 - 1) / 2 + 2 - 1], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 3 + r, 9 + c)][l];
                    add_block(sink->blocks, position[1 * 4 - 1 * (1 - 1) / 2 + 3 - 1], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = r; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 6 + r, 6 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    add_block(sink->blocks, position[2 * 4 - 2 * (2 - 1) / 2 + 2 - 2], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = 0; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 6 + r, 9 + c)][l];
                    add_block(sink->blocks, position[2 * 4 - 2 * (2 - 1) / 2 + 3 - 2], b, 3, 3);
                }
                {
                    double b[9];
                    for (long r = 0; r < 3; ++r)
                        for (long c = r; c < 3; ++c)
                            b[r * 3 + c] = hessian[packed(12, 9 + r, 9 + c)][l];
                    for (long r = 1; r < 3; ++r)
                        for (long c = 0; c < r; ++c) b[r * 3 + c] = b[c * 3 + r];
                    add_block(sink->blocks, position[3 * 4 - 3 * (3 - 1) / 2 + 3 - 3], b, 3, 3);
                }
            }
        }
    }
    return -1;
}
