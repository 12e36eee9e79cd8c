	.text
	.file	"x"
	.section	.rodata.cst4,"aM",@progbits,4
	.p2align	2, 0x0
.LCPI0_0:
	.long	0x7f800000
.LCPI0_3:
	.long	0x3f800000
	.section	.rodata.cst8,"aM",@progbits,8
	.p2align	3, 0x0
.LCPI0_1:
	.quad	0x7ff8000000000000
.LCPI0_2:
	.quad	0x3ff0000000000000
.LCPI0_4:
	.quad	0x7fffffffffffffff
.LCPI0_5:
	.quad	0x3ff6a09e667f3bcd
.LCPI0_6:
	.quad	0x4000000000000000
.LCPI0_7:
	.quad	0x4010000000000000
.LCPI0_8:
	.quad	0x4008000000000000
	.section	.rodata.cst32,"aM",@progbits,32
	.p2align	5, 0x0
.LCPI0_9:
	.zero	32
	.text
	.globl	drjit_b112f18434af1bc2fdbfe3724f257aa7
	.p2align	4, 0x90
	.type	drjit_b112f18434af1bc2fdbfe3724f257aa7,@function
drjit_b112f18434af1bc2fdbfe3724f257aa7:
	subq	$1064, %rsp
	vbroadcastsd	.LCPI0_4(%rip), %ymm0
	movq	24(%rcx), %rax
	movq	32(%rcx), %rdx
	movq	40(%rcx), %r8
	movq	48(%rcx), %r9
	movq	56(%rcx), %r10
	movq	64(%rcx), %r11
	movq	72(%rcx), %rcx
	vmovupd	%ymm0, 96(%rsp)
	.p2align	4, 0x90
.LBB0_1:
	vmovntdqa	(%rax,%rdi,4), %ymm0
	vmovntdqa	(%rdx,%rdi,4), %ymm2
	vxorps	%xmm4, %xmm4, %xmm4
	vbroadcastsd	.LCPI0_1(%rip), %ymm7
	vbroadcastsd	.LCPI0_2(%rip), %ymm5
	vcvtps2pd	(%rdx,%rdi,4), %ymm8
	vmovntdqa	(%r8,%rdi,4), %ymm1
	vxorps	%xmm9, %xmm9, %xmm9
	vmovupd	96(%rsp), %ymm14
	vcmpltps	%ymm0, %ymm4, %ymm3
	vcmpleps	%ymm2, %ymm4, %ymm4
	vmaxps	%ymm2, %ymm0, %ymm0
	vbroadcastss	.LCPI0_0(%rip), %ymm2
	vmovapd	%ymm5, %ymm13
	vmaxps	%ymm1, %ymm9, %ymm1
	vandps	%ymm3, %ymm4, %ymm3
	vmovupd	%ymm8, 960(%rsp)
	vcmpneq_oqps	%ymm2, %ymm0, %ymm0
	vandps	%ymm0, %ymm3, %ymm0
	vextractf128	$1, %ymm0, %xmm2
	vpackssdw	%xmm2, %xmm0, %xmm0
	vcvtps2pd	(%rax,%rdi,4), %ymm2
	vpmovsxwq	%xmm0, %ymm3
	vpunpckhwd	%xmm0, %xmm0, %xmm0
	vpslld	$31, %xmm0, %xmm0
	vpmovsxdq	%xmm0, %ymm0
	vblendvpd	%ymm3, %ymm2, %ymm7, %ymm3
	vmulpd	%ymm3, %ymm3, %ymm2
	vmovapd	%ymm3, %ymm6
	vmovupd	%ymm3, -96(%rsp)
	vsubpd	%ymm2, %ymm5, %ymm3
	vsubpd	%ymm3, %ymm5, %ymm4
	vsubpd	%ymm2, %ymm4, %ymm2
	vmulpd	%ymm8, %ymm8, %ymm4
	vaddpd	%ymm2, %ymm4, %ymm2
	vaddpd	%ymm6, %ymm6, %ymm4
	vmulpd	%ymm4, %ymm8, %ymm4
	vaddpd	%ymm2, %ymm3, %ymm5
	vmulpd	%ymm4, %ymm4, %ymm6
	vmovapd	%ymm4, %ymm8
	vmovupd	%ymm4, 32(%rsp)
	vmovapd	%ymm5, %ymm4
	vmovupd	%ymm5, 64(%rsp)
	vfmadd213pd	%ymm6, %ymm5, %ymm4
	vmovapd	%ymm6, %ymm11
	vmovupd	%ymm6, 672(%rsp)
	vmovapd	%ymm4, %ymm6
	vbroadcastss	.LCPI0_3(%rip), %ymm4
	vmovapd	%ymm6, %ymm10
	vmovupd	%ymm6, 928(%rsp)
	vminps	%ymm1, %ymm4, %ymm1
	vcvtps2pd	%xmm1, %ymm4
	vextractf128	$1, %ymm1, %xmm1
	vmulpd	%ymm4, %ymm4, %ymm12
	vmovapd	%ymm4, %ymm5
	vmovupd	%ymm4, 1024(%rsp)
	vcvtps2pd	%xmm1, %ymm1
	vsubpd	%ymm3, %ymm12, %ymm3
	vmovupd	%ymm1, 864(%rsp)
	vsubpd	%ymm2, %ymm3, %ymm3
	vcmpeqpd	%ymm6, %ymm9, %ymm2
	vmovapd	%ymm12, %ymm6
	vblendvpd	%ymm2, %ymm13, %ymm11, %ymm2
	vfmadd231pd	%ymm3, %ymm3, %ymm2
	vmovupd	%ymm3, 544(%rsp)
	vsqrtpd	%ymm2, %ymm9
	vandpd	%ymm3, %ymm14, %ymm2
	vaddpd	%ymm2, %ymm9, %ymm2
	vsqrtpd	%ymm2, %ymm2
	vdivpd	%ymm2, %ymm8, %ymm4
	vmovupd	%ymm2, 768(%rsp)
	vmovupd	%ymm4, 800(%rsp)
	vblendvpd	%ymm3, %ymm4, %ymm2, %ymm4
	vbroadcastsd	.LCPI0_5(%rip), %ymm3
	vmovupd	%ymm4, (%rsp)
	vmulpd	%ymm3, %ymm5, %ymm2
	vmovapd	%ymm3, %ymm15
	vsubpd	%ymm12, %ymm13, %ymm3
	vmulpd	%ymm4, %ymm2, %ymm8
	vmulpd	%ymm3, %ymm3, %ymm4
	vaddpd	%ymm9, %ymm12, %ymm2
	vmovapd	%ymm3, %ymm5
	vmovupd	%ymm3, -64(%rsp)
	vfmadd213pd	%ymm4, %ymm9, %ymm6
	vaddpd	%ymm2, %ymm8, %ymm2
	vmovupd	%ymm4, 416(%rsp)
	vmovapd	%ymm3, %ymm4
	vmovupd	%ymm2, 992(%rsp)
	vfmadd213pd	%ymm6, %ymm8, %ymm5
	vmovupd	%ymm6, -128(%rsp)
	vmulpd	%ymm5, %ymm2, %ymm2
	vmovapd	%ymm5, %ymm11
	vmovupd	%ymm5, 832(%rsp)
	vdivpd	%ymm2, %ymm13, %ymm2
	vmulpd	%ymm2, %ymm6, %ymm3
	vmulpd	%ymm3, %ymm5, %ymm3
	vmulpd	%ymm2, %ymm10, %ymm5
	vmulpd	%ymm2, %ymm8, %ymm2
	vmulpd	%ymm1, %ymm1, %ymm10
	vmulpd	%ymm3, %ymm5, %ymm3
	vaddpd	%ymm4, %ymm9, %ymm5
	vcvtps2pd	16(%rdx,%rdi,4), %ymm4
	vaddpd	%ymm5, %ymm11, %ymm5
	vmulpd	%ymm2, %ymm5, %ymm2
	vcmplepd	%ymm2, %ymm3, %ymm5
	vsubpd	%ymm2, %ymm13, %ymm2
	vmovapd	%ymm4, %ymm6
	vmovupd	%ymm4, 448(%rsp)
	vblendvpd	%ymm5, %ymm3, %ymm2, %ymm2
	vmovupd	%ymm2, 896(%rsp)
	vcvtps2pd	16(%rax,%rdi,4), %ymm2
	vblendvpd	%ymm0, %ymm2, %ymm7, %ymm2
	vmulpd	%ymm2, %ymm2, %ymm0
	vmovapd	%ymm2, %ymm5
	vmovupd	%ymm2, 576(%rsp)
	vsubpd	%ymm0, %ymm13, %ymm2
	vsubpd	%ymm2, %ymm13, %ymm3
	vsubpd	%ymm0, %ymm3, %ymm0
	vmulpd	%ymm4, %ymm4, %ymm3
	vaddpd	%ymm0, %ymm3, %ymm0
	vmovapd	%ymm1, %ymm3
	vsubpd	%ymm2, %ymm10, %ymm1
	vaddpd	%ymm0, %ymm2, %ymm4
	vsubpd	%ymm0, %ymm1, %ymm11
	vaddpd	%ymm5, %ymm5, %ymm0
	vmovapd	%ymm13, %ymm2
	vmulpd	%ymm6, %ymm0, %ymm0
	vmovupd	%ymm4, 320(%rsp)
	vmulpd	%ymm0, %ymm0, %ymm6
	vmovupd	%ymm0, 480(%rsp)
	vmovapd	%ymm0, %ymm5
	vmovupd	%ymm6, 224(%rsp)
	vfmadd213pd	%ymm6, %ymm4, %ymm4
	vcmpeqpd	.LCPI0_9(%rip), %ymm4, %ymm0
	vmovupd	%ymm9, 352(%rsp)
	vmovupd	%ymm12, 128(%rsp)
	vmovupd	%ymm4, 704(%rsp)
	vblendvpd	%ymm0, %ymm13, %ymm6, %ymm0
	vsubpd	%ymm10, %ymm13, %ymm13
	vfmadd231pd	%ymm11, %ymm11, %ymm0
	vsqrtpd	%ymm0, %ymm6
	vandpd	%ymm14, %ymm11, %ymm0
	vmulpd	%ymm13, %ymm13, %ymm14
	vaddpd	%ymm6, %ymm0, %ymm0
	vmovupd	%ymm6, 608(%rsp)
	vsqrtpd	%ymm0, %ymm0
	vdivpd	%ymm0, %ymm5, %ymm1
	vmovupd	%ymm0, 288(%rsp)
	vmovapd	%ymm10, %ymm5
	vfmadd213pd	%ymm14, %ymm6, %ymm5
	vmovupd	%ymm1, 256(%rsp)
	vblendvpd	%ymm11, %ymm1, %ymm0, %ymm1
	vmulpd	%ymm3, %ymm15, %ymm0
	vmovapd	%ymm13, %ymm3
	vmovupd	%ymm1, -32(%rsp)
	vmulpd	%ymm1, %ymm0, %ymm1
	vaddpd	%ymm6, %ymm10, %ymm0
	vfmadd213pd	%ymm5, %ymm1, %ymm3
	vaddpd	%ymm1, %ymm0, %ymm0
	vmovupd	%ymm0, 736(%rsp)
	vmulpd	%ymm3, %ymm0, %ymm0
	vmovupd	%ymm3, 384(%rsp)
	vdivpd	%ymm0, %ymm2, %ymm0
	vmulpd	%ymm0, %ymm5, %ymm7
	vmulpd	%ymm0, %ymm4, %ymm15
	vmulpd	%ymm0, %ymm1, %ymm0
	vbroadcastsd	.LCPI0_7(%rip), %ymm4
	vmulpd	%ymm7, %ymm3, %ymm7
	vmulpd	%ymm7, %ymm15, %ymm7
	vaddpd	%ymm6, %ymm13, %ymm15
	vaddpd	%ymm3, %ymm15, %ymm15
	vaddpd	%ymm11, %ymm11, %ymm3
	vmulpd	%ymm0, %ymm15, %ymm0
	vcmplepd	%ymm0, %ymm7, %ymm15
	vsubpd	%ymm0, %ymm2, %ymm0
	vblendvpd	%ymm15, %ymm7, %ymm0, %ymm0
	vmovapd	%ymm4, %ymm15
	vfmadd213pd	%ymm2, %ymm10, %ymm15
	vmovapd	%ymm10, %ymm7
	vmovupd	%ymm0, 640(%rsp)
	vmulpd	%ymm6, %ymm6, %ymm0
	vmovupd	%ymm0, 160(%rsp)
	vfmadd213pd	%ymm0, %ymm3, %ymm7
	vbroadcastsd	.LCPI0_6(%rip), %ymm0
	vfmadd213pd	%ymm14, %ymm6, %ymm15
	vfmsub231pd	%ymm11, %ymm10, %ymm14
	vmulpd	%ymm7, %ymm10, %ymm6
	vfnmadd231pd	%ymm15, %ymm13, %ymm6
	vmovapd	%ymm4, %ymm15
	vfmadd213pd	%ymm2, %ymm12, %ymm15
	vmovapd	%ymm9, %ymm4
	vmulpd	%ymm4, %ymm4, %ymm4
	vfmadd213pd	%ymm2, %ymm0, %ymm1
	vmovupd	%ymm4, 192(%rsp)
	vfnmadd231pd	%ymm1, %ymm5, %ymm6
	vmovapd	%ymm12, %ymm5
	vmovupd	672(%rsp), %ymm1
	vmovupd	%ymm6, 512(%rsp)
	vmovapd	%ymm2, %ymm6
	vmovupd	416(%rsp), %ymm2
	vfmadd213pd	%ymm6, %ymm0, %ymm8
	vfmadd213pd	%ymm2, %ymm9, %ymm15
	vmovupd	544(%rsp), %ymm9
	vmovapd	%ymm2, %ymm0
	vmovupd	576(%rsp), %ymm2
	vaddpd	%ymm9, %ymm9, %ymm7
	vfmsub231pd	%ymm9, %ymm12, %ymm0
	vfmadd213pd	%ymm4, %ymm7, %ymm5
	vmovupd	-64(%rsp), %ymm4
	vmulpd	%ymm5, %ymm12, %ymm5
	vfnmadd231pd	%ymm15, %ymm4, %ymm5
	vfnmadd231pd	-128(%rsp), %ymm8, %ymm5
	vsubpd	%ymm4, %ymm9, %ymm8
	vfnmadd132pd	64(%rsp), %ymm1, %ymm8
	vsubpd	%ymm12, %ymm4, %ymm6
	vsubpd	%ymm13, %ymm11, %ymm15
	vmulpd	%ymm6, %ymm12, %ymm6
	vmovupd	(%rsp), %ymm12
	vmulpd	%ymm6, %ymm1, %ymm6
	vmovupd	-32(%rsp), %ymm1
	vfmadd231pd	%ymm0, %ymm8, %ymm6
	vmovupd	%ymm5, -128(%rsp)
	vmovupd	320(%rsp), %ymm5
	vmovupd	224(%rsp), %ymm0
	vsubpd	%ymm10, %ymm13, %ymm8
	vmulpd	%ymm8, %ymm10, %ymm8
	vfnmadd213pd	%ymm0, %ymm5, %ymm15
	vmulpd	%ymm0, %ymm8, %ymm8
	vmovupd	256(%rsp), %ymm0
	vfmadd231pd	%ymm14, %ymm15, %ymm8
	vblendvpd	%ymm11, 288(%rsp), %ymm0, %ymm15
	vmovupd	448(%rsp), %ymm0
	vmovupd	480(%rsp), %ymm14
	vmulpd	%ymm0, %ymm15, %ymm4
	vmulpd	%ymm1, %ymm0, %ymm0
	vfmadd231pd	%ymm1, %ymm2, %ymm4
	vfmsub231pd	%ymm15, %ymm2, %ymm0
	vmulpd	%ymm13, %ymm14, %ymm15
	vmovupd	-96(%rsp), %ymm1
	vdivpd	%ymm4, %ymm15, %ymm15
	vblendvpd	%ymm11, %ymm0, %ymm15, %ymm15
	vmovupd	800(%rsp), %ymm0
	vblendvpd	%ymm9, 768(%rsp), %ymm0, %ymm2
	vmovupd	960(%rsp), %ymm0
	vmulpd	%ymm0, %ymm2, %ymm11
	vmulpd	%ymm0, %ymm12, %ymm0
	vfmadd231pd	%ymm12, %ymm1, %ymm11
	vmovupd	-64(%rsp), %ymm12
	vfmsub231pd	%ymm2, %ymm1, %ymm0
	vbroadcastsd	.LCPI0_2(%rip), %ymm2
	vmulpd	32(%rsp), %ymm12, %ymm1
	vdivpd	%ymm11, %ymm1, %ymm1
	vblendvpd	%ymm9, %ymm0, %ymm1, %ymm0
	vmovupd	%ymm0, -96(%rsp)
	vmovupd	384(%rsp), %ymm0
	vmulpd	%ymm0, %ymm0, %ymm0
	vdivpd	%ymm0, %ymm2, %ymm9
	vfmsub213pd	%ymm5, %ymm9, %ymm8
	vbroadcastsd	.LCPI0_8(%rip), %ymm5
	vfmadd231pd	%ymm5, %ymm13, %ymm3
	vfnmadd213pd	160(%rsp), %ymm13, %ymm3
	vfmadd231pd	%ymm5, %ymm12, %ymm7
	vfnmadd213pd	192(%rsp), %ymm12, %ymm7
	vmovupd	736(%rsp), %ymm5
	vfmadd132pd	128(%rsp), %ymm12, %ymm7
	vfmadd213pd	%ymm13, %ymm10, %ymm3
	vfmadd213pd	%ymm2, %ymm9, %ymm3
	vmulpd	%ymm9, %ymm13, %ymm9
	vmulpd	%ymm3, %ymm14, %ymm1
	vmovapd	%ymm2, %ymm3
	vmulpd	%ymm1, %ymm15, %ymm0
	vfmsub231pd	%ymm8, %ymm4, %ymm0
	vmulpd	%ymm8, %ymm15, %ymm8
	vfmadd231pd	%ymm4, %ymm1, %ymm8
	vmovupd	832(%rsp), %ymm1
	vmulpd	%ymm1, %ymm1, %ymm1
	vdivpd	%ymm1, %ymm2, %ymm2
	vmovupd	-96(%rsp), %ymm1
	vfmsub213pd	64(%rsp), %ymm2, %ymm6
	vfmadd213pd	%ymm3, %ymm2, %ymm7
	vmulpd	32(%rsp), %ymm7, %ymm4
	vmulpd	%ymm2, %ymm12, %ymm2
	vbroadcastsd	.LCPI0_5(%rip), %ymm12
	vmulpd	512(%rsp), %ymm9, %ymm7
	vmulpd	-128(%rsp), %ymm2, %ymm2
	vmulpd	%ymm1, %ymm4, %ymm3
	vmulpd	%ymm6, %ymm1, %ymm1
	vfmadd231pd	%ymm11, %ymm4, %ymm1
	vcvtpd2psy	640(%rsp), %xmm4
	vfmsub231pd	%ymm6, %ymm11, %ymm3
	vcvtpd2psy	896(%rsp), %xmm6
	vmovntpd	%xmm4, 16(%r9,%rdi,4)
	vmovupd	992(%rsp), %ymm4
	vmovntpd	%xmm6, (%r9,%rdi,4)
	vmulpd	%ymm5, %ymm5, %ymm6
	vmulpd	608(%rsp), %ymm6, %ymm6
	vmovupd	-32(%rsp), %ymm5
	vmulpd	704(%rsp), %ymm5, %ymm10
	vmovupd	(%rsp), %ymm5
	vmulpd	928(%rsp), %ymm5, %ymm11
	vmulpd	%ymm4, %ymm4, %ymm4
	vmulpd	352(%rsp), %ymm4, %ymm4
	vdivpd	%ymm6, %ymm12, %ymm9
	vdivpd	%ymm4, %ymm12, %ymm5
	vmulpd	%ymm9, %ymm10, %ymm10
	vmulpd	%ymm0, %ymm9, %ymm0
	vmulpd	%ymm7, %ymm10, %ymm7
	vmulpd	%ymm5, %ymm11, %ymm10
	vmulpd	%ymm3, %ymm5, %ymm3
	vmulpd	%ymm2, %ymm10, %ymm2
	vxorpd	%xmm10, %xmm10, %xmm10
	vcmpltpd	%ymm6, %ymm10, %ymm11
	vcmpltpd	%ymm4, %ymm10, %ymm4
	vmovupd	1024(%rsp), %ymm10
	vandpd	%ymm7, %ymm11, %ymm6
	vmovupd	864(%rsp), %ymm7
	vcvtpd2ps	%ymm6, %xmm6
	vandpd	%ymm2, %ymm4, %ymm2
	vcvtpd2ps	%ymm2, %xmm2
	vmovntpd	%xmm6, 16(%r10,%rdi,4)
	vmulpd	%ymm3, %ymm10, %ymm3
	vmulpd	%ymm7, %ymm0, %ymm0
	vmovntpd	%xmm2, (%r10,%rdi,4)
	vandpd	%ymm3, %ymm4, %ymm3
	vandpd	%ymm0, %ymm11, %ymm0
	vcvtpd2ps	%ymm3, %xmm3
	vcvtpd2ps	%ymm0, %xmm0
	vmovntpd	%xmm3, (%r11,%rdi,4)
	vmovntpd	%xmm0, 16(%r11,%rdi,4)
	vmulpd	%ymm1, %ymm5, %ymm0
	vmulpd	%ymm8, %ymm9, %ymm1
	vmulpd	%ymm7, %ymm1, %ymm1
	vmulpd	%ymm0, %ymm10, %ymm0
	vandpd	%ymm0, %ymm4, %ymm0
	vandpd	%ymm1, %ymm11, %ymm1
	vcvtpd2ps	%ymm0, %xmm0
	vcvtpd2ps	%ymm1, %xmm1
	vmovntpd	%xmm0, (%rcx,%rdi,4)
	vmovntpd	%xmm1, 16(%rcx,%rdi,4)
	addq	$8, %rdi
	cmpq	%rsi, %rdi
	jb	.LBB0_1
	addq	$1064, %rsp
	retq
.Lfunc_end0:
	.size	drjit_b112f18434af1bc2fdbfe3724f257aa7, .Lfunc_end0-drjit_b112f18434af1bc2fdbfe3724f257aa7

	.section	".note.GNU-stack","",@progbits
