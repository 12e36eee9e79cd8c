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
# # Planning a scene
#
# Which Fresnel term does a scene need? Schlick's curve is enough for some metals, four terms are
# more than enough for most. `plan_scene` looks at what a Mitsuba scene uses and chooses, for every
# rough conductor, the cheapest representation that keeps a bound on the error. Here we plan a scene
# at several bounds and render what it predicts.

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
# ## 1. A scene
#
# Spheres of gold, aluminium, copper and beryllium of several roughnesses, one of glass, and a
# floor, under an even sky. An XML file would do as well.

# %%
size, spp = ((288, 84), 100) if fast else ((96, 28), 16)
move, look = mi.ScalarTransform4f().translate, mi.ScalarTransform4f().look_at
metals = {
    "gold": ("Au", 0.15),
    "aluminium": ("Al", 0.3),
    "copper": ("Cu", 0.05),
    "beryllium": ("Be", 0.1),
}


def described(lights: dict) -> dict:
    bsdfs = {
        name: {"type": "roughconductor", "material": m, "alpha": alpha, "distribution": "ggx"}
        for name, (m, alpha) in metals.items()
    }
    bsdfs["glass"] = {"type": "dielectric", "int_ior": "bk7", "ext_ior": "air"}
    spheres = {
        f"{name} sphere": {
            "type": "sphere", "to_world": move([2.6 * i - 5.2, 0.0, 1.0]),
            "bsdf": {"type": "ref", "id": name},
        }
        for i, name in enumerate(bsdfs)
    }  # fmt: skip
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    view = look([0.0, -28.0, 7.0], [0.0, 0.0, 0.9], [0.0, 0.0, 1.0])
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5, "rr_depth": 10},
        "sensor": {"type": "perspective", "fov": 25.5, "to_world": view, "film": film},
        **{name: {**bsdf, "id": name} for name, bsdf in bsdfs.items()},
        **spheres,
        "floor": {
            "type": "rectangle", "to_world": mi.ScalarTransform4f().scale([40.0, 40.0, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.2] * 3}},
        },
        **lights,
    }  # fmt: skip


sky = {"light": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}}
scene = described(sky)
exact = fd.mitsuba.comparison.render_scene(mi.load_dict(scene), spp)
show({"as written: exact equations": exact}, width=8)

# %% [markdown]
# ## 2. What is in it
#
# The inventory finds the surfaces, their indices as this variant evaluates them, their roughness
# and how they are lit: by light from everywhere, which a rough surface averages, or by something as
# small as a point, which shows single angles.

# %%
found = fd.mitsuba.inventory.take_inventory(scene)
for surface in found.surfaces:
    eta, k = surface.eta.round(2), surface.k.round(2)
    print(f"{surface.name:10} eta {eta}, k {k}, alpha {surface.alpha[0]:.2f}")
for entry in found.left:
    print(f"{entry.name:10} {entry.kind}: {entry.why}")

# %% [markdown]
# ## 3. Plans
#
# A bound of .01 means one per cent of the incident light. All decompositions of a plan share one
# basis, since an engine has one table. Here it is one that ships: `own_basis=False` leaves out
# those that would be extracted for just this scene, which takes longer. Operations are
# floating-point operations for all channels.

# %%
from fresnel_decomp.report.plan import summary  # noqa: E402


def tell(planned) -> None:
    for part in summary(planned):
        if isinstance(part, str):
            print(part)
            continue
        widths = [max(map(len, column)) for column in zip(*part, strict=True)]
        for row in part:
            print("   ".join(f"{cell:{w}}" for cell, w in zip(row, widths, strict=True)).rstrip())


bounds = (0.03, 0.01, 0.001)


def plan(scene: dict, bound: float, metric: str = "reflectance"):
    return fd.mitsuba.scene_plan.plan_scene(scene, bound, metric, own_basis=False)


plans = {bound: plan(scene, bound) for bound in bounds}
tell(plans[0.01])

# %%
fig, axes = plt.subplots(1, 2, figsize=(9, 2.8), layout="constrained")
names = [choice.surface.name for choice in plans[bounds[0]].plan.choices]
for i, (bound, planned) in enumerate(plans.items()):
    choices = planned.plan.choices
    position = np.arange(len(names)) + 0.26 * (i - 1)
    axes[0].bar(position, [c.operations for c in choices], 0.24, label=f"bound {bound:g}")
    axes[1].bar(position, [c.error for c in choices], 0.24)
    axes[1].axhline(bound, color=f"C{i}", lw=0.8, ls="--")
exact_operations = [choice.exact_operations for choice in choices]
axes[0].plot(np.arange(len(names)), exact_operations, "k_", ms=30, mew=1.5, label="exact equations")
axes[0].set(title="operations", ylim=(0, 1.45 * max(exact_operations)))
axes[0].legend(ncols=2, handlelength=1.2)
axes[1].set(yscale="log", title="predicted error; dashed: bounds")
for ax in axes:
    ax.set_axisbelow(True)
    ax.set_xticks(range(len(names)), names)
plt.show()


def takes(choice) -> str:
    return f"{choice.numbers} terms" if choice.model == "decomposition" else choice.model


for bound, planned in plans.items():
    print(f"bound {bound:5g}:", end=" ")
    print(*(f"{c.surface.name} {takes(c)}" for c in planned.plan.choices), sep=", ")

# %% [markdown]
# ## 4. Does it keep its word?
#
# `apply` puts the plan into the scene. Rendered with the same random numbers, the difference to the
# exact picture over the light that arrives (the same scene with metals that reflect everything) is
# the error of the reflectance as a pixel sees it. Its largest value over each metal should stay
# below what the plan predicts, but for noise, and for what it cannot know: a metal that shows
# another one shows that one's error too.

# %%
white = {**scene, **{name: {**scene[name], "material": "none"} for name in metals}}
arriving = fd.mitsuba.comparison.render_scene(mi.load_dict(white), spp)
surface = fd.mitsuba.visible_surface.visible_surface(mi.load_dict(scene), spp=16)
shown = np.array(surface.shape).reshape(size[1], size[0], 16)
errors = {}
for bound, planned in plans.items():
    picture = fd.mitsuba.comparison.render_scene(planned.apply(), spp)
    errors[bound] = np.abs(picture - exact).max(axis=-1) / np.maximum(arriving.max(axis=-1), 1e-6)
    for choice in planned.plan.choices:
        index = surface.names.index(f"{choice.surface.name} sphere")
        measured = errors[bound][(shown == index).all(axis=-1)].max()
        print(
            f"bound {bound:5g}, {choice.surface.name:10} predicted {choice.error:.4f}, "
            f"measured {measured:.4f}"
        )

# %%
fig, axes = plt.subplots(len(bounds), 1, figsize=(8, 6.6), layout="compressed")
for ax, (bound, error) in zip(axes, errors.items(), strict=True):
    ax.imshow(error / bound, cmap=style.SEQUENTIAL, vmin=0.0, vmax=1.0)
    ax.set_title(f"planned for {bound:g}: error over the bound")
    ax.set_axis_off()
fig.colorbar(axes[0].images[0], ax=axes, shrink=0.8)
plt.show()

# %% [markdown]
# ## 5. Other bounds, other lights
#
# The bound may be in CIEDE2000 instead. And under a point light nothing is averaged, so the
# prediction is the largest error of the curve, and the plan becomes dearer.

# %%
point = {"light": {"type": "point", "position": [4.0, -6.0, 7.0], "intensity": 150.0}}
for title, planned in {
    "sky, .01": plans[0.01],
    "sky, ΔE00 of 1": plan(scene, 1.0, "delta-e"),
    "point light, .01": plan(described(point), 0.01),
}.items():
    operations = planned.plan.operations
    print(f"{title:18} {operations:4} operations: {', '.join(map(takes, planned.plan.choices))}")

# %% [markdown]
# ## 6. On disk
#
# `write` writes the scene as XML with `decomposed_conductor` in place of the metals; everything
# else stays as it was. `fresnel-decomp plan scene.xml --max-error .01 --out planned.xml` is the
# same from a shell.

# %%
import tempfile  # noqa: E402
from pathlib import Path  # noqa: E402

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "planned.xml"
    plans[0.01].write(path)
    text = path.read_text(encoding="utf-8")
    start = text.index("decomposed_conductor")
    print(text[text.rindex("<", 0, start) : text.index("</bsdf>", start) + 7])
