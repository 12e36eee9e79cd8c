define void @drjit_b112f18434af1bc2fdbfe3724f257aa7(i64 %start, i64 %end, i32 %thread_id, ptr noalias %params) #0 {
entry:
    br label %body

body:
    %index = phi i64 [ %index_next, %suffix ], [ %start, %entry ]
    %f1_p1 = getelementptr inbounds ptr, ptr %params, i32 3
    %f1_p2 = load ptr, ptr %f1_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f1_p3 = getelementptr inbounds float, ptr %f1_p2, i64 %index
    %f1 = load <8 x float>, ptr %f1_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %f2_p1 = getelementptr inbounds ptr, ptr %params, i32 4
    %f2_p2 = load ptr, ptr %f2_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f2_p3 = getelementptr inbounds float, ptr %f2_p2, i64 %index
    %f2 = load <8 x float>, ptr %f2_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %f3_p1 = getelementptr inbounds ptr, ptr %params, i32 5
    %f3_p2 = load ptr, ptr %f3_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f3_p3 = getelementptr inbounds float, ptr %f3_p2, i64 %index
    %f3 = load <8 x float>, ptr %f3_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %d4_1 = insertelement <8 x double> undef, double 0x3ff0000000000000, i32 0
    %d4 = shufflevector <8 x double> %d4_1, <8 x double> undef, <8 x i32> zeroinitializer
    %f5_1 = insertelement <8 x float> undef, float 0x0, i32 0
    %f5 = shufflevector <8 x float> %f5_1, <8 x float> undef, <8 x i32> zeroinitializer
    %p6 = fcmp ogt <8 x float> %f1, %f5
    %p7 = fcmp oge <8 x float> %f2, %f5
    %p8 = and <8 x i1> %p6, %p7
    %p9 = fcmp ogt <8 x float> %f1, %f2
    %f10 = select <8 x i1> %p9, <8 x float> %f1, <8 x float> %f2
    %f11_1 = insertelement <8 x float> undef, float 0x7ff0000000000000, i32 0
    %f11 = shufflevector <8 x float> %f11_1, <8 x float> undef, <8 x i32> zeroinitializer
    %p12 = fcmp olt <8 x float> %f10, %f11
    %p13 = and <8 x i1> %p8, %p12
    %f14_1 = insertelement <8 x float> undef, float 0x7ff8000000000000, i32 0
    %f14 = shufflevector <8 x float> %f14_1, <8 x float> undef, <8 x i32> zeroinitializer
    %f15 = select <8 x i1> %p13, <8 x float> %f1, <8 x float> %f14
    %d16 = fpext <8 x float> %f15 to <8 x double>
    %d17 = fmul <8 x double> %d16, %d16
    %d18 = fsub <8 x double> %d4, %d17
    %d19 = fsub <8 x double> %d4, %d18
    %d20 = fsub <8 x double> %d19, %d17
    %d21 = fpext <8 x float> %f2 to <8 x double>
    %d22 = fmul <8 x double> %d21, %d21
    %d23 = fadd <8 x double> %d20, %d22
    %d24 = fadd <8 x double> %d18, %d23
    %d25 = fneg <8 x double> %d24
    %d26 = fadd <8 x double> %d16, %d16
    %d27 = fmul <8 x double> %d26, %d21
    %d28 = fmul <8 x double> %d27, %d27
    %d29 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d25, <8 x double> %d25, <8 x double> %d28)
    %p30 = fcmp olt <8 x float> %f3, %f5
    %f31 = select <8 x i1> %p30, <8 x float> %f5, <8 x float> %f3
    %f32_1 = insertelement <8 x float> undef, float 0x3ff0000000000000, i32 0
    %f32 = shufflevector <8 x float> %f32_1, <8 x float> undef, <8 x i32> zeroinitializer
    %p33 = fcmp ogt <8 x float> %f31, %f32
    %f34 = select <8 x i1> %p33, <8 x float> %f32, <8 x float> %f31
    %d35 = fpext <8 x float> %f34 to <8 x double>
    %d36 = fmul <8 x double> %d35, %d35
    %d37 = fsub <8 x double> %d36, %d18
    %d38 = fsub <8 x double> %d37, %d23
    %d39_1 = insertelement <8 x double> undef, double 0x0, i32 0
    %d39 = shufflevector <8 x double> %d39_1, <8 x double> undef, <8 x i32> zeroinitializer
    %p40 = fcmp oeq <8 x double> %d29, %d39
    %d41 = select <8 x i1> %p40, <8 x double> %d4, <8 x double> %d28
    %d42 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d38, <8 x double> %d38, <8 x double> %d41)
    %d43 = call <8 x double> @llvm.sqrt.v8f64(<8 x double> %d42)
    %d44 = fadd <8 x double> %d43, %d36
    %rd45 = bitcast <8 x double> %d38 to <8 x i64>
    %rd46_1 = insertelement <8 x i64> undef, i64 0, i32 0
    %rd46 = shufflevector <8 x i64> %rd46_1, <8 x i64> undef, <8 x i32> zeroinitializer
    %p47 = icmp slt <8 x i64> %rd45, %rd46
    %d48 = call <8 x double> @llvm.fabs.v8f64(<8 x double> %d38)
    %d49 = fadd <8 x double> %d43, %d48
    %d50 = call <8 x double> @llvm.sqrt.v8f64(<8 x double> %d49)
    %d51 = fdiv <8 x double> %d27, %d50
    %d52 = select <8 x i1> %p47, <8 x double> %d51, <8 x double> %d50
    %d53_1 = insertelement <8 x double> undef, double 0x3ff6a09e667f3bcd, i32 0
    %d53 = shufflevector <8 x double> %d53_1, <8 x double> undef, <8 x i32> zeroinitializer
    %d54 = fmul <8 x double> %d35, %d53
    %d55 = fmul <8 x double> %d52, %d54
    %d56 = fadd <8 x double> %d44, %d55
    %d57 = fsub <8 x double> %d4, %d36
    %d58 = fmul <8 x double> %d57, %d57
    %d59 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d43, <8 x double> %d36, <8 x double> %d58)
    %d60 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d55, <8 x double> %d57, <8 x double> %d59)
    %d61 = fmul <8 x double> %d56, %d60
    %d62 = fdiv <8 x double> %d4, %d61
    %d63 = fmul <8 x double> %d29, %d62
    %d64 = fmul <8 x double> %d59, %d62
    %d65 = fmul <8 x double> %d64, %d60
    %d66 = fmul <8 x double> %d63, %d65
    %d67 = fmul <8 x double> %d55, %d62
    %d68 = fadd <8 x double> %d43, %d57
    %d69 = fadd <8 x double> %d60, %d68
    %d70 = fmul <8 x double> %d67, %d69
    %p71 = fcmp ole <8 x double> %d66, %d70
    %d72 = fsub <8 x double> %d4, %d70
    %d73 = select <8 x i1> %p71, <8 x double> %d66, <8 x double> %d72
    %f74_p1 = getelementptr inbounds ptr, ptr %params, i32 6
    %f74_p2 = load ptr, ptr %f74_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f74_p3 = getelementptr inbounds float, ptr %f74_p2, i64 %index
    %f74 = fptrunc <8 x double> %d73 to <8 x float>
    store <8 x float> %f74, ptr %f74_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %d75 = fmul <8 x double> %d56, %d56
    %d76 = fmul <8 x double> %d75, %d43
    %p77 = fcmp ogt <8 x double> %d76, %d39
    %d78 = fmul <8 x double> %d29, %d52
    %d79 = fdiv <8 x double> %d53, %d76
    %d80 = fmul <8 x double> %d78, %d79
    %d81 = fmul <8 x double> %d60, %d60
    %d82 = fdiv <8 x double> %d4, %d81
    %d83 = fmul <8 x double> %d57, %d82
    %d84 = fneg <8 x double> %d59
    %d85_1 = insertelement <8 x double> undef, double 0x4000000000000000, i32 0
    %d85 = shufflevector <8 x double> %d85_1, <8 x double> undef, <8 x i32> zeroinitializer
    %d86 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d55, <8 x double> %d85, <8 x double> %d4)
    %d87 = fneg <8 x double> %d57
    %d88_1 = insertelement <8 x double> undef, double 0x4010000000000000, i32 0
    %d88 = shufflevector <8 x double> %d88_1, <8 x double> undef, <8 x i32> zeroinitializer
    %d89 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d36, <8 x double> %d88, <8 x double> %d4)
    %d90 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d43, <8 x double> %d89, <8 x double> %d58)
    %d91 = fadd <8 x double> %d38, %d38
    %d92 = fmul <8 x double> %d43, %d43
    %d93 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d91, <8 x double> %d36, <8 x double> %d92)
    %d94 = fmul <8 x double> %d36, %d93
    %d95 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d87, <8 x double> %d90, <8 x double> %d94)
    %d96 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d84, <8 x double> %d86, <8 x double> %d95)
    %d97 = fmul <8 x double> %d83, %d96
    %d98 = fmul <8 x double> %d80, %d97
    %d99 = select <8 x i1> %p77, <8 x double> %d98, <8 x double> %d39
    %f100_p1 = getelementptr inbounds ptr, ptr %params, i32 7
    %f100_p2 = load ptr, ptr %f100_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f100_p3 = getelementptr inbounds float, ptr %f100_p2, i64 %index
    %f100 = fptrunc <8 x double> %d99 to <8 x float>
    store <8 x float> %f100, ptr %f100_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %d101 = select <8 x i1> %p47, <8 x double> %d50, <8 x double> %d51
    %d102 = fmul <8 x double> %d21, %d101
    %d103 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d16, <8 x double> %d52, <8 x double> %d102)
    %d104 = fsub <8 x double> %d38, %d57
    %d105 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d25, <8 x double> %d104, <8 x double> %d28)
    %d106 = fneg <8 x double> %d58
    %d107 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d36, <8 x double> %d38, <8 x double> %d106)
    %d108 = fsub <8 x double> %d57, %d36
    %d109 = fmul <8 x double> %d36, %d108
    %d110 = fmul <8 x double> %d28, %d109
    %d111 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d105, <8 x double> %d107, <8 x double> %d110)
    %d112 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d111, <8 x double> %d82, <8 x double> %d25)
    %d113 = fmul <8 x double> %d21, %d52
    %d114 = fneg <8 x double> %d113
    %d115 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d16, <8 x double> %d101, <8 x double> %d114)
    %d116 = fmul <8 x double> %d27, %d57
    %d117 = fdiv <8 x double> %d116, %d103
    %d118 = select <8 x i1> %p47, <8 x double> %d115, <8 x double> %d117
    %d119_1 = insertelement <8 x double> undef, double 0x4008000000000000, i32 0
    %d119 = shufflevector <8 x double> %d119_1, <8 x double> undef, <8 x i32> zeroinitializer
    %d120 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d57, <8 x double> %d119, <8 x double> %d91)
    %d121 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d87, <8 x double> %d120, <8 x double> %d92)
    %d122 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d36, <8 x double> %d121, <8 x double> %d57)
    %d123 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d122, <8 x double> %d82, <8 x double> %d4)
    %d124 = fmul <8 x double> %d27, %d123
    %d125 = fmul <8 x double> %d118, %d124
    %d126 = fneg <8 x double> %d125
    %d127 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d103, <8 x double> %d112, <8 x double> %d126)
    %d128 = fmul <8 x double> %d79, %d127
    %d129 = fmul <8 x double> %d128, %d35
    %d130 = select <8 x i1> %p77, <8 x double> %d129, <8 x double> %d39
    %f131_p1 = getelementptr inbounds ptr, ptr %params, i32 8
    %f131_p2 = load ptr, ptr %f131_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f131_p3 = getelementptr inbounds float, ptr %f131_p2, i64 %index
    %f131 = fptrunc <8 x double> %d130 to <8 x float>
    store <8 x float> %f131, ptr %f131_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    %d132 = fmul <8 x double> %d118, %d112
    %d133 = call <8 x double> @llvm.fma.v8f64(<8 x double> %d103, <8 x double> %d124, <8 x double> %d132)
    %d134 = fmul <8 x double> %d79, %d133
    %d135 = fmul <8 x double> %d134, %d35
    %d136 = select <8 x i1> %p77, <8 x double> %d135, <8 x double> %d39
    %f137_p1 = getelementptr inbounds ptr, ptr %params, i32 9
    %f137_p2 = load ptr, ptr %f137_p1, align 8, !alias.scope !2, !noalias !2, !invariant.load !4
    %f137_p3 = getelementptr inbounds float, ptr %f137_p2, i64 %index
    %f137 = fptrunc <8 x double> %d136 to <8 x float>
    store <8 x float> %f137, ptr %f137_p3, align 32, !alias.scope !2, !noalias !2, !nontemporal !3
    br label %suffix

suffix:
    %index_next = add i64 %index, 8
    %cond = icmp uge i64 %index_next, %end
    br i1 %cond, label %done, label %body, !llvm.loop !5

done:
    ret void
}

declare <8 x double> @llvm.sqrt.v8f64(<8 x double>)

declare <8 x double> @llvm.fabs.v8f64(<8 x double>)

declare <8 x double> @llvm.fma.v8f64(<8 x double>, <8 x double>, <8 x double>)

!0 = !{!0}
!1 = !{!1, !0}
!2 = !{!1}
!3 = !{i32 1}
!4 = !{}
!5 = !{!"llvm.loop.unroll.disable", !"llvm.loop.vectorize.enable", i1 0}

attributes #0 = { norecurse nounwind "frame-pointer"="none" "no-builtins" "no-stack-arg-probe" "target-cpu"="znver3" "target-features"="-vzeroupper,+prfchw,-cldemote,+avx,+aes,+sahf,+pclmul,-xop,+crc32,+xsaves,-avx512fp16,-usermsr,-sm4,-egpr,+sse4.1,-avx512ifma,+xsave,+sse4.2,-tsxldtrk,-sm3,-ptwrite,-widekl,+invpcid,+64bit,+xsavec,-avx10.1-512,-avx512vpopcntdq,+cmov,-avx512vp2intersect,-avx512cd,+movbe,-avxvnniint8,-ccmp,-amx-int8,-kl,-avx10.1-256,-sha512,-avxvnni,-rtm,+adx,+avx2,-hreset,-movdiri,-serialize,+vpclmulqdq,-avx512vl,-uintr,-cf,+clflushopt,-raoint,-cmpccxadd,+bmi,-amx-tile,+sse,-gfni,-avxvnniint16,-amx-fp16,-ndd,+xsaveopt,+rdrnd,-avx512f,-amx-bf16,-avx512bf16,-avx512vnni,-push2pop2,+cx8,-avx512bw,+sse3,-pku,+fsgsbase,+clzero,-mwaitx,-lwp,+lzcnt,+sha,-movdir64b,-ppx,-wbnoinvd,-enqcmd,-avxneconvert,-tbm,-pconfig,-amx-complex,+ssse3,+cx16,+bmi2,+fma,+popcnt,-avxifma,+f16c,-avx512bitalg,-rdpru,+clwb,+mmx,+sse2,+rdseed,-avx512vbmi2,-prefetchi,+rdpid,-fma4,-avx512vbmi,+shstk,+vaes,-waitpkg,-sgx,+fxsr,-avx512dq,+sse4a" }