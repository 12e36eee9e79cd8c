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
# # Preintegration and split-sum
#
# A rough surface reflects light from many angles at once, so a shader needs the Fresnel term
# *averaged* over the reflection lobe. Exact equations have to be averaged anew for every material.
# The decomposition is linear in its functions: each is averaged once, for all views and
# roughnesses, and one texture serves every material. Here we bake that texture, look at it, and
# shade with it.

# %%
try:
    from fresnel_decomp.notebook import explore, fast, fd, mi, np, plt, show, style
except ModuleNotFoundError as missing:  # as in Colab
    raise ModuleNotFoundError(
        f"{missing}. In cells of their own run !git clone ADDRESS_OF_THE_REPOSITORY clone and "
        "%pip install ./clone (in the notebooks folder of a clone: just %pip install ..), "
        "then run this cell again."
    ) from None

print(mi.variant())

# %% [markdown]
# ## 1. What is averaged
#
# $$\bar b_i(\mu, \alpha) = \int b_i(\omega_o \cdot h)\,
# \frac{G(\omega_i, \omega_o)\, D(h)}{4\,\mu}\, \mathrm d\omega_i$$
#
# is what a surface of roughness $\alpha$ with the reflectance $b_i$ reflects to a viewer at
# $\mu = \cos\theta_o$ in uniform light. At $\alpha = 0$ it is $b_i(\mu)$ itself. The rougher the
# surface, the flatter the curves, and the more light is lost between the facets: that is the decay
# of $\bar b_0$, which belongs to a surface that reflects everything.

# %%
basis = fd.load_basis()
mu = np.linspace(0.0, 1.0, 201)
fig, axes = plt.subplots(1, basis.terms, figsize=(9.5, 2.6), layout="constrained")
for alpha in (0.0, 0.05, 0.2, 0.5, 1.0):
    albedo = fd.directional_albedo(basis, mu, alpha)
    for i, ax in enumerate(axes):
        colour = plt.get_cmap("viridis")(0.9 * alpha**0.5)
        ax.plot(mu, albedo[:, i], color=colour, label=f"$\\alpha$ = {alpha:g}")
for i, ax in enumerate(axes):
    ax.set(title=f"$\\bar b_{i}$", xlabel="$\\mu$")
axes[1].legend()
plt.show()

# %% [markdown]
# ## 2. Not by chance
#
# Light from below the horizon is what makes random sampling slow here. The library knows where the
# horizon is, in closed form, and puts Gauss nodes up to it. Largest error over a grid of views and
# roughnesses, against 4,096 nodes:

# %%
from fresnel_decomp.albedo_estimates import quasi_monte_carlo_albedo  # noqa: E402

views, roughnesses = np.linspace(0.02, 1.0, 12), np.linspace(0.05, 1.0, 8)[:, None]
truth = fd.directional_albedo(basis, views, roughnesses, quadrature=(64, 64))
counts = [16, 64, 256, 1024]
by_rule, by_chance = [], []
for count in counts:
    side = int(count**0.5)
    rule = fd.directional_albedo(basis, views, roughnesses, quadrature=(side, side))
    points = quasi_monte_carlo_albedo(basis, views, roughnesses, count, replicates=1).value
    by_rule.append(np.abs(rule - truth).max())
    by_chance.append(np.abs(points - truth).max())
    print(f"{count:5} evaluations: rule {by_rule[-1]:.1e}, Sobol' points {by_chance[-1]:.1e}")
fig, ax = plt.subplots(figsize=(5, 2.8), layout="constrained")
ax.loglog(counts, by_chance, "s-", ms=5, color="tab:orange", label="Sobol' points")
ax.loglog(counts, by_rule, "o-", ms=5, color="tab:blue", label="Gauss rule to the horizon")
ax.set_xticks(counts, counts)
ax.minorticks_off()
ax.set(xlabel="evaluations per integral", ylabel="largest error")
ax.legend()
plt.show()

# %% [markdown]
# ## 3. The texture
#
# $\bar b_0, \bar b_1, \bar b_2, \bar b_3$ in the four channels of 64 × 64 texels: $\sqrt\mu$ from
# left to right, perceptual roughness $\sqrt\alpha$ downwards. It is baked in a fraction of a
# second.

# %%
import time  # noqa: E402

start = time.perf_counter()
table = fd.AlbedoTable.bake(basis)
print(f"baked in {1e3 * (time.perf_counter() - start):.0f} ms")
fig, axes = plt.subplots(1, table.terms, figsize=(9.5, 2.5), layout="constrained")
for i, ax in enumerate(axes):
    shown = ax.imshow(
        table.values[..., i], cmap=style.DIVERGING, vmin=-1, vmax=1, extent=(0, 1, 1, 0)
    )
    ax.set(title=f"$\\bar b_{i}$", xlabel="$\\sqrt{\\mu}$")
    ax.grid(False)
axes[0].set_ylabel("$\\sqrt{\\alpha}$")
fig.colorbar(shown, ax=axes)
plt.show()

# %% [markdown]
# How fine must it be, and why $\sqrt\mu$? Near grazing incidence everything bends. Largest errors
# of lookups between the texels, for both axes, over views from $\mu = .01$ on:

# %%
rng = np.random.default_rng(1)
mu, alpha = rng.uniform(0.1, 1.0, 400) ** 2, rng.uniform(0.1, 1.0, 400) ** 2
truth = fd.directional_albedo(basis, mu, alpha)
sizes, axis_names = (16, 32, 64, 128), {"sqrt_mu": "$\\sqrt{\\mu}$", "mu": "$\\mu$"}
fig, ax = plt.subplots(figsize=(5, 2.8), layout="constrained")
for name, label in axis_names.items():
    errors = [
        np.abs(fd.AlbedoTable.bake(basis, n, mu_axis=name).lookup(mu, alpha) - truth).max()
        for n in sizes
    ]
    ax.loglog(sizes, errors, "o-", label=label)
    print(f"{name:8}", *(f"{n}: {error:.5f}" for n, error in zip(sizes, errors, strict=True)))
ax.set_xticks(sizes, sizes)
ax.minorticks_off()
ax.set(xlabel="texels along each side", ylabel="largest error")
ax.legend()
plt.show()

# %% [markdown]
# ## 4. Shading
#
# Karis's split-sum multiplies this average with the light, blurred by the same roughness. The light
# is a small made-up city; its blurred maps have no noise because the blur is a convolution.

# %%
light = fd.mitsuba.prefilter.prefilter(fd.mitsuba.skies.city(128), levels=13)
levels = (0, 3, 6, 9)
alphas = light.alphas[list(levels)]
show({f"$\\alpha$ = {a:.2f}": light.levels[i] for i, a in zip(levels, alphas, strict=True)})

# %% [markdown]
# Gold in three roughnesses. *Exact* integrates the Fresnel equations for this one metal; the
# others look up, four functions or Karis's two. The maps show what differs: the light is the same.


# %%
sphere = fd.mitsuba.preview.SpherePreview(128, light)
split_sum = fd.mitsuba.split_sum
eta, k = fd.load_material("Au").rgb_indices()
models = {
    "four terms": fd.split_albedo.SplitAlbedo(table, basis.coefficients(eta, k)),
    "Schlick": fd.split_albedo.schlick_albedo(fd.f0_from_ior(eta, k)),
}
for alpha in (0.05, 0.2, 0.5):
    exact = fd.split_albedo.integrated_albedo(fd.Exact(eta, k), alpha, cosines=257)
    images = {f"exact, α = {alpha}": sphere(exact, alpha)}
    images |= {name: sphere(albedo, alpha) for name, albedo in models.items()}
    reference, *others = images.values()
    maps = {
        f"ΔE00, {name}": fd.images.delta_e(reference, image, 0.5)
        for name, image in zip(models, others, strict=True)
    }
    show(images, 0.5, maps=maps, limit=3.0)
    print("mean over the sphere:", *(f"{name} {m.mean():.3f}" for name, m in maps.items()))

# %% [markdown]
# ## 5. One fetch, any metal
#
# The texture knows nothing of gold. Move through the metals' coefficients as you like; each frame
# costs the same fetch.


# %%
def metal(r_red: float, r_green: float, r_blue: float, beta: float, alpha: float):
    c = fd.LinearTint(np.array([r_red, r_green, r_blue]), np.full(3, beta), basis).coefficients
    fig = style.figure(3.0, 3.0, layout="constrained")
    ax = fig.subplots()
    ax.imshow(fd.images.display(sphere(fd.split_albedo.SplitAlbedo(table, c), alpha), 0.5))
    ax.set_axis_off()
    return fig


explore(
    metal,
    r_red=(0.95, 0.01, 0.99),
    r_green=(0.64, 0.01, 0.99),
    r_blue=(0.54, 0.01, 0.99),
    beta=(0.75, 0.0, 1.0),
    alpha=(0.15, 0.01, 1.0),
)

# %% [markdown]
# ## 6. What the split-sum itself costs
#
# A better Fresnel term does not repair the split-sum. Against the path tracer with the exact
# equations, both lit by the city. The first map is the Fresnel term alone: path traced with the
# same paths. The second is the four-term table in the split-sum: the same blurred light. The third
# is the split-sum as such, with the exact average. Compare like with like.

# %%
size, spp = (128, 256) if fast else (40, 36)
alpha = 0.2
city = fd.mitsuba.skies.city(128)
conductor = fd.mitsuba.comparison.conductor_bsdf


def path_traced(fresnel: str) -> np.ndarray:
    bsdf = conductor(eta, k, alpha=alpha, fresnel=fresnel)
    scene = fd.mitsuba.scenes.lit_object(bsdf, city.emitter(), size, background=False)
    return fd.mitsuba.comparison.render_scene(mi.load_dict(scene), spp)


def shaded(albedo) -> np.ndarray:
    material = split_sum.SplitMaterial(albedo, alpha)
    return np.array(split_sum.render_split_sum(surface, light, material, background=False))


bsdf = conductor(eta, k, alpha=alpha)
scene = fd.mitsuba.scenes.lit_object(bsdf, city.emitter(), size, background=False)
surface = fd.mitsuba.visible_surface.visible_surface(mi.load_dict(scene))
images = {
    "path traced": path_traced("exact"),
    "path traced, four terms": path_traced("decomposition"),
    "split-sum, exact": shaded(fd.split_albedo.integrated_albedo(fd.Exact(eta, k), alpha)),
    "split-sum, table": shaded(models["four terms"]),
}
show(images, 0.5)
pairs = {
    "Fresnel term alone": ("path traced", "path traced, four terms"),
    "four-term table alone": ("split-sum, exact", "split-sum, table"),
    "split-sum as such": ("path traced", "split-sum, exact"),
}
maps = {}
for name, (one, other) in pairs.items():
    maps[name] = fd.images.delta_e(images[one], images[other], 0.5)
    nrmse = fd.images.nrmse(images[one], images[other])
    print(f"{name:24} mean ΔE00 {maps[name].mean():.3f}, RMSE over the mean {nrmse:.2%}")
show({}, maps=maps, limit=6.0, width=7.5, unit="ΔE00")

# %% [markdown]
# ## 7. Into an engine
#
# `save` writes OpenEXR with the conventions in its header, NumPy archives, or raw half floats; the
# row of zero roughness is the basis itself, so one texture serves punctual lights too.

# %%
import tempfile  # noqa: E402
from pathlib import Path  # noqa: E402

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "talk.exr"
    table.save(path)
    again = fd.AlbedoTable.load(path)
    print(f"{path.stat().st_size} bytes; half floats change at most", end=" ")
    print(f"{np.abs(again.values - table.values).max():.1e}")
    header = fd.images.read_exr_attributes(path)
    for name in ("channelNames", "axes", "smith", "distribution", "recipe"):
        print(f"{name:13} {header[name]}")
