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
# # Inverse rendering
#
# What is this metal? Images of it under known light say so, and the decomposition makes that easy:
# where light meets the metal once, an image is a *linear* function of the coefficients. A few
# renders and one least-squares solve then do what gradient descent takes hundreds of steps for,
# from any start. Here we recover gold from five small noisy images, look at how sure we may be, and
# race the solve against descent.

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
# ## 1. Five images
#
# A sphere of gold with roughness .1 in a small made-up city that is turned from image to image. A
# *scene* is a function: it takes the dictionary of a BSDF and returns that of the scene. The images
# are path traced with the exact Fresnel equations, with few samples and so with noise.

# %%
size, spp, count = (64, 64, 5) if fast else (16, 16, 2)
alpha = 0.1
city = fd.mitsuba.skies.city(64)
lights = [city.turned(i * city.width // count).emitter() for i in range(count)]


def scenes_of(lights: list, size: int) -> list:
    lit = fd.mitsuba.scenes.lit_object
    return [lambda bsdf, light=light: lit(bsdf, light, size, background=False) for light in lights]


scenes = scenes_of(lights, size)
eta, k = fd.load_material("Au").rgb_indices()
truth = fd.mitsuba.comparison.conductor_bsdf(eta, k, alpha=alpha)
render = fd.mitsuba.comparison.render_scene
images = [render(mi.load_dict(scene(truth)), spp, seed=100 + i) for i, scene in enumerate(scenes)]
show({f"image {i + 1}": image for i, image in enumerate(images)}, 0.5)

# %% [markdown]
# ## 2. Images are linear in the coefficients
#
# The first scene in white ($c_0 = 1$, all others 0), and in white with one more $c_i = 1$: what
# that adds is the image of the basis function $b_i$, signed. Any metal's image is a sum of these
# four, weighed by its coefficients. The detour is for scalar variants of Mitsuba, which
# warn of every negative sample, as $b_i$ alone would give them.

# %%
basis = fd.load_basis()


def in_white(**more: float) -> np.ndarray:
    bsdf = {"type": "decomposed_conductor", "alpha": alpha, "distribution": "ggx", "c0": 1.0}
    bsdf |= {f"c{i}": 0.0 for i in range(1, basis.terms)} | more
    return render(mi.load_dict(scenes[0](bsdf)), spp, seed=1)


white = in_white()
parts = [white, *(in_white(**{f"c{i}": 1.0}) - white for i in range(1, basis.terms))]
maps = {f"$b_{i}$": part.mean(axis=-1) for i, part in enumerate(parts)}
show({}, maps=maps, limit=1.0, width=8)
c = basis.coefficients(eta, k)
summed = sum(part * weight for part, weight in zip(parts, c.T, strict=True))
bsdf = fd.mitsuba.comparison.conductor_bsdf(eta, k, alpha=alpha, fresnel="decomposition")
rendered = render(mi.load_dict(scenes[0](bsdf)), spp, seed=1)
print(f"their sum and a render of all at once differ by {np.abs(summed - rendered).max():.1e}")

# %% [markdown]
# ## 3. The solve
#
# `recover` renders the basis with samples of its own and solves constrained least squares. By
# default it looks for node colours: the reflectances at 0° and at the nodes. It says how sure it is
# of each number, from the scatter of the images' own residuals.

# %%
recover = fd.mitsuba.inverse.recover
found = recover(images, scenes, alpha=alpha, spp=spp)
nodes = np.cos([0.0, *basis.nodes])
exact = fd.conductor(nodes[:, None], eta, k)
print(f"{'':4} {'true':^21}  {'found':^21}  {'standard error':^21}")
for name, row in zip(("f0", "f1", "f2"), exact, strict=True):
    value, error = found.values[name].round(3), found.standard_errors[name].round(4)
    print(f"{name:4} {row.round(3)}  {value}  {error}")
print(f"residual {found.residual:.3f}, of which noise {found.noise:.3f}; {found.seconds:.1f} s")

# %%
degrees = np.linspace(0.0, 90.0, 181)
cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)


def curve_error(values, fresnel: str = "decomposition") -> float:
    """Largest error of the curves of named parameters, over all channels."""
    curve = fd.mitsuba.inverse.curve(values, basis, fresnel, cos_theta)
    return float(np.abs(curve - fd.conductor(cos_theta[:, None], eta, k)).max())


fig, axes = plt.subplots(1, 2, layout="constrained")
for i, colour in enumerate(style.CHANNEL_COLOURS.values()):
    true = fd.conductor(cos_theta, eta[i], k[i])
    curve = found.reflectance(cos_theta)[:, i]
    axes[0].plot(degrees, true, color=colour, lw=3, alpha=0.4)
    axes[0].plot(degrees, curve, "k--", lw=1)
    axes[1].plot(degrees, curve - true, color=colour)
axes[0].set(title="reflectance; dashed: recovered", xlabel="angle of incidence (degrees)")
axes[1].set(title="recovered − true", xlabel="angle of incidence (degrees)")
plt.show()
print(f"largest error of a curve {curve_error(found.values):.4f}")

# %% [markdown]
# ## 4. Indices, and what images cannot say
#
# The same solve, asked for the index of refraction or for Gulbrandsen's parameters. Different
# indices have nearly the same curve, so these are less sure than the curve is, and the standard
# errors tell.

# %%
for parameters, true in {
    "indices": {"eta": eta, "k": k},
    "gulbrandsen": dict(zip("rg", fd.ior_to_gulbrandsen(eta, k), strict=True)),
}.items():
    result = recover(images, scenes, parameters, alpha=alpha, spp=spp)
    for name, value in true.items():
        print(
            f"{name:4} true {value.round(3)}, found {result.values[name].round(3)} "
            f"± {result.standard_errors[name].round(4)}"
        )
    print(f"     largest error of a curve {curve_error(result.values, result.fresnel):.4f}")

# %% [markdown]
# ## 5. Unknown roughness
#
# Images are not linear in roughness. The route "hybrid" solves inside a search for it, then refines
# everything together.

# %%
if fast:
    result = recover(images[:2], scenes[:2], route="hybrid", roughness="unknown", alpha=0.3, spp=32)
    print(f"alpha {result.alpha:.4f} ± {result.standard_errors['alpha']:.4f}, true {alpha}")
    print(f"largest error of a curve {curve_error(result.values):.4f}; {result.seconds:.1f} s")
else:
    print("takes long without an LLVM or CUDA variant")

# %% [markdown]
# ## 6. Against gradient descent
#
# The route "gradient" descends on the parameters with derivatives from Mitsuba's `prb` integrator.
# It is quasi-Newton descent (L-BFGS-B). On node colours that is linear least squares, slowly. On
# (eta, k) with the exact equations the landscape is bent: from a start far away, descent can end in
# a valley from which no way leads down, though the metal is elsewhere. All three see the same
# single image.

# %%
if fast:
    few = scenes_of(lights[:1], 48)
    small = [render(mi.load_dict(scene(truth)), spp, seed=200 + i) for i, scene in enumerate(few)]
    common = {"route": "gradient", "alpha": alpha, "spp": 32, "iterations": 100}
    runs = {
        "linear solve": recover(small, few, alpha=alpha, spp=spp),
        "descent, node colours": recover(small, few, **common),
        "descent, exact (η, k)": recover(
            small, few, "indices", fresnel="exact", start={"eta": 4.0, "k": 0.5}, **common
        ),
    }
    fig, ax = plt.subplots(figsize=(7, 3), layout="constrained")
    for name, result in runs.items():
        seconds = [step.seconds for step in result.history]
        errors = [curve_error(step.values, result.fresnel) for step in result.history]
        if "solve" in name:
            ax.semilogy(result.seconds, errors[-1], "k*", ms=11, label=name)
        else:
            ax.semilogy(seconds, errors, label=name)
        print(
            f"{name:22} largest error {errors[-1]:.3f} after {result.seconds:.1f} s", result.message
        )
    ax.set(xlabel="seconds", ylabel="largest error of a curve")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    plt.show()
else:
    print("derivatives need an LLVM or CUDA variant")

# %% [markdown]
# ## 7. The recovered metal, elsewhere
#
# `bsdf` is the dictionary of a `decomposed_conductor`. In another light it looks like the original.

# %%
studio = fd.mitsuba.comparison.render_bsdfs
options = {"size": 128 if fast else 32, "spp": 64 if fast else 16}
pictures = studio({"original": truth, "recovered": found.bsdf()}, **options)
difference = fd.images.delta_e(*pictures.values())
show(pictures, maps={"ΔE00": difference}, limit=1.0, width=7)
print(f"mean ΔE00 {difference.mean():.3f}")
