# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Hard cases
#
# Renderers meet the limits of the Fresnel equations in every frame: the cosine is 0 at each
# silhouette, the index is 1 where two media meet, and the critical angle runs through every glass
# of water. Here we look at what single precision does there, at the derivatives that an optimiser
# gets, and then at what *no* sum of a few smooth functions can follow.

# %%
try:
    from fresnel_decomp.notebook import fast, fd, mi, np, plt, style
except ModuleNotFoundError as missing:  # as in Colab
    raise ModuleNotFoundError(
        f"{missing}. In cells of their own run !git clone ADDRESS_OF_THE_REPOSITORY clone and "
        "%pip install ./clone (in the notebooks folder of a clone: just %pip install ..), "
        "then run this cell again."
    ) from None

print(mi.variant())


# %% [markdown]
# ## 1. The critical angle, in single precision
#
# From glass to air reflection is total beyond the critical angle. Just before it, reflectance falls
# like the *square root* of the distance, and that distance is a difference of nearly equal numbers.
# A rounding error of $6 \cdot 10^{-8}$ becomes one of $10^{-3}$.
#
# We evaluate the same equations in float32 with Mitsuba's functions and with ours, and in float64,
# at consecutive float32 cosines.


# %%
def mitsubas(function, *arguments: np.ndarray) -> np.ndarray:
    """Values of a function of Mitsuba's, in float32; one by one where it has no arrays."""
    arguments = [values.ravel() for values in np.broadcast_arrays(*arguments)]
    if fast:
        return np.array(function(*(mi.Float(np.ascontiguousarray(a)) for a in arguments)))
    return np.array(
        [function(*point) for point in zip(*map(np.ndarray.tolist, arguments), strict=True)]
    )


def consecutive(start: float, count: int) -> np.ndarray:
    """Float32 numbers next to each other, around a first one."""
    bits = np.float32(start).view(np.int32) + np.arange(-count // 2, count // 2, dtype=np.int32)
    return bits.view(np.float32)


eta = np.float32(1 / 1.5)
cos_theta = consecutive(np.sqrt(1.0 - float(eta) ** 2), 120)
truth = fd.dielectric(cos_theta.astype(np.float64), float(eta))
ours = fd.dielectric(cos_theta, eta)
theirs = mitsubas(lambda c, n: mi.fresnel(c, n)[0], cos_theta, eta)

fig, axes = plt.subplots(1, 2, layout="constrained")
step = np.arange(len(cos_theta)) - len(cos_theta) // 2
axes[0].plot(step, truth, "k", lw=2.5, alpha=0.4, label="float64")
axes[0].plot(step, theirs, ".", ms=4, color="tab:orange", label="mi.fresnel, float32")
axes[0].plot(step, ours, ".", ms=2, color="tab:blue", label="fd.dielectric, float32")
axes[0].set(title="reflectance", xlabel="float32 cosines from the critical angle")
axes[0].legend()
axes[1].semilogy(step, np.abs(theirs - truth) + 1e-12, ".", ms=4, color="tab:orange")
axes[1].semilogy(step, np.abs(ours - truth) + 1e-12, ".", ms=4, color="tab:blue")
axes[1].set(title="absolute error", xlabel="float32 cosines from the critical angle")
plt.show()
for name, values in (("mi.fresnel", theirs), ("fd.dielectric", ours)):
    print(f"{name:14} largest error {np.abs(values - truth).max():.1e}")

# %% [markdown]
# ## 2. The whole neighbourhood
#
# The same for every index and angle, with a little absorption: errors of `mi.fresnel_conductor` and
# of `fd.conductor` against float64, on a logarithmic scale from $10^{-8}$ (black) to 1. Upwards the
# surface is seen at ever flatter angles; to the right the two media become the same.

# %%
size = 192 if fast else 64
gap = np.geomspace(0.5, 1e-7, size)  # 1 - eta
grazing = np.geomspace(1e-5, 1.0, size)[:, None]
etas, cosines = np.broadcast_arrays((1.0 - gap).astype(np.float32), grazing.astype(np.float32))
k = np.float32(1e-6)
truth = fd.conductor(cosines.astype(np.float64), etas.astype(np.float64), float(k))
theirs = mitsubas(
    lambda c, n, k: mi.fresnel_conductor(c, mi.Complex2f(n, k)), cosines, etas, k
).reshape(truth.shape)
errors = {
    "mi.fresnel_conductor": np.abs(np.nan_to_num(theirs, nan=1.0) - truth),
    "fd.conductor, native": np.abs(fd.conductor(cosines, etas, k, precision="native") - truth),
    "fd.conductor": np.abs(fd.conductor(cosines, etas, k) - truth),
}
fig, axes = plt.subplots(1, 4, figsize=(9.5, 2.8), layout="constrained", sharey=True)
extent = (-np.log10(gap[0]), -np.log10(gap[-1]), np.log10(grazing[0, 0]), 0)
reflectance = axes[0].imshow(truth, origin="lower", extent=extent, aspect="auto", cmap="gray")
axes[0].set(title="reflectance", ylabel=r"$\log_{10}\cos\theta$", xlabel=r"$-\log_{10}(1-\eta)$")
for ax, (name, error) in zip(axes[1:], errors.items(), strict=True):
    shown = ax.imshow(
        np.log10(np.maximum(error, 1e-12)), origin="lower", extent=extent, aspect="auto",
        cmap=style.SEQUENTIAL, vmin=-8, vmax=0,
    )  # fmt: skip
    ax.set(title=name, xlabel=r"$-\log_{10}(1-\eta)$")
for ax in axes:
    ax.grid(False)
fig.colorbar(shown, ax=axes[1:], label=r"$\log_{10}$ error")
plt.show()
for name, error in errors.items():
    print(f"{name:21} largest error {error.max():.1e}, above 1e-4 in {np.mean(error > 1e-4):.1%}")

# %% [markdown]
# What makes the difference is not more digits everywhere but knowing where they go: the squares and
# sums that vanish at the critical angle carry their rounding errors along
# (`docs/stability.md` has the formulas). `precision="native"` does that in float32 alone; the
# default, `"wide"`, evaluates in float64 and rounds once.
#
# ## 3. Derivatives
#
# An optimiser sees only derivatives. Mitsuba's are what automatic differentiation makes of its
# formulas: where a root is clamped they are 0, and where the value cancels they are noise. Ours are
# closed forms. Judge: central differences of the float64 function, one-sided where k = 0.

# %%
points = {
    "total reflection, no absorption": (0.3, 0.7, 0.0),
    "total reflection, a little": (0.3, 0.7, 1e-4),
    "near the critical angle": (0.7142, 0.7, 1e-4),
    "nearly matched": (0.01, 1.00001, 0.0),
    "good metal": (0.5, 0.05, 4.0),
    "glass": (0.5, 1.5, 0.0),
}


def by_differences(c: float, eta: float, k: float) -> tuple[float, float]:
    h = 1e-9

    def at(de: float, dk: float) -> float:
        return fd.conductor(c, eta + de * h, k + dk * h)

    one_sided = (4 * at(0, 0.5) - at(0, 1) - 3 * at(0, 0)) / h
    in_k = one_sided if k < h else (at(0, 1) - at(0, -1)) / (2 * h)
    return (at(1, 0) - at(-1, 0)) / (2 * h), in_k


def by_drjit(function, c: float, eta: float, k: float) -> tuple[float, float]:
    import drjit as dr

    eta, k = mi.Float(eta), mi.Float(k)
    dr.enable_grad(eta, k)
    dr.backward(function(mi.Float(c), eta, k))
    return dr.grad(eta)[0], dr.grad(k)[0]


if fast:
    print(f"{'dR/deta, dR/dk':32} {'differences':>20} {'fd.conductor':>20} {'Mitsuba':>20}")
    for name, point in points.items():
        rows = (
            by_differences(*point),
            by_drjit(fd.conductor, *point),
            by_drjit(lambda c, n, k: mi.fresnel_conductor(c, mi.Complex2f(n, k)), *point),
        )
        print(f"{name:32}", *(f"{a:>10.3g}{b:>10.3g}" for a, b in rows))
else:
    print("derivatives need an LLVM or CUDA variant")

# %% [markdown]
# In the first row Mitsuba's derivative in `k` is 0: an optimiser that starts from a lossless medium
# never learns that it may absorb.
#
# ## 4. What no basis follows
#
# Every function of the decomposition is smooth, and so is every sum of them. A curve with total
# internal reflection has a kink. Absorption rounds the kink, slowly.

# %%
basis = fd.load_basis()
degrees = np.linspace(0.0, 90.0, 721)
cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)
fig, axes = plt.subplots(1, 4, figsize=(9.5, 2.6), layout="constrained", sharey=True)
for ax, k in zip(axes, (0.0, 0.05, 0.3, 1.0), strict=True):
    c = basis.coefficients(0.67, k, poor_fit="keep")
    for name, values in (
        ("exact", fd.conductor(cos_theta, 0.67, k)),
        ("decomposition", basis.evaluate(c, cos_theta)),
        ("schlick", fd.Schlick.from_ior(0.67, k)(cos_theta)),
    ):
        ax.plot(
            degrees, values, color=style.MODEL_COLOURS[name], ls=style.MODEL_LINES[name],
            label=style.MODEL_LABELS[name],
        )  # fmt: skip
    refused = "refused" if basis.poor_fit(0.67, k) else "accepted"
    error = float(basis.error(0.67, k).max)
    ax.set(title=f"$k$ = {k}: {refused}, error {error:.2f}", xlabel="angle (degrees)")
axes[-1].legend(loc="center left")
plt.show()

# %% [markdown]
# So the library refuses, with the reason and two ways out: the exact equations, or `substitute`,
# which uses reciprocity. Light that leaves glass at an angle reflects as light that enters at the
# refracted angle, and that curve fits.

# %%
try:
    fd.Decomposition.from_ior(0.67, 0.0)
except fd.InputError as error:
    print(str(error).replace("; ", ";\n").replace(". ", ".\n"))
substituted = fd.Decomposition.from_ior(0.67, 0.0, poor_fit="substitute")
error = np.abs(substituted(cos_theta) - fd.dielectric(cos_theta, 0.67))
print(f"by reciprocity: largest error {error.max():.4f}")

# %% [markdown]
# ## 5. A map of the index plane
#
# The largest error of each fit, for three recipes with four terms. Hatched: refused, and around it
# the worst of what is accepted. `robust` bounds the errors of low indices and so refuses the least;
# it pays with higher errors in the middle, where `talk` and `notebook` leave next to nothing.

# %%
etas, ks = np.geomspace(0.05, 6.0, 56), np.geomspace(0.02, 8.0, 40)[:, None]
recipes = ("talk", "notebook", "robust")
fig, axes = plt.subplots(1, 3, figsize=(9.5, 3.1), layout="constrained", sharey=True)
for ax, recipe in zip(axes, recipes, strict=True):
    each = fd.load_basis(recipe)
    largest, refused = each.error(etas, ks).max, each.poor_fit(etas, ks)
    shown = ax.pcolormesh(
        etas, ks, largest, cmap=style.SEQUENTIAL, norm="log", vmin=1e-3, vmax=0.12
    )
    ax.contourf(etas, ks[:, 0], refused, levels=(0.5, 1.5), colors="none", hatches=["////"])
    ax.set(xscale="log", yscale="log", title=recipe, xlabel="$\\eta$")
    ax.grid(False)
    accepted = largest[~refused]
    print(
        f"{recipe:9} refused {refused.mean():.0%}; errors of the rest: median "
        f"{np.median(accepted):.4f}, nine in ten below {np.quantile(accepted, 0.9):.4f}"
    )
axes[0].set_ylabel("$k$")
fig.colorbar(shown, ax=axes, label="largest error")
plt.show()

# %% [markdown]
# ## 6. Fits that leave [0, 1]
#
# A fit may exceed 1 by a part of its error, and a saturated colour exceeds it by right: gold's red
# is more than white under D65. So nothing is clamped unless asked, and only reflectances of a
# single index should be.

# %%
c = basis.coefficients(1.02, 0.0)
plain, clamped = (fd.Decomposition(c, basis, clamp=clamp)(cos_theta) for clamp in (False, True))
exact = fd.dielectric(cos_theta, 1.02)
print(f"eta = 1.02: from {plain.min():.4f} to {plain.max():.4f}")
print(f"error {np.abs(plain - exact).max():.4f}, clamped {np.abs(clamped - exact).max():.4f}")
gold = fd.load_material("Au").rgb_coefficients(basis)
print("gold at normal incidence, linear sRGB:", gold[:, 0].round(3))
print("beyond the gamut by", fd.gamut_excess(gold[:, 0]).round(3))

# %% [markdown]
# ## 7. Bad input
#
# A number out of range is an error that says what was given, what is accepted and what to do. In an
# array, one bad entry gives one NaN, and the others are not lost.

# %%
for bad in ((1.2, 1.5, 0.0), (0.5, -1.5, 0.0), (0.5, 1.5, float("nan"))):
    try:
        fd.conductor(*bad)
    except fd.InputError as error:
        print(error)
print(fd.conductor(0.5, np.array([1.5, -1.5, 2.5]), 0.0).round(4))
