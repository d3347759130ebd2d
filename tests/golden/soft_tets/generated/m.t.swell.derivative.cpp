// backend/kernel_prelude.h stands here

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
    const V t52 = t49 - t50;
    const V t53 = t51 + t52;
    const V t54 = splat(0.5) + t53;
    const V t56 = splat(3.0) * t54;
    const V t57 = t56 + t56;
    const V t58 = t23 * t57;
    const V t59 = -t58;
    const V t60 = t26 * t57;
    const V t61 = t29 * t57;
    const V t62 = -t61;
    const V t63 = t32 * t57;
    const V t64 = t35 * t57;
    const V t65 = -t64;
    const V t66 = t38 * t57;
    const V t67 = t41 * t57;
    const V t68 = -t67;
    const V t69 = t44 * t57;
    const V t70 = t47 * t57;
    const V t71 = -t70;
    const V t72 = t58 - t63;
    const V t73 = t60 - t64;
    const V t74 = t61 - t66;
    const V t75 = t67 + t72;
    const V t76 = t69 + t73;
    const V t77 = -t76;
    const V t78 = t70 + t74;
    const V t79 = t16 * t57;
    const V t80 = t15 * t57;
    const V t81 = t19 * t57;
    const V t82 = t18 * t57;
    const V t83 = splat(3.0) * t47;
    const V t84 = t83 + t83;
    const V t85 = t23 * t84;
    const V t86 = t26 * t84;
    const V t87 = t29 * t84;
    const V t88 = t32 * t84;
    const V t89 = t35 * t84;
    const V t90 = t38 * t84;
    const V t91 = -t90;
    const V t92 = t41 * t84;
    const V t93 = t44 * t84;
    const V t94 = -t93;
    const V t95 = t47 * t84;
    const V t96 = t79 + t85;
    const V t97 = t80 + t86;
    const V t98 = -t97;
    const V t99 = t81 + t88;
    const V t100 = -t99;
    const V t101 = t82 + t89;
    const V t102 = t17 * t57;
    const V t103 = t20 * t57;
    const V t104 = splat(3.0) * t44;
    const V t105 = t104 + t104;
    const V t106 = t23 * t105;
    const V t107 = t26 * t105;
    const V t108 = t29 * t105;
    const V t109 = t32 * t105;
    const V t110 = t35 * t105;
    const V t111 = -t110;
    const V t112 = t38 * t105;
    const V t113 = t41 * t105;
    const V t114 = -t113;
    const V t115 = t44 * t105;
    const V t116 = t102 + t106;
    const V t117 = -t116;
    const V t118 = t80 - t108;
    const V t119 = t103 + t109;
    const V t120 = t82 - t112;
    const V t121 = -t120;
    const V t122 = splat(3.0) * t41;
    const V t123 = t122 + t122;
    const V t124 = t23 * t123;
    const V t125 = t26 * t123;
    const V t126 = t29 * t123;
    const V t127 = t32 * t123;
    const V t128 = -t127;
    const V t129 = t35 * t123;
    const V t130 = t38 * t123;
    const V t131 = t41 * t123;
    const V t132 = t102 - t125;
    const V t133 = t79 - t126;
    const V t134 = -t133;
    const V t135 = t103 - t129;
    const V t136 = -t135;
    const V t137 = t81 - t130;
    const V t138 = t13 * t57;
    const V t139 = t12 * t57;
    const V t140 = splat(3.0) * t38;
    const V t141 = t140 + t140;
    const V t142 = t23 * t141;
    const V t143 = t26 * t141;
    const V t144 = t29 * t141;
    const V t145 = -t144;
    const V t146 = t32 * t141;
    const V t147 = t35 * t141;
    const V t148 = -t147;
    const V t149 = t38 * t141;
    const V t150 = t138 + t142;
    const V t151 = -t150;
    const V t152 = t139 + t143;
    const V t153 = t14 * t57;
    const V t154 = splat(3.0) * t35;
    const V t155 = t154 + t154;
    const V t156 = t23 * t155;
    const V t157 = t26 * t155;
    const V t158 = -t157;
    const V t159 = t29 * t155;
    const V t160 = t32 * t155;
    const V t161 = -t160;
    const V t162 = t35 * t155;
    const V t163 = t153 + t156;
    const V t164 = t139 - t159;
    const V t165 = -t164;
    const V t166 = splat(3.0) * t32;
    const V t167 = t166 + t166;
    const V t168 = t23 * t167;
    const V t169 = -t168;
    const V t170 = t26 * t167;
    const V t171 = t29 * t167;
    const V t172 = t32 * t167;
    const V t173 = t153 - t170;
    const V t174 = -t173;
    const V t175 = t138 - t171;
    const V t176 = splat(3.0) * t29;
    const V t177 = t176 + t176;
    const V t178 = t23 * t177;
    const V t179 = t26 * t177;
    const V t180 = -t179;
    const V t181 = t29 * t177;
    const V t182 = splat(3.0) * t26;
    const V t183 = t182 + t182;
    const V t184 = t23 * t183;
    const V t185 = -t184;
    const V t186 = t26 * t183;
    const V t187 = splat(3.0) * t23;
    const V t188 = t187 + t187;
    const V t189 = t23 * t188;
    y0[0] = t75;
    y0[1] = t77;
    y0[2] = t78;
    y0[3] = t59;
    y0[4] = t60;
    y0[5] = t62;
    y0[6] = t63;
    y0[7] = t65;
    y0[8] = t66;
    y0[9] = t68;
    y0[10] = t69;
    y0[11] = t71;
    y1[0] = t189;
    y1[1] = t185;
    y1[2] = t178;
    y1[3] = t169;
    y1[4] = t163;
    y1[5] = t151;
    y1[6] = t124;
    y1[7] = t117;
    y1[8] = t96;
    y1[9] = t186;
    y1[10] = t180;
    y1[11] = t174;
    y1[12] = t158;
    y1[13] = t152;
    y1[14] = t132;
    y1[15] = t107;
    y1[16] = t98;
    y1[17] = t181;
    y1[18] = t175;
    y1[19] = t165;
    y1[20] = t145;
    y1[21] = t134;
    y1[22] = t118;
    y1[23] = t87;
    y1[24] = t172;
    y1[25] = t161;
    y1[26] = t146;
    y1[27] = t128;
    y1[28] = t119;
    y1[29] = t100;
    y1[30] = t162;
    y1[31] = t148;
    y1[32] = t136;
    y1[33] = t111;
    y1[34] = t101;
    y1[35] = t149;
    y1[36] = t137;
    y1[37] = t121;
    y1[38] = t91;
    y1[39] = t131;
    y1[40] = t114;
    y1[41] = t92;
    y1[42] = t115;
    y1[43] = t94;
    y1[44] = t95;
}

static inline void pull_back_pack(const V* x0, V* y0) {
    const V t45 = x0[0] + x0[3];
    const V t46 = x0[6] + t45;
    const V t47 = -t46;
    const V t48 = x0[1] + x0[11];
    const V t49 = x0[14] + t48;
    const V t50 = -t49;
    const V t51 = x0[2] + x0[18];
    const V t52 = x0[21] + t51;
    const V t53 = -t52;
    const V t54 = x0[3] + x0[24];
    const V t55 = x0[27] + t54;
    const V t56 = -t55;
    const V t57 = x0[4] + x0[25];
    const V t58 = x0[32] + t57;
    const V t59 = -t58;
    const V t60 = x0[5] + x0[26];
    const V t61 = x0[36] + t60;
    const V t62 = -t61;
    const V t63 = x0[6] + x0[27];
    const V t64 = x0[39] + t63;
    const V t65 = -t64;
    const V t66 = x0[7] + x0[28];
    const V t67 = x0[40] + t66;
    const V t68 = -t67;
    const V t69 = x0[8] + x0[29];
    const V t70 = x0[41] + t69;
    const V t71 = -t70;
    const V t72 = x0[1] + x0[4];
    const V t73 = x0[7] + t72;
    const V t74 = -t73;
    const V t75 = x0[9] + x0[12];
    const V t76 = x0[15] + t75;
    const V t77 = -t76;
    const V t78 = x0[10] + x0[19];
    const V t79 = x0[22] + t78;
    const V t80 = -t79;
    const V t81 = x0[11] + x0[25];
    const V t82 = x0[28] + t81;
    const V t83 = -t82;
    const V t84 = x0[12] + x0[30];
    const V t85 = x0[33] + t84;
    const V t86 = -t85;
    const V t87 = x0[13] + x0[31];
    const V t88 = x0[37] + t87;
    const V t89 = -t88;
    const V t90 = x0[14] + x0[32];
    const V t91 = x0[40] + t90;
    const V t92 = -t91;
    const V t93 = x0[15] + x0[33];
    const V t94 = x0[42] + t93;
    const V t95 = -t94;
    const V t96 = x0[16] + x0[34];
    const V t97 = x0[43] + t96;
    const V t98 = -t97;
    const V t99 = x0[2] + x0[5];
    const V t100 = x0[8] + t99;
    const V t101 = -t100;
    const V t102 = x0[10] + x0[13];
    const V t103 = x0[16] + t102;
    const V t104 = -t103;
    const V t105 = x0[17] + x0[20];
    const V t106 = x0[23] + t105;
    const V t107 = -t106;
    const V t108 = x0[18] + x0[26];
    const V t109 = x0[29] + t108;
    const V t110 = -t109;
    const V t111 = x0[19] + x0[31];
    const V t112 = x0[34] + t111;
    const V t113 = -t112;
    const V t114 = x0[20] + x0[35];
    const V t115 = x0[38] + t114;
    const V t116 = -t115;
    const V t117 = x0[21] + x0[36];
    const V t118 = x0[41] + t117;
    const V t119 = -t118;
    const V t120 = x0[22] + x0[37];
    const V t121 = x0[43] + t120;
    const V t122 = -t121;
    const V t123 = x0[23] + x0[38];
    const V t124 = x0[44] + t123;
    const V t125 = -t124;
    const V t126 = t46 + t55;
    const V t127 = t64 + t126;
    const V t128 = t73 + t82;
    const V t129 = t91 + t128;
    const V t130 = t100 + t109;
    const V t131 = t118 + t130;
    const V t132 = t76 + t85;
    const V t133 = t94 + t132;
    const V t134 = t103 + t112;
    const V t135 = t121 + t134;
    const V t136 = t106 + t115;
    const V t137 = t124 + t136;
    y0[0] = t127;
    y0[1] = t129;
    y0[2] = t131;
    y0[3] = t47;
    y0[4] = t50;
    y0[5] = t53;
    y0[6] = t56;
    y0[7] = t59;
    y0[8] = t62;
    y0[9] = t65;
    y0[10] = t68;
    y0[11] = t71;
    y0[12] = t133;
    y0[13] = t135;
    y0[14] = t74;
    y0[15] = t77;
    y0[16] = t80;
    y0[17] = t83;
    y0[18] = t86;
    y0[19] = t89;
    y0[20] = t92;
    y0[21] = t95;
    y0[22] = t98;
    y0[23] = t137;
    y0[24] = t101;
    y0[25] = t104;
    y0[26] = t107;
    y0[27] = t110;
    y0[28] = t113;
    y0[29] = t116;
    y0[30] = t119;
    y0[31] = t122;
    y0[32] = t125;
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

extern "C" long yasps<m.t.swell.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* sink) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
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
        V middle[45];
        derive_pack(r0, gradient, middle);
        V check = splat(0.0);
        for (long k = 0; k < 12; ++k) check += gradient[k] * 0.0;
        for (long k = 0; k < 45; ++k) check += middle[k] * 0.0;
        for (long l = 0; l < lanes; ++l)
            if (check[l] != 0.0) return first + l;  // not finite
        if (sink->blocks) {
            const long changed = sink->project((double*)middle, 9, (int)lanes, sink->mode);
            if (changed < 0) return first - changed - 1;
            *sink->projected += changed;
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
    return -1;
}
