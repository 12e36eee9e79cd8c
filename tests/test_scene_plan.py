"""Plans for Mitsuba scenes: nested, referenced, instanced BSDFs found, replaced and rendered."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp import InputError, conductor, load_basis
from fresnel_decomp.images import write_exr
from fresnel_decomp.mitsuba import fresnel_terms, register
from fresnel_decomp.mitsuba.environment import row_weights
from fresnel_decomp.mitsuba.inventory import take_inventory
from fresnel_decomp.mitsuba.operations import count_operations, count_vector_operations
from fresnel_decomp.mitsuba.scene_plan import plan_scene
from fresnel_decomp.mitsuba.scenes import studio_lights
from fresnel_decomp.mitsuba.skies import city
from fresnel_decomp.prediction import EVEN_SKY, operations

LLVM_RGB = pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)


@pytest.fixture(autouse=True)
def _quiet(variant: str) -> None:
    mi.set_log_level(mi.LogLevel.Error)


MATERIALS = """<scene version="3.0.0">
  <bsdf type="roughconductor" id="gold">
    <string name="material" value="Au"/>
    <string name="distribution" value="ggx"/>
    <float name="alpha" value="$roughness"/>
    <rgb name="specular_reflectance" value="0.9 0.8 0.7"/>
  </bsdf>
  <bsdf type="twosided" id="leaf"><ref id="gold"/></bsdf>
  <bsdf type="roughconductor" id="unused"><string name="material" value="Ag"/></bsdf>
</scene>
"""
SCENE = """<scene version="0.6.0">
  <default name="roughness" value="0.2"/>
  <include filename="materials.xml"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <film type="hdrfilm">
      <integer name="width" value="16"/><integer name="height" value="16"/>
      <rfilter type="box"/>
    </film>
    <transform name="toWorld"><lookat origin="0 -9 4" target="0 0 0" up="0 0 1"/></transform>
  </sensor>
  <shape type="sphere" id="leafy"><ref id="leaf"/></shape>
  <shape type="rectangle">
    <transform name="toWorld"><translate x="-2.5"/></transform>
    <ref name="bsdf" id="leaf"/>
  </shape>
  <shape type="sphere">
    <point name="center" x="2.5" y="0" z="0"/>
    <bsdf type="blendbsdf">
      <float name="weight" value="0.5"/>
      <bsdf type="mask">
        <float name="opacity" value="0.5"/>
        <bsdf type="roughconductor">
          <spectrum name="eta" value="400:1.2, 700:0.3"/>
          <spectrum name="k" value="400:2.2, 700:4.1"/>
          <float name="alphaU" value="0.05"/>
          <float name="alphaV" value="0.3"/>
        </bsdf>
      </bsdf>
      <bsdf type="bumpmap">
        <bsdf type="roughconductor"><string name="material" value="Cr"/></bsdf>
        <texture type="bitmap"><string name="filename" value="bumps.exr"/></texture>
      </bsdf>
    </bsdf>
  </shape>
  <shape type="shapegroup" id="group">
    <shape type="sphere">
      <float name="radius" value="0.4"/>
      <bsdf type="roughconductor" id="speckled">
        <string name="material" value="Al"/>
        <texture type="checkerboard" name="alpha">
          <float name="color0" value="0.1"/><float name="color1" value="0.5"/>
        </texture>
      </bsdf>
    </shape>
  </shape>
  <shape type="instance"><ref id="group"/></shape>
  <shape type="instance">
    <transform name="toWorld"><translate y="2"/></transform>
    <ref id="group"/>
  </shape>
  <shape type="rectangle"><bsdf type="conductor"><string name="material" value="Cu"/></bsdf></shape>
  <shape type="rectangle">
    <bsdf type="roughconductor" id="patterned">
      <texture type="checkerboard" name="eta"/><float name="k" value="3"/>
    </bsdf>
  </shape>
  <shape type="rectangle"><bsdf type="roughplastic" id="plastic"/></shape>
  <shape type="rectangle"><bsdf type="dielectric" id="glass"/></shape>
  <shape type="rectangle">
    <bsdf type="dielectric" id="bubble">
      <float name="intIOR" value="1.0"/><float name="extIOR" value="1.33"/>
    </bsdf>
  </shape>
  <emitter type="constant"/>
</scene>
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    (tmp_path / "materials.xml").write_text(MATERIALS, encoding="utf-8")
    bumps = np.random.default_rng(0).uniform(0.0, 0.02, (8, 8)).astype(np.float32)
    write_exr(tmp_path / "bumps.exr", bumps)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@LLVM_RGB
def test_what_is_found(scene_file: Path, variant: str) -> None:
    found = take_inventory(scene_file)
    surfaces = {surface.name: surface for surface in found.surfaces}
    assert len(surfaces) == len(found.surfaces) == 4  # each once, the unused one not
    assert surfaces["gold"].alpha == pytest.approx((0.2, 0.2))
    assert surfaces["gold"].distribution == "ggx"
    assert surfaces["speckled"].alpha == pytest.approx((0.1, 0.5))
    assert surfaces["speckled"].distribution == "beckmann"
    nested = next(s for s in found.surfaces if s.alpha == pytest.approx((0.05, 0.3)))
    assert nested.eta[0] < nested.eta[2]
    assert found.lights == ("ConstantBackgroundEmitter",)
    assert all(surface.contrast == EVEN_SKY for surface in found.surfaces)
    left = {entry.name: entry for entry in found.left}
    assert left["patterned"].why == "its index is textured"
    assert left["plastic"].kind == "roughplastic"
    assert left["glass"].surface.eta == pytest.approx([1.5046 / 1.000277], abs=1e-4)
    assert "eta < 1" in left["bubble"].why
    assert [entry.kind for entry in found.left].count("conductor") == 1
    # the built-in's own values, gold's among them
    gold = mi.load_dict({"type": "roughconductor", "material": "Au"})
    eta = mi.traverse(gold)["eta.value"]
    np.testing.assert_allclose(surfaces["gold"].eta, np.ravel(np.array(eta)), rtol=1e-6)


@LLVM_RGB
def test_loaded_scenes_are_found_but_not_changed(scene_file: Path, variant: str) -> None:
    register()
    loaded = plan_scene(mi.load_file(str(scene_file)), 0.03, own_basis=False)
    parsed = plan_scene(scene_file, 0.03, own_basis=False)
    found = [
        sorted((*c.surface.eta, *c.surface.alpha, c.model) for c in p.plan.choices)
        for p in (loaded, parsed)
    ]
    assert found[0] == found[1]
    with pytest.raises(InputError, match="a plan for a loaded scene"):
        loaded.apply()


@LLVM_RGB
@pytest.mark.parametrize("bound", [0.2, pytest.param(0.004, marks=pytest.mark.slow)])
def test_files_are_rewritten(scene_file: Path, bound: float, variant: str) -> None:
    planned = plan_scene(scene_file, bound, own_basis=False)
    path = scene_file.with_name("planned.xml")
    planned.write(path)
    text = path.read_text(encoding="utf-8")
    assert text.count('type="decomposed_conductor"') == 4
    # the unused and the patterned conductor stay what they were
    assert text.count('type="roughconductor"') == 2
    assert ('name="c3"' in text) == (bound < 0.1)
    images = [
        np.array(mi.render(scene, spp=16, seed=1))
        for scene in (mi.load_file(str(path), optimize=False), planned.apply())
    ]
    np.testing.assert_allclose(images[0], images[1], atol=2e-6)
    exact = np.array(mi.render(mi.load_file(str(scene_file), optimize=False), spp=16, seed=1))
    assert not np.array_equal(images[0], exact)
    assert np.abs(images[0] - exact).max() <= 3.0 * bound


@LLVM_RGB
@pytest.mark.slow
def test_a_basis_of_its_own_lies_beside_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variant: str
) -> None:
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.1}
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
        "ball": {"type": "sphere", "center": [0, 0, 3], "bsdf": gold},
        "sky": {"type": "constant"},
    }
    planned = plan_scene(scene, 0.012, recipes=["talk"])
    assert planned.plan.basis is not None
    assert planned.plan.basis.recipe == "custom"
    path = tmp_path / "planned.xml"
    planned.write(path)
    assert load_basis(tmp_path / "planned-basis.json").terms == planned.plan.basis.terms
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    image = np.array(mi.render(mi.load_file(str(path), optimize=False), spp=4, seed=1))
    same = np.array(mi.render(planned.apply(), spp=4, seed=1))
    np.testing.assert_allclose(image, same, atol=2e-6)


@LLVM_RGB
def test_the_prediction_holds(variant: str) -> None:
    """In a scene of one sphere under an even sky, at every pixel of it."""

    def scene(bsdf: dict[str, Any]) -> dict[str, Any]:
        film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}}
        look = mi.ScalarTransform4f().look_at([0, -10, 0], [0, 0, 0], [0, 0, 1])
        return {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "sensor": {"type": "perspective", "fov": 11.0, "to_world": look, "film": film},
            "ball": {"type": "sphere", "bsdf": bsdf},
            "sky": {"type": "constant"},
        }

    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.2, "distribution": "ggx"}
    image = {}
    for name, described in (("exact", gold), ("white", {**gold, "material": "none"})):
        image[name] = np.array(mi.render(mi.load_dict(scene(described)), spp=64, seed=3))
    for bound in (0.05, 0.01, 0.002):
        planned = plan_scene(scene(gold), bound, own_basis=False)
        predicted = planned.plan.choices[0].error
        assert predicted <= bound
        rendered = np.array(mi.render(planned.apply(), spp=64, seed=3))
        y, x = np.mgrid[:64, :64] - 31.5
        on_the_ball = np.hypot(x, y) < 31.0
        measured = (np.abs(rendered - image["exact"]) / image["white"])[on_the_ball].max()
        assert measured <= predicted
        assert predicted <= 3.0 * measured


@LLVM_RGB
@pytest.mark.slow
def test_in_a_cave_only_the_guarantee_holds(variant: str) -> None:
    """A black tube around the sphere, open behind it: far more contrast than the emitter has."""
    film = {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}}
    look = mi.ScalarTransform4f().look_at([0, -7, 0], [0, 0, 0], [0, 0, 1])
    along = mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale([1.6, 1.6, 9.0])
    along = mi.ScalarTransform4f().translate([0, -8, 0]) @ along
    lid = mi.ScalarTransform4f().translate([0, -8, 0]).rotate([1, 0, 0], 90).scale(1.6)
    metal = {"type": "roughconductor", "material": "Al", "alpha": 0.3, "distribution": "ggx"}

    def scene(bsdf: dict[str, Any]) -> dict[str, Any]:
        black = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.0}}
        return {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "sensor": {"type": "perspective", "fov": 16.0, "to_world": look, "film": film},
            "ball": {"type": "sphere", "bsdf": bsdf},
            "tube": {"type": "cylinder", "to_world": along, "bsdf": black},
            "lid": {"type": "disk", "to_world": lid, "bsdf": black},
            "sky": {"type": "constant"},
        }

    image = {}
    for name, described in (("exact", metal), ("white", {**metal, "material": "none"})):
        image[name] = np.array(mi.render(mi.load_dict(scene(described)), spp=256, seed=3))
    measured, predicted = {}, {}
    for contrast in (None, np.inf):
        planned = plan_scene(scene(metal), 0.03, own_basis=False, contrast=contrast)
        rendered = np.array(mi.render(planned.apply(), spp=256, seed=3))
        lit = image["white"].min(axis=-1) > 1e-3
        error = np.abs(rendered - image["exact"]) / np.maximum(image["white"], 1e-3)
        measured[contrast] = error[lit].max()
        predicted[contrast] = planned.plan.choices[0].error
    assert measured[None] > predicted[None]  # what the page warns of
    assert measured[np.inf] <= predicted[np.inf]


@LLVM_RGB
def test_lights_decide(variant: str) -> None:
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.3}
    lights = {
        "even": {"type": "constant"},
        "point": {"type": "point", "position": [0, 0, 3]},
        "area": {
            "type": "sphere",
            "center": [0, 0, 3],
            "radius": 0.1,
            "emitter": {"type": "area", "radiance": 9.0},
        },
    }
    bitmap = np.ones((16, 32, 3), np.float32)
    bitmap[3, 5] = 500.0
    lights["sun"] = {"type": "envmap", "bitmap": mi.Bitmap(bitmap)}
    contrast = {}
    for name, light in lights.items():
        scene = mi.load_dict({"type": "scene", "s": {"type": "sphere", "bsdf": gold}, "l": light})
        contrast[name] = take_inventory(scene).surfaces[0].contrast
    assert contrast["even"] == EVEN_SKY
    assert contrast["point"] == contrast["area"] == np.inf
    assert 50.0 < contrast["sun"] < np.inf


@pytest.mark.parametrize("kind", ["studio", "city"])
def test_environments_have_one_contrast_in_all_variants(kind: str) -> None:
    """Spectral variants keep coefficients of spectra in the place of radiance."""
    radiance = studio_lights(64) if kind == "studio" else city(64).radiance
    grey = radiance.mean(axis=-1, dtype=np.float64)
    area = row_weights(len(grey))[:, None] / (2.0 * grey.shape[1])
    mean = (area * grey).sum()
    expected = EVEN_SKY + (area * (grey / mean - 1.0) ** 2).sum()
    gold = {"type": "roughconductor", "material": "Au"}
    before = mi.variant()
    for name in ("scalar_rgb", "scalar_spectral"):
        mi.set_variant(name)
        light = {"type": "envmap", "bitmap": mi.Bitmap(np.array(radiance))}
        scene = mi.load_dict({"type": "scene", "s": {"type": "sphere", "bsdf": gold}, "l": light})
        found = take_inventory(scene).surfaces[0].contrast
        # of colours, the mean over wavelengths is only nearly that over the channels
        assert found == pytest.approx(expected, rel=1e-5 if kind == "studio" else 0.02), name
    mi.set_variant(before)


def test_roughness_that_is_known_in_part(variant: str) -> None:
    attribute = {"type": "mesh_attribute", "name": "vertex_alpha"}
    board = {"type": "checkerboard", "color0": 0.2, "color1": 0.3}
    half = {"type": "checkerboard", "color0": 0.2, "color1": attribute}
    gold = {"type": "roughconductor", "material": "Au"}
    for given, expected in (
        ({"alpha": board}, (0.2, 0.3)),
        ({"alpha": half}, (1e-3, 1.0)),
        ({"alpha_u": board, "alpha_v": attribute}, (1e-3, 1.0)),
    ):
        scene = {"type": "scene", "s": {"type": "sphere", "bsdf": gold | given}}
        assert take_inventory(scene).surfaces[0].alpha == pytest.approx(expected)


def test_a_scene_without_metal_carries_nothing(variant: str) -> None:
    planned = plan_scene(mi.cornell_box(), 0.01)
    assert planned.plan.choices == ()
    assert planned.plan.left == ()
    assert planned.plan.basis is None
    assert planned.plan.nbytes == 0


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["llvm_ad_spectral", "llvm_ad_mono"], indirect=True)
def test_other_variants(scene_file: Path, variant: str) -> None:
    """Spectra are planned as such and stay spectra; one channel has one coefficient each."""
    planned = plan_scene(scene_file, 0.004, own_basis=False)
    channels = {len(choice.surface.eta) for choice in planned.plan.choices}
    assert channels <= ({1, 471} if "spectral" in variant else {1})
    path = scene_file.with_name("planned.xml")
    planned.write(path)
    assert ('name="c0"' in path.read_text(encoding="utf-8")) == ("mono" in variant)
    spp = 4 if variant.startswith("scalar") else 16
    images = [
        np.array(mi.render(mi.load_file(str(p)), spp=spp, seed=1)) for p in (scene_file, path)
    ]
    assert np.abs(images[1] - images[0]).max() <= 0.1


FOREIGN = os.environ.get("FRESNEL_DECOMP_SCENES")


@LLVM_RGB
@pytest.mark.slow
@pytest.mark.skipif(not FOREIGN, reason="FRESNEL_DECOMP_SCENES names no folder of Mitsuba scenes")
def test_foreign_scenes(tmp_path: Path, variant: str) -> None:
    """Every scene file of a folder that loads: planned, rewritten, and loaded again."""
    count = 0
    for path in sorted(Path(str(FOREIGN)).rglob("*.xml")):
        try:
            mi.load_file(str(path))
        except Exception:
            continue  # a fragment, or a plugin that is not installed
        planned = plan_scene(path, 0.02, own_basis=False)
        changed = planned.apply()
        assert isinstance(changed, mi.Scene)
        assert len(changed.shapes()) == len(mi.load_file(str(path)).shapes())
        count += 1
    assert count


@LLVM_RGB
def test_operations_are_those_of_the_kernels(variant: str) -> None:
    def exact(c, eta, k):
        return mi.fresnel_conductor(c, mi.Complex2f(eta, k))

    assert count_operations(exact, 0.5, 0.2, 3.0).total() == operations("exact", 1)
    for precision in ("native", "wide"):
        everything = count_vector_operations(
            lambda *a, p=precision: conductor(*a, precision=p), 0.5, 0.2, 3.0
        )
        arithmetic = count_operations(
            lambda *a, p=precision: conductor(*a, precision=p), 0.5, 0.2, 3.0
        )
        by_name = Counter()
        for (name, bits), count in everything.items():
            by_name[name] += count
            assert bits in ((1, 32) if precision == "native" else (1, 32, 64))
        assert {name: by_name[name] for name in arithmetic} == arithmetic
        assert by_name["select"] > 0
        assert by_name["fcmp"] > 0
        assert (by_name["fpext"] > 0) == (precision == "wide")
    for channels, pack in ((1, lambda v: v[0]), (3, lambda v: mi.Color3f(*v))):
        for terms in (3, 4, 6):
            basis = load_basis("talk", terms)

            def decomposition(c, *v, basis=basis, terms=terms, channels=channels, pack=pack):
                c_i = [pack(v[channels * i : channels * (i + 1)]) for i in range(terms)]
                return fresnel_terms.Decomposition(basis)(c, *c_i)

            counted = count_operations(decomposition, 0.5, *[0.1] * (terms * channels))
            assert counted.total() == operations("decomposition", channels, basis)
        counted = count_operations(
            lambda c, *v, pack=pack: fresnel_terms.Schlick()(c, pack(v)), 0.5, *[0.1] * channels
        )
        assert counted.total() == operations("schlick", channels)
        counted = count_operations(
            lambda c, *v, pack=pack, n=channels: fresnel_terms.F82()(c, pack(v[:n]), pack(v[n:])),
            0.5,
            *[0.1] * (2 * channels),
        )
        assert counted.total() == operations("f82", channels)


def test_bad_input(scene_file: Path, variant: str) -> None:
    with pytest.raises(InputError, match="no file"):
        plan_scene(scene_file.with_name("absent.xml"), 0.01)
    with pytest.raises(InputError, match="max_error=-1"):
        plan_scene(mi.cornell_box(), -1.0)
    broken = scene_file.with_name("broken.xml")
    broken.write_text('<scene version="3.0.0"><shape type="spheer"/></scene>', encoding="utf-8")
    with pytest.raises(InputError, match="does not load"):
        plan_scene(broken, 0.01)
    planned = plan_scene(mi.cornell_box(), 0.01)
    with pytest.raises(InputError, match=r"ending in \.xml"):
        planned.write(scene_file.with_name("scene.json"))
    with pytest.raises(InputError, match="cannot write to folder"):
        planned.write(scene_file / "below a file" / "scene.xml")
    if variant.startswith("scalar"):
        with pytest.raises(InputError, match="variant scalar_rgb"):
            count_operations(lambda x: x, 0.5)
        with pytest.raises(InputError, match=r"variant scalar_rgb; accepted: an llvm_ad variant"):
            count_vector_operations(lambda x: x, 0.5)
        return
    mi.set_variant("scalar_rgb")
    with pytest.raises(InputError, match="variant scalar_rgb"):
        planned.apply()
    mi.set_variant(variant)


def test_what_xml_cannot_hold_leaves_nothing_behind(tmp_path: Path, variant: str) -> None:
    gold = {"type": "roughconductor", "material": "Au"}
    light = {"type": "envmap", "bitmap": mi.Bitmap(np.ones((8, 16, 3), np.float32))}
    scene = {"type": "scene", "s": {"type": "sphere", "bsdf": gold}, "l": light}
    planned = plan_scene(scene, 0.2, own_basis=False)
    with pytest.raises(InputError, match="XML cannot hold"):
        planned.write(tmp_path / "planned.xml")
    assert list(tmp_path.iterdir()) == []


def test_no_roughness_is_left_alone(variant: str) -> None:
    mirror = {"type": "roughconductor", "material": "Au", "alpha": 0.0}
    found = take_inventory({"type": "scene", "s": {"type": "sphere", "bsdf": mirror}})
    assert found.surfaces == ()
    assert "roughness is 0" in found.left[0].why


def test_the_contrast_of_darkness(variant: str) -> None:
    dark = {"type": "envmap", "bitmap": mi.Bitmap(np.zeros((8, 16, 3), np.float32))}
    gold = {"type": "roughconductor", "material": "Au"}
    scene = {"type": "scene", "s": {"type": "sphere", "bsdf": gold}, "l": dark}
    found = take_inventory(mi.load_dict(scene))
    assert found.surfaces[0].contrast == EVEN_SKY
