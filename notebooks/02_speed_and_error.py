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
# # Speed against error
#
# Schlick's curve is cheap and wrong, the exact equations are right and not much dearer, so what is
# a decomposition good for? Here we measure all of them: the error of the curve, the operations and
# the time of evaluating it, the time of a picture, and that of the thing that the decomposition is
# made for: the average over a rough surface.

# %%
try:
    from fresnel_decomp.notebook import fast, fd, mi, np, plt, show, style
except ModuleNotFoundError as missing:  # as in Colab
    raise ModuleNotFoundError(
        f"{missing}. In cells of their own run !git clone ADDRESS_OF_THE_REPOSITORY clone and "
        "%pip install ./clone (in the notebooks folder of a clone: just %pip install ..), "
        "then run this cell again."
    ) from None

print(mi.variant())

# %% [markdown]
# ## 1. Error and operations
#
# Errors over two sets of curves: dielectrics with indices from 1.01 to 3, and metals over
# Gulbrandsen's reflectivities and edge tints (every 20th of 3,027). Operations are floating-point
# operations for the three channels of a colour, a fused multiply-add counting as one; the functions
# of a basis are shared by the channels.

# %%
from fresnel_decomp.prediction import operations  # noqa: E402

dielectrics = fd.curves.dielectrics().take(slice(None, None, 8))
metals = fd.curves.gulbrandsen_grid().take(slice(None, None, 20))
everywhere, uniform = fd.curves.error_cosines()


def errors(model, curves) -> tuple[float, float]:
    """Largest error, and RMSE uniform in the cosine."""
    difference = model(everywhere) - curves.reflectance(everywhere)
    rmse = np.sqrt(np.mean(difference[:, : len(uniform)] ** 2))
    return np.abs(difference).max(), rmse


def fitted(name: str, curves, basis=None):
    eta, k = curves.eta[:, None], curves.k[:, None]
    if basis is None:
        return fd.model_from_ior(name, eta, k)
    return fd.Decomposition.from_ior(eta, k, basis, poor_fit="keep")


rows = {name: (operations(name, 3), name, None) for name in ("schlick", "f82")}
for recipe in ("talk", "balanced", "robust"):
    for terms in (3, 4, 5, 6):
        basis = fd.load_basis(recipe, terms)
        rows[f"{recipe}, {terms} terms"] = operations("decomposition", 3, basis), recipe, basis
measured = {}
print(f"{'':18} {'operations':>10}   dielectrics max, RMSE   metals max, RMSE")
for name, (cost, _, basis) in rows.items():
    measured[name] = [errors(fitted(name, c, basis), c) for c in (dielectrics, metals)]
    (a, b), (c, d) = measured[name]
    print(f"{name:18} {cost:10}   {a:11.4f} {b:9.5f}   {c:8.4f} {d:7.5f}")
print(f"{'exact':18} {operations('exact', 3):10}")

# %%
fig, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", sharey=True)
colours = {name: style.MODEL_COLOURS[name] for name in ("schlick", "f82")}
colours |= {
    "talk": style.MODEL_COLOURS["decomposition"],
    "balanced": "#cc79a7",
    "robust": "#e69f00",
}
for ax, index, title in zip(axes, (0, 1), ("dielectrics", "metals"), strict=True):
    for (recipe, colour), marker in zip(colours.items(), "svoD^", strict=True):
        names = [name for name, row in rows.items() if row[1] == recipe]
        cost = [rows[name][0] for name in names]
        rmse = [measured[name][index][1] for name in names]
        ax.semilogy(cost, rmse, marker + "-", ms=5, color=colour, label=recipe)
    ax.axvline(operations("exact", 3), color="k", lw=1, ls=":", label="exact: no error")
    ax.set(title=title, xlabel="operations for RGB")
axes[0].set_ylabel("RMSE")
axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()

# %% [markdown]
# ## 2. Time of a curve
#
# Operations are not time. Dr.Jit compiles each model into a kernel that evaluates eight angles and
# three channels for every element; the time is that of the kernel, as its history has it. All
# models take turns, and a ratio is the median over rounds of (model / exact) in the same round, so
# that a machine that is busy for a while slows all of them; short kernels run several times in a
# row, so that it interrupts all of them as often. Before that, each answer is compared with
# NumPy's. Tables hold samples of the basis functions.

# %%
eta, k = np.array([4.185, 3.185, 2.784]), np.array([3.835, 3.010, 2.869])  # about beryllium


def constants(values: np.ndarray) -> list:
    """Numbers that the kernel reads, so that they are not folded into it."""
    import drjit as dr

    return [dr.opaque(mi.Float, float(value)) for value in np.ravel(values)]


def kernels() -> dict:
    """What each model does with a cosine: a list of three reflectances."""
    etas, ks = constants(eta), constants(k)
    f0, f82 = constants(fd.f0_from_ior(eta, k)), constants(fd.f82_from_ior(eta, k))
    made = {
        "exact": lambda c: [
            mi.fresnel_conductor(c, mi.Complex2f(*index)) for index in zip(etas, ks, strict=True)
        ],
        "schlick": lambda c: [fd.Schlick(a)(c) for a in f0],
        "f82": lambda c: [fd.F82(a, b)(c) for a, b in zip(f0, f82, strict=True)],
    }
    for terms in (3, 4, 5, 6):
        basis = fd.load_basis("talk", terms)
        rows = [constants(row) for row in basis.coefficients(eta, k)]
        forms = {f"{terms} terms": basis.closed_form}
        if terms == 4:
            forms |= {f"{terms} terms, table of {n}": basis.table(n) for n in (128, 512)}
        for name, form in forms.items():

            def evaluate(c, form=form, rows=rows):
                b = form(c)
                return [sum(x * y for x, y in zip(row, b, strict=True)) for row in rows]

            made[name] = evaluate
    return made


def check(evaluate, name: str) -> float:
    """Largest distance to the model in float64."""
    c = np.linspace(0.0, 1.0, 1001)
    values = np.array([np.array(v) for v in evaluate(mi.Float(c.astype(np.float32)))])
    terms = int(name[0]) if name[0].isdigit() else None
    basis = fd.load_basis("talk", terms) if terms else None
    model = fd.model_from_ior("decomposition" if terms else name, eta[:, None], k[:, None], basis)
    return float(np.abs(values - model(c)).max())


ratios = {}
if fast:
    cosines = mi.PCG32(size=1 << 19).next_float32()
    models = kernels()
    for name, evaluate in models.items():
        assert check(evaluate, name) < (1e-2 if "table" in name else 2e-4), name

    def eight(evaluate):
        total = [mi.Float(0.0)] * 3
        for i in range(8):
            values = evaluate(cosines * (1.0 - i / 16))
            total = [a + b for a, b in zip(total, values, strict=True)]
        return total

    import drjit as dr

    dr.eval(cosines)
    timing = fd.mitsuba.timing
    runs = {name: (lambda e=e: dr.eval(eight(e))) for name, e in models.items()}
    times = timing.interleaved_times({"curve": runs}, rounds=11)["curve"]
    ratios = {name: timing.ratio_and_spread(t, times["exact"]) for name, t in times.items()}
    nanoseconds = 1e6 * np.median(times["exact"]) / (8 * len(cosines))
    print(f"exact: {nanoseconds:.2f} ns a colour; the others relative to it")
    for name, (ratio, spread) in ratios.items():
        print(f"{name:21} {ratio:.2f} ± {spread:.2f}")
    fig, ax = plt.subplots(figsize=(6.5, 2.8), layout="constrained")
    names, bars = list(ratios)[::-1], list(ratios.values())[::-1]
    ax.barh(
        names, [ratio for ratio, _ in bars], xerr=[spread for _, spread in bars], color="#0072b2"
    )
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set(xlabel="time of a colour relative to the exact equations")
    ax.grid(axis="y", visible=False)
    ax.set_axisbelow(True)
    plt.show()
else:
    print("kernels need an LLVM or CUDA variant")

# %% [markdown]
# Point by point the exact equations are not slow, and a table is no faster than the closed form. If
# a curve is all that you need, on a CPU, take the exact one.
#
# ## 3. Time of a picture
#
# In a path tracer the Fresnel term is a small part of a BSDF, and that a small part of a picture.

# %%
size, spp = (128, 16) if fast else (24, 4)
bsdfs = fd.mitsuba.comparison.model_bsdfs(eta, k, ("exact", "decomposition", "schlick"))
pictures = fd.mitsuba.timing.kernel_times(bsdfs, size=size, spp=spp)
for name, t in pictures.items():
    print(f"{name:14} {t.ratio:.2f} ± {t.spread:.2f} of exact ({t.median_ms:.1f} ms, {t.clock})")
show(fd.mitsuba.comparison.render_bsdfs(bsdfs, size=size, spp=4 * spp), width=7)

# %% [markdown]
# ## 4. Time of an average
#
# Here is the gain. Light from an environment, on a rough surface: an engine needs the *average* of
# the curve over the lobe. The exact equations have to be integrated for each material, view and
# roughness; four terms are one fetch from a table that all materials share. Both in Dr.Jit, for the
# same random views and roughnesses, the integral with 64 nodes and with 256.

# %%
count = 1 << (14 if fast else 8)
rng = np.random.default_rng(0)
mu, alpha = rng.uniform(0.05, 1.0, count) ** 0.5, rng.uniform(0.2, 1.0, count) ** 2
basis = fd.load_basis()
table = fd.AlbedoTable.bake(basis)
c = basis.coefficients(eta, k)
truth = np.stack(
    [
        fd.directional_albedo(fd.Exact(e, x), mu[:512], alpha[:512])
        for e, x in zip(eta, k, strict=True)
    ]
)
schlick = fd.split_albedo.schlick_albedo(fd.f0_from_ior(eta, k))
found = {
    "table, 4 terms": table.lookup(mu[:512], alpha[:512]) @ c.T,
    "table, Schlick": schlick(mu[:512], alpha[:512]),
}
for name, values in found.items():
    print(f"{name}: largest error {np.abs(values.T - truth).max():.4f}")
views = np.linspace(0.0, 1.0, 201)
fig, ax = plt.subplots(figsize=(5, 2.8), layout="constrained")
for roughness, colour in ((0.05, "tab:blue"), (0.3, "tab:orange"), (0.8, "tab:green")):
    curve = fd.directional_albedo(fd.Exact(eta[0], k[0]), views, roughness)
    ax.plot(views, curve, color=colour, lw=3, alpha=0.4, label=f"$\\alpha$ = {roughness}")
    ax.plot(views, table.lookup(views, roughness) @ c[0], "k--", lw=1)
    ax.plot(views, schlick(views, roughness)[:, 0], "k:", lw=1)
ax.set(title="averages: exact, four terms (dashed), Schlick (dotted)", xlabel="$\\mu$")
ax.legend()
plt.show()
if fast:
    views, roughnesses = (mi.Float(v.astype(np.float32)) for v in (mu, alpha))
    etas, ks = constants(eta), constants(k)

    def integrated(n: int):
        return [
            fd.directional_albedo(
                lambda x, e=e, y=y: mi.fresnel_conductor(x, mi.Complex2f(e, y)),
                views, roughnesses, quadrature=(n, n),
            )
            for e, y in zip(etas, ks, strict=True)
        ]  # fmt: skip

    rows = [constants(row) for row in c]

    def fetched():
        b = table.lookup(views, roughnesses)
        return [sum(x * y for x, y in zip(row, b, strict=True)) for row in rows]

    f0 = constants(fd.f0_from_ior(eta, k))

    def fetched_schlick():
        a, b, _ = schlick.table.lookup(views, roughnesses)
        return [x * a + b for x in f0]

    runs = {
        "fetch, 4 terms": lambda: dr.eval(fetched()),
        "fetch, Schlick": lambda: dr.eval(fetched_schlick()),
        "64 nodes": lambda: dr.eval(integrated(8)),
        "256 nodes": lambda: dr.eval(integrated(16)),
    }
    times = timing.interleaved_times({"average": runs}, rounds=7)["average"]
    for name, values in times.items():
        ratio, _ = timing.ratio_and_spread(values, times["fetch, 4 terms"])
        print(f"{name:15} {1e6 * np.median(values) / count:9.1f} ns a colour, ratio {ratio:.2f}")

# %% [markdown]
# A fetch replaces the integral; that, and not the point-wise curve, is what an engine gains.
# Schlick's two functions are fetched as well and cost about the same; the errors above are what
# they give away.
