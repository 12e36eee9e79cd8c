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
# # From Fresnel curves to four coefficients to a picture
#
# A Fresnel curve says how much light a polished surface reflects at each angle. It depends on the
# complex index of refraction `eta + i k` in a way that real-time engines cannot integrate ahead of
# time. Belcour, Bati and Barla (SIGGRAPH 2020 Talks) write every such curve as a weighted sum of
# four fixed functions instead,
#
# $$F(\theta) \approx c_0\,b_0(\theta) + c_1\,b_1(\theta) + c_2\,b_2(\theta) + c_3\,b_3(\theta),$$
#
# so that integrals are taken once, of the functions, and a material is four numbers per colour
# channel. Here we build the functions, fit beryllium, and look at the result.

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
# Asking for `mi` looked for an LLVM that Mitsuba can work with, and set the fastest variant that
# runs here. Where that is a slow one, a message says what to do.
#
# ## 1. Curves
#
# The training set is that of the authors' published notebook: 990 dielectrics and nine conductors
# (orange; a tenth has a reflectivity above 1 and is left out). On the right, the same curves are
# shifted and rescaled to run from 0 at normal incidence to 1 at grazing incidence: that leaves
# shape only.

# %%
training = fd.curves.talk_training_set()
cos_theta = np.linspace(0.0, 1.0, 1000)
degrees = np.degrees(np.arccos(cos_theta))
F = training.reflectance(cos_theta)  # one row for each material
F0 = F[:, -1:]
shape = (F - F0) / (1.0 - F0)

fig, axes = plt.subplots(1, 2, layout="constrained")
for ax, curves, title in zip(axes, (F, shape), ("reflectance", "rescaled"), strict=True):
    ax.plot(degrees, curves[10::33].T, lw=0.8, color="tab:blue", alpha=0.6)
    ax.plot(degrees, curves[1:10].T, lw=0.8, color="tab:orange")
    ax.set(title=title, xlabel="angle of incidence (degrees)")
plt.show()

# %% [markdown]
# ## 2. Basis
#
# $b_0 = 1$. The first right singular vector of the rescaled curves is their common shape, $b_1$.
# What it leaves over is decomposed in the same way, one function after the other (the talk's
# Eq. 6). The coefficient of each new function comes from a single angle, its *node*: 1.45 for
# $b_2$ and 1.31 for $b_3$. So all that is left over is zero at the nodes of the functions before.

# %%
from scipy.sparse.linalg import svds  # noqa: E402


def peak_at_one(function: np.ndarray) -> np.ndarray:
    """Fix the arbitrary sign and scale of a singular vector."""
    return function / function[np.argmax(np.abs(function))]


def first_vector(matrix: np.ndarray) -> np.ndarray:
    return peak_at_one(svds(matrix, k=1, v0=np.ones(len(matrix)))[2][0])


b1 = first_vector(shape)
residual = F - F0 - (1.0 - F0) * b1
functions = [np.ones_like(b1), b1]
for node in (1.45, 1.31):
    new = first_vector(residual)
    at_node = [np.interp(np.cos(node), cos_theta, row) for row in residual]
    c = np.array(at_node) / np.interp(np.cos(node), cos_theta, new)
    residual = residual - c[:, None] * new
    functions.append(new)

basis = fd.load_basis("talk")  # ships with the library
difference = np.abs(np.stack(functions, axis=-1) - basis(cos_theta)).max()
print(f"nodes {basis.nodes}, condition {basis.condition:.2f}")
print(f"largest difference to the dozen lines above: {difference:.0e}")

fig, ax = plt.subplots(layout="constrained")
for i, function in enumerate(basis(cos_theta).T):
    ax.plot(degrees, function, label=f"$b_{i}$")
for node in basis.nodes:
    ax.axvline(np.degrees(node), color="0.5", lw=0.8, ls="--")
ax.set(xlabel="angle of incidence (degrees)", title="basis; dashed: nodes")
ax.legend(ncols=4)
plt.show()
# %% [markdown]
# The dozen lines interpolate linearly between 1,000 samples at the nodes; the library evaluates
# its functions there exactly, which is the whole difference.
#
# ## 3. Coefficients
#
# At normal incidence only $b_0$ is not zero, at grazing incidence every curve is 1. So
# $c_0 = F(0)$, $c_1 = 1 - F(0)$, and the reflectances at the two nodes give $c_2$ and $c_3$ by a
# 2 × 2 system: four reflectances in, four coefficients out, and the relation is affine. Hence a
# whole spectrum may be integrated to RGB first and projected afterwards.

# %%
beryllium = fd.load_material("Be")
angles = np.array([0.0, *basis.nodes])
rgb = beryllium.rgb_reflectance(np.cos(angles))
c = basis.coefficients_from_reflectance(rgb[0], rgb[1:].T)
print("reflectance at 0, 1.45, 1.31, linear RGB:", rgb.round(3), sep="\n")
print("c_0, c_1, c_2, c_3 for R, G and B:", c.round(3), sep="\n")
print("the same as", np.abs(c - beryllium.rgb_coefficients(basis)).max())

# %%
exact = beryllium.rgb_reflectance(cos_theta)
fits = {
    "decomposition": basis.evaluate(c, cos_theta[:, None]),
    "F82": fd.F82(rgb[0], beryllium.rgb_reflectance(1 / 7))(cos_theta[:, None]),
    "Schlick": fd.Schlick(rgb[0])(cos_theta[:, None]),
}
fig, axes = plt.subplots(1, 2, layout="constrained")
for name, fit in fits.items():
    axes[0].plot(degrees, fit[:, 0], label=name)
    axes[1].plot(degrees, fit[:, 0] - exact[:, 0], label=name)
axes[0].plot(degrees, exact[:, 0], "k--", lw=1, label="exact")
axes[0].set(title="beryllium, red channel", xlabel="angle of incidence (degrees)")
axes[1].set(title="model − exact", xlabel="angle of incidence (degrees)")
axes[0].legend()
for name, fit in fits.items():
    print(f"{name:14} largest error {np.abs(fit - exact).max():.4f}")
plt.show()

# %% [markdown]
# ## 4. How good, and where not
#
# `basis.error` tells the error of any fit. Two regions are hard for every basis of this kind. Near
# `eta = 1` there is nothing to fit but grazing incidence. And for `eta < 1` without absorption
# (light that leaves glass) reflection is total beyond the critical angle: the curve has a kink that
# no sum of smooth functions follows. The library refuses such a fit unless told what to do instead.

# %%
eta = np.geomspace(0.5, 3.0, 200)
fig, ax = plt.subplots(layout="constrained")
for k in (0.0, 0.1, 0.5, 2.0):
    ax.semilogy(eta, basis.error(eta, k).max, label=f"k = {k}")
ax.set(xlabel="eta", title="largest error of the four-term fit")
ax.legend()
plt.show()
try:
    fd.Decomposition.from_ior(1 / 1.5, 0.0)
except fd.InputError as error:
    print(str(error).replace("; ", ";\n").replace(". ", ".\n"))
glass = fd.Decomposition.from_ior(1 / 1.5, 0.0, poor_fit="substitute")
error = np.abs(glass(cos_theta) - fd.dielectric(cos_theta, 1 / 1.5)).max()
print(f"inside glass, by reciprocity: largest error {error:.4f}")

# %% [markdown]
# ## 5. Closed form
#
# A kernel evaluates the basis as rational functions with one denominator: no table, one division.

# %%
form = basis.closed_form
print(f"degrees {form.numerators.shape[1]} over {form.denominator.size - 1}")
print(f"largest distance to the extracted basis {form.error:.1e}")
denominator = np.polynomial.Polynomial(form.denominator)(cos_theta)
print(f"smallest denominator {denominator.min():.2f}")

# %% [markdown]
# ## 6. A picture
#
# The plugin `decomposed_conductor` is Mitsuba's rough conductor with a choice of Fresnel term. The
# sampling does not depend on that choice, so pictures of the same seed use the same paths, and what
# differs is the model. The light behind the sphere is there for grazing reflection.

# %%
T = mi.ScalarTransform4f
eta, k = (np.array(values) for values in beryllium.rgb_indices())
size, spp = (256, 64) if fast else (72, 16)


def softbox(origin: list[float], target: list[float], radiance: float, scale: float) -> dict:
    to_world = T().look_at(origin=origin, target=target, up=[0, 1, 0]) @ T().scale(scale)
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
    return {"type": "rectangle", "to_world": to_world, "emitter": emitter}


def render(fresnel: str) -> np.ndarray:
    metal = {"type": "decomposed_conductor", "distribution": "ggx", "alpha": 0.08}
    metal |= {"eta": {"type": "rgb", "value": eta.tolist()}, "fresnel": fresnel}
    metal |= {"k": {"type": "rgb", "value": k.tolist()}}
    view = T().look_at(origin=[0, 1.6, 7], target=[0, 0.05, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb"}
    lying = T().translate([0, -1, 0]) @ T().rotate([1, 0, 0], -90) @ T().scale(12)
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.25}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "rr_depth": 7},
        "sensor": {"type": "perspective", "fov": 24, "to_world": view, "film": film},
        "air": {"type": "constant", "radiance": {"type": "rgb", "value": 0.3}},
        "key": softbox([-4, 5, 5], [0, 0, 0], 5.0, 1.6),
        "rim": softbox([6, 3, -6], [0, 0, 0], 1.2, 3.0),
        "floor": {"type": "rectangle", "to_world": lying, "bsdf": grey},
        "ball": {"type": "sphere", "bsdf": metal},
    }
    return np.array(mi.render(mi.load_dict(scene), spp=spp, seed=0))


images = {name: render(name) for name in ("exact", "decomposition", "schlick")}

# %%
results = {
    name: fd.images.compare(images["exact"], images[name]) for name in ("decomposition", "schlick")
}
show(images, maps={f"FLIP, {name}": result.flip_map for name, result in results.items()})
for name, result in results.items():
    print(f"{name:14} mean FLIP {result.flip:.5f}, mean ΔE00 {result.delta_e:.4f}")

# %% [markdown]
# ## 7. Try it
#
# The sliders below move the index of refraction, or Gulbrandsen's reflectivity $r$ and edge tint
# $g$, or $r$ and the linear edge tint $\beta$ that the decomposition makes possible. They need a
# running kernel and `ipywidgets`; without, there is a picture of where they start.
#
# The spheres are lit by a small made-up city and shaded by the *split-sum*: a blurred light times
# the average reflectance of a rough surface, $\sum_i c_i\,\bar b_i(\mu, \alpha)$, whose
# $\bar b_i$ are looked up in a table. That takes milliseconds, so the spheres follow the sliders.

# %%
sphere = fd.mitsuba.preview.SpherePreview(96)
table = fd.AlbedoTable.bake(basis)
SplitAlbedo = fd.split_albedo.SplitAlbedo


def panel(c: np.ndarray, alpha: float, exact: fd.Exact | fd.Gulbrandsen | None = None):
    """Curves and spheres of four coefficients per channel, of Schlick's curve and the exact one."""
    curves = {"schlick": fd.Schlick(c[:, 0]), "decomposition": fd.Decomposition(c, basis)}
    albedos = {
        "schlick": fd.split_albedo.schlick_albedo(c[:, 0]),
        "decomposition": SplitAlbedo(table, c),
    }
    if exact is not None:
        curves["exact"] = exact
        albedos["exact"] = fd.split_albedo.integrated_albedo(exact, alpha, cosines=65)
    names = [name for name in ("exact", "decomposition", "schlick") if name in curves]
    spheres = {name: sphere(albedos[name], alpha) for name in names}
    fig = style.figure(9.0, 2.6, layout="constrained")
    axes = fig.subplots(1, 1 + len(names), width_ratios=(1.7, *[1] * len(names)))
    for name in names[::-1]:
        for values, channel in zip(curves[name](cos_theta[:, None]).T, "RGB", strict=True):
            look = {"ls": style.MODEL_LINES[name], "color": "k", "lw": 1.3}
            if name == names[0]:
                look |= {"color": style.CHANNEL_COLOURS[channel], "lw": 2.5, "alpha": 0.6}
            label = style.MODEL_LABELS[name] if channel == "R" else None
            axes[0].plot(degrees, values, label=label, **look)
    axes[0].legend(loc="upper left")
    axes[0].set(xlabel="angle of incidence (degrees)", ylabel="reflectance", ylim=(None, 1.03))
    for ax, name in zip(axes[1:], names, strict=True):
        ax.set_axis_off()
        ax.imshow(fd.images.display(spheres[name], exposure=0.7))
        title = style.MODEL_LABELS[name]
        if exact is not None and name != "exact":
            difference = fd.images.delta_e(spheres["exact"], spheres[name], exposure=0.7)
            title += f", ΔE$_{{00}}$ {difference.mean():.2f}"
        ax.set_title(title)
    return fig


# %% [markdown]
# **(η, k), roughness α.** One index for all colours, so the spheres are grey. Go to small `eta`
# and `k`: there the fit is refused.


# %%
def by_index(eta: float, k: float, alpha: float):
    etas, ks = np.full(3, eta), np.full(3, k)
    return panel(basis.coefficients(etas, ks), alpha, fd.Exact(etas, ks))


explore(by_index, eta=(3.1, 0.05, 5.0), k=(3.3, 0.0, 8.0), alpha=(0.1, 0.01, 1.0))

# %% [markdown]
# **(r, g).** One reflectivity and three edge tints: all colour is at the edge, and Schlick, which
# knows F0 only, has none. Nearly all of the change with g happens next to 1.


# %%
def by_edge_tint(r: float, g_red: float, g_green: float, g_blue: float, alpha: float):
    model = fd.Gulbrandsen(np.full(3, r), np.array([g_red, g_green, g_blue]))
    c = basis.coefficients(*fd.gulbrandsen_to_ior(model.r, model.g))
    return panel(c, alpha, model)


tints = {"g_red": (0.0, 0.0, 1.0), "g_green": (1.0, 0.0, 1.0), "g_blue": (0.0, 0.0, 1.0)}
explore(by_edge_tint, r=(0.44, 0.01, 0.99), **tints, alpha=(0.05, 0.01, 1.0))

# %% [markdown]
# **(r, β).** The same ends, with the coefficients interpolated between them: equal steps are equal
# changes. There is no exact curve to compare with, these are mixtures.


# %%
def by_linear_tint(r: float, beta_red: float, beta_green: float, beta_blue: float, alpha: float):
    beta = np.array([beta_red, beta_green, beta_blue])
    return panel(fd.LinearTint(np.full(3, r), beta, basis).coefficients, alpha)


tints = {"beta_red": (0.5, 0.0, 1.0), "beta_green": (1.0, 0.0, 1.0), "beta_blue": (0.0, 0.0, 1.0)}
explore(by_linear_tint, r=(0.44, 0.01, 0.99), **tints, alpha=(0.05, 0.01, 1.0))

# %% [markdown]
# How fast is fast enough to follow a hand?

# %%
import time  # noqa: E402

start = time.perf_counter()
for alpha in np.linspace(0.1, 0.5, 5):
    by_edge_tint(0.44, 0.0, 1.0, 0.0, alpha)
print(f"curves and three spheres: {200 * (time.perf_counter() - start):.0f} ms")
gold = SplitAlbedo(table, fd.load_material("Au").rgb_coefficients(basis))
start = time.perf_counter()
for alpha in np.linspace(0.1, 0.5, 20):
    sphere(gold, alpha)
print(f"one sphere from the table: {50 * (time.perf_counter() - start):.0f} ms")
