"""The albedo table: error of every texel, layouts, lookups, files."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import AlbedoTable, InputError, directional_albedo, load_basis
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH
from fresnel_decomp.table_layout import ADDRESSING, ALPHA_AXES, MU_AXES, Layout

BASIS = load_basis()


@pytest.fixture(scope="module")
def table() -> AlbedoTable:
    return AlbedoTable.bake(BASIS, size=(24, 16), smith="correlated")


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("smith", SMITH)
def test_every_texel(distribution, smith):
    """5e-5 against 64 x 64 nodes, of the columns and rows where a table of 64 x 64 is hardest."""
    baked = AlbedoTable.bake(BASIS, smith=smith, distribution=distribution)
    assert baked.values.shape == (64, 64, 4)
    rows = [0, 1, 2, 3, 5, 8, 15, 20, 40, 60, 63]
    columns = [0, 1, 2, 3, 4, 6, 10, 20, 40, 63]
    alpha, mu = np.meshgrid(baked.layout.alpha[rows], baked.layout.mu[columns], indexing="ij")
    exact = directional_albedo(
        BASIS, mu, alpha, smith=smith, distribution=distribution, quadrature=(64, 64)
    )
    assert np.abs(baked.values[np.ix_(rows, columns)] - exact).max() <= 5e-5
    np.testing.assert_allclose(baked.values[0], BASIS(baked.layout.mu), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("recipe", ["talk", "notebook"])
@pytest.mark.parametrize("terms", [3, 4, 5, 6])
@pytest.mark.parametrize("smith", SMITH)
def test_every_texel_of_every_basis(recipe, terms, smith):
    baked = AlbedoTable.bake(load_basis(recipe, terms), smith=smith, measure=True)
    assert baked.metadata["measured_error"]["max"] <= 5e-5


@pytest.mark.parametrize("mu_axis", MU_AXES)
@pytest.mark.parametrize("alpha_axis", ALPHA_AXES)
@pytest.mark.parametrize("addressing", ADDRESSING)
def test_layouts(mu_axis, alpha_axis, addressing):
    """A lookup at a texel's own mu and alpha gives that texel."""
    layout = Layout(9, 7, mu_axis, alpha_axis, addressing)
    assert np.all(np.diff(layout.mu) > 0.0)
    assert np.all(np.diff(layout.alpha) > 0.0)
    if addressing == "centres":
        assert layout.mu[[0, -1]] == pytest.approx([0.0, 1.0])
        assert layout.alpha[[0, -1]] == pytest.approx([0.0, 1.0])
    columns, rows = layout.texel(layout.mu, layout.alpha[: len(layout.alpha)][:, None])
    np.testing.assert_allclose(columns, np.arange(9), atol=2e-4)
    np.testing.assert_allclose(rows[:, 0], np.arange(7), atol=2e-4)
    values = np.random.default_rng(0).random((7, 9, 5)).astype(np.float32)
    looked_up = AlbedoTable(values, layout).lookup(layout.mu, layout.alpha[:, None])
    np.testing.assert_allclose(looked_up, values, atol=2e-4)
    u, v = layout.texture_coordinates(layout.mu, layout.alpha[0])
    np.testing.assert_allclose(u, (np.arange(9) + 0.5) / 9, atol=1e-4)
    assert float(v) == pytest.approx(0.5 / 7, abs=1e-4)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_interpolation_stays_between_texels(mu, alpha):
    values = np.random.default_rng(1).random((4, 6, 3)).astype(np.float32)
    looked_up = AlbedoTable(values, Layout(6, 4)).lookup(mu, alpha)
    assert looked_up.shape == (3,)
    assert np.all(looked_up >= values.min(axis=(0, 1)) - 1e-7)
    assert np.all(looked_up <= values.max(axis=(0, 1)) + 1e-7)


def test_lookup_is_accurate(table):
    """Against the integral: linear interpolation of a sixth of the texels of the default table."""
    mu, alpha = np.meshgrid(np.linspace(0.05, 1.0, 9), np.linspace(0.05, 1.0, 8))
    exact = directional_albedo(BASIS, mu, alpha, smith="correlated")
    assert np.abs(table.lookup(mu, alpha) - exact).max() <= 0.012
    c = BASIS.coefficients(0.2, 3.0)
    np.testing.assert_allclose(table.evaluate(c, mu, alpha), exact @ c, atol=0.012)
    many = BASIS.coefficients(np.array([0.2, 1.5]), np.array([3.0, 0.0]))
    assert table.evaluate(many[:, None, None], mu, alpha).shape == (2, 8, 9)


def test_clamping(table):
    """Outside [0, 1] as on its border; NaN stays NaN, and single precision single."""
    inside = table.lookup(np.array([0.0, 1.0, 0.5, 0.5]), np.array([0.5, 0.5, 0.0, 1.0]))
    outside = table.lookup(np.array([-3.0, 7.0, 0.5, 0.5]), np.array([0.5, 0.5, -1.0, np.inf]))
    np.testing.assert_array_equal(inside, outside)
    np.testing.assert_array_equal(table.lookup(0.0, 0.0), table.values[0, 0])
    np.testing.assert_array_equal(table.lookup(1.0, 1.0), table.values[-1, -1])
    assert np.all(np.isnan(table.lookup(np.nan, 0.5)))
    assert table.lookup(np.float32(0.5), np.float32(0.5)).dtype == np.float32


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("terms", [3, 4, 6])
def test_drjit_lookup(backend, terms):
    kind = float_type(backend)
    small = AlbedoTable.bake(load_basis("talk", terms), size=(12, 8), quadrature=(8, 8))
    mu, alpha = np.random.default_rng(3).random((2, 500)).astype(np.float32)
    mu[:4], alpha[:4] = [0.0, 1.0, -1.0, 2.0], [1.0, 0.0, 2.0, -1.0]
    result = small.lookup(kind(mu.tolist()), kind(alpha.tolist()))
    assert len(result) == terms
    np.testing.assert_allclose(
        np.stack([np.array(v) for v in result], axis=-1), small.lookup(mu, alpha), atol=2e-6
    )
    c = [0.9, 0.1, -0.2, 0.15, 0.05, -0.02][:terms]
    albedo = small.evaluate(c, kind(mu.tolist()), kind(alpha.tolist()))
    np.testing.assert_allclose(np.array(albedo), small.evaluate(c, mu, alpha), atol=3e-6)


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize("addressing", ADDRESSING)
def test_lookup_gradients(table, backend, addressing):
    """Central differences between texels; finite everywhere, in both modes."""
    import drjit as dr

    kind = float_type(backend, "float64")
    layout = Layout(24, 16, addressing=addressing)
    table = AlbedoTable(table.values, layout)
    mu = np.array([0.0, 1.0, 0.013, 0.411, 0.87, 1e-12])
    alpha = np.array([0.0, 1.0, 0.323, 0.017, 0.81, 0.5])
    inside = (mu > 1e-3) & (mu < 1.0)
    for which in (0, 1):
        arrays = [kind(mu), kind(alpha)]
        dr.enable_grad(arrays[which])
        dr.backward(table.lookup(*arrays)[3])
        backward = np.array(arrays[which].grad)
        arrays = [kind(mu), kind(alpha)]
        dr.enable_grad(arrays[which])
        dr.set_grad(arrays[which], 1.0)
        forward = np.array(dr.forward_to(table.lookup(*arrays)[3]))
        assert np.all(np.isfinite(backward))
        np.testing.assert_allclose(forward, backward, rtol=1e-12)
        h = 1e-7
        moved = [table.lookup(mu + by * (1 - which), alpha + by * which)[..., 3] for by in (h, -h)]
        difference = (moved[0] - moved[1]) / (2.0 * h)
        np.testing.assert_allclose(backward[inside], difference[inside], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize("which", range(6), ids=["mu", "alpha", "c0", "c1", "c2", "c3"])
def test_evaluate_with_one_drjit_argument(table, backend, which):
    """Whichever it is, the result is of its kind and has its gradient."""
    import drjit as dr

    kind = float_type(backend, "float64")
    arguments = [0.41, 0.3, *map(float, BASIS.coefficients(0.2, 3.0))]
    expected = table.evaluate(arguments[2:], *arguments[:2])
    h = 1e-6
    moved = [[value + by * (i == which) for i, value in enumerate(arguments)] for by in (h, -h)]
    up, down = (table.evaluate(values[2:], *values[:2]) for values in moved)
    traced = kind(arguments[which])
    dr.enable_grad(traced)
    given = [*arguments[:which], traced, *arguments[which + 1 :]]
    albedo = table.evaluate(given[2:], *given[:2])
    assert type(albedo) is kind
    assert albedo[0] == pytest.approx(expected, abs=1e-12)
    dr.backward(albedo)
    assert traced.grad[0] == pytest.approx((up - down) / (2.0 * h), abs=1e-8)
    plain = np.array(arguments[2:])  # coefficients as NumPy has them
    if which < 2:
        assert type(table.evaluate(plain, *given[:2])) is kind


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_drjit_bake(table, backend, precision):
    kind = float_type(backend, precision)
    baked = AlbedoTable.bake(BASIS, size=(24, 16), smith="correlated", float_type=kind)
    assert np.abs(baked.values - table.values).max() <= 5e-6


def test_other_bases():
    """A closed form, and any callable: here Karis's two terms of Schlick's curve."""
    closed = AlbedoTable.bake(BASIS.closed_form, size=8)
    assert np.abs(closed.values - AlbedoTable.bake(BASIS, size=8).values).max() <= 2e-4
    schlick = AlbedoTable.bake(
        lambda c: np.stack([1.0 - (1.0 - c) ** 5, (1.0 - c) ** 5], axis=-1), size=8
    )
    assert schlick.terms == 2
    assert schlick.metadata["basis"]["recipe"] == "custom"
    white = AlbedoTable.bake(lambda c: np.ones_like(c)[:, None], size=8)
    np.testing.assert_allclose(schlick.values.sum(axis=-1), white.values[..., 0], atol=1e-6)


def test_bad_input():
    for arguments, words in (
        ({"size": 1}, "1 x 1 texels"),
        ({"size": 64.0}, "size=64.0"),
        ({"mu_axis": "sqrt"}, "Did you mean 'sqrt_mu'"),
        ({"alpha_axis": "roughness"}, "perceptual_roughness"),
        ({"addressing": "corners"}, "'centres'"),
        ({"distribution": "phong"}, "'ggx'"),
        ({"smith": "both"}, "'separable'"),
        ({"float_type": int}, "float_type"),
    ):
        with pytest.raises(InputError, match=words):
            AlbedoTable.bake(BASIS, **({"size": 4} | arguments))
    with pytest.raises(InputError, match="Stack the functions"):
        AlbedoTable.bake(lambda c: c, size=4)
    with pytest.raises(InputError, match=r"\(64, 64, terms\)"):
        AlbedoTable(np.zeros((3, 4, 4)), Layout())
    with pytest.raises(InputError, match="4"):
        AlbedoTable(np.zeros((64, 64, 4)), Layout()).evaluate([1.0, 2.0], 0.5, 0.5)


def test_arguments_that_do_not_fit(table):
    for wrong in ("rough", None, 0.5j):
        with pytest.raises(InputError, match="accepted: real numbers"):
            table.lookup(wrong, 0.5)
        with pytest.raises(InputError, match="accepted: real numbers"):
            table.evaluate(np.ones(4), 0.5, wrong)
    with pytest.raises(InputError, match=r"shapes \(3,\), \(2,\)"):
        table.lookup(np.zeros(3), np.zeros(2))
    kind = float_type("llvm")
    with pytest.raises(InputError, match="sizes 2, 3"):
        table.lookup(kind([0.1, 0.2, 0.3]), kind([0.1, 0.2]))
    sized = AlbedoTable.bake(BASIS, size=np.int64(4), quadrature=(np.int64(4), 4))
    assert sized.layout == Layout(4, 4)
    assert type(sized.layout.width) is int
    with pytest.raises(InputError, match="quadrature=5"):
        AlbedoTable.bake(BASIS, size=4, quadrature=5)


# --- files ---------------------------------------------------------------------------------------

FORMATS = [("exr", True), ("exr", False), ("npz", True), ("npz", False), ("half", True)]


@pytest.mark.parametrize(("suffix", "half"), FORMATS)
@pytest.mark.parametrize("terms", [3, 4, 5, 6])
def test_round_trip(tmp_path, suffix, half, terms):
    baked = AlbedoTable.bake(load_basis("talk", terms), size=(9, 5), quadrature=(8, 8))
    path = tmp_path / f"table.{suffix}"
    baked.save(path, half=half)
    loaded = AlbedoTable.load(path)
    expected = baked.values.astype(np.float16) if half else baked.values
    np.testing.assert_array_equal(loaded.values, expected.astype(np.float32))
    assert loaded.layout == baked.layout
    assert (loaded.smith, loaded.distribution) == ("separable", "ggx")
    assert loaded.metadata == baked.metadata


def test_exr_read_by_openexr_and_mitsuba(tmp_path, table):
    """Channels, types and attributes as two readers see them that are not ours."""
    import mitsuba as mi
    import OpenEXR

    mi.set_variant("scalar_rgb")
    for half in (True, False):
        path = tmp_path / f"{half}.exr"
        table.save(path, half=half)
        stored = table.values.astype(np.float16 if half else np.float32)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            header = dict(file.header())
            for i, name in enumerate("RGBA"):
                pixels = file.channels()[name].pixels
                assert pixels.dtype == stored.dtype
                np.testing.assert_array_equal(pixels, stored[..., i])
        np.testing.assert_array_equal(np.array(mi.Bitmap(str(path))), stored)
        assert header["smith"] == "correlated"
        assert header["axes"].startswith("x = sqrt(mu), y = sqrt(alpha), row 0 smoothest")
        assert header["recipe"] == "talk"
        assert header["basisSha256"] == BASIS.provenance["sha256"]
        assert header["measuredError"] == "not measured"
        assert json.loads(header["fresnelDecomp"])["sha256"] == header["sha256"]
    six = AlbedoTable.bake(load_basis("talk", 6), size=4, quadrature=(8, 8), measure=True)
    six.save(tmp_path / "six.exr")
    with OpenEXR.File(str(tmp_path / "six.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {*"RGBA", "second.R", "second.G"}
        assert float(file.header()["measuredError"]) > 0.0


def test_npz_and_half_read_by_others(tmp_path, table):
    table.save(tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["values"], table.values)
        assert json.loads(str(file["metadata"]))["smith"] == "correlated"
    table.save(tmp_path / "t.half")
    data = (tmp_path / "t.half").read_bytes()
    numbers = struct.unpack(f"<{len(data) // 2}e", data)
    np.testing.assert_array_equal(
        np.reshape(numbers, (16, 24, 4)).astype(np.float32), table.values.astype(np.float16)
    )
    three = AlbedoTable(table.values[..., :3], table.layout)
    three.save(tmp_path / "three.half")
    raw = np.fromfile(tmp_path / "three.half", "<f2").reshape(16, 24, 4)
    np.testing.assert_array_equal(raw[..., 3], 0.0)


@pytest.mark.parametrize(("suffix", "half"), FORMATS)
def test_truncated_files(tmp_path, table, suffix, half):
    path = tmp_path / f"table.{suffix}"
    table.save(path, half=half)
    data = path.read_bytes()
    for length in (0, 10, len(data) // 2, len(data) - 5):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=r"table\."):
            AlbedoTable.load(path)


def test_changed_files(tmp_path, table):
    """Values, sizes, channels and metadata that do not belong together."""
    from fresnel_decomp.images import read_exr_attributes, read_exr_planes, write_exr

    path = tmp_path / "t.exr"
    table.save(path)
    planes, attributes = read_exr_planes(path), read_exr_attributes(path)
    attributes = {k: v for k, v in attributes.items() if k not in ("type",)}
    resized = {name: plane[:, :12] for name, plane in planes.items()}
    write_exr(path, resized, attributes)
    with pytest.raises(InputError, match="12 x 16 texels of 4 terms; accepted: 24 x 16"):
        AlbedoTable.load(path)
    write_exr(path, {name: planes[name] for name in "RGB"}, attributes)
    with pytest.raises(InputError, match="channels B, G, R; accepted: R, G, B, A"):
        AlbedoTable.load(path)
    write_exr(path, {**planes, "R": planes["R"][::-1]}, attributes)
    with pytest.raises(InputError, match="do not match the hash"):
        AlbedoTable.load(path)
    write_exr(path, planes)
    with pytest.raises(InputError, match="no albedo table"):
        AlbedoTable.load(path)

    table.save(tmp_path / "t.half")
    sidecar = tmp_path / "t.half.json"
    description = json.loads(sidecar.read_text())
    sidecar.write_text(
        json.dumps({**description, "layout": {**description["layout"], "width": 23}})
    )
    with pytest.raises(InputError, match="2,944 bytes"):
        AlbedoTable.load(tmp_path / "t.half")
    sidecar.write_text("{")
    with pytest.raises(InputError, match="metadata"):
        AlbedoTable.load(tmp_path / "t.half")
    sidecar.unlink()
    with pytest.raises(InputError, match=r"t\.half\.json"):
        AlbedoTable.load(tmp_path / "t.half")

    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(InputError, match="arrays a"):
        AlbedoTable.load(tmp_path / "other.npz")
    with pytest.raises(InputError, match="no file"):
        AlbedoTable.load(tmp_path / "missing.exr")
    with pytest.raises(InputError, match=r"format='\.png'"):
        table.save(tmp_path / "t.png")
    with pytest.raises(InputError, match="half=False"):
        table.save(tmp_path / "t.half", half=False)
    huge = AlbedoTable(table.values * 1e6, table.layout)
    with pytest.raises(InputError, match="65504"):
        huge.save(tmp_path / "huge.exr")
    assert not (tmp_path / "huge.exr").exists()


def test_half_files_are_replaced_together(tmp_path, table, monkeypatch):
    """If the second of the two cannot be written, the first stays as it was."""
    from pathlib import Path

    path = tmp_path / "t.half"
    table.save(path)
    before = sorted((file.name, file.read_bytes()) for file in tmp_path.iterdir())

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    other = AlbedoTable(table.values[::-1], table.layout)
    with pytest.raises(InputError, match=r"cannot write .*t\.half\.json' \(No space left"):
        other.save(path)
    monkeypatch.undo()
    assert sorted((file.name, file.read_bytes()) for file in tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "metadata", [{"error": np.float32(1e-5)}, {"error": np.nan}, {"basis": {1, 2}}, 5]
)
def test_metadata_that_json_cannot_hold(table, metadata):
    with pytest.raises(InputError, match=r"JSON cannot hold .*; accepted: a mapping .*\. Convert"):
        AlbedoTable(table.values, table.layout, metadata=metadata)


@pytest.mark.parametrize("metadata", [{"basis": None}, {"basis": 3, "measured_error": "small"}])
@pytest.mark.parametrize("suffix", ["exr", "npz", "half"])
def test_any_other_metadata(tmp_path, table, metadata, suffix):
    named = AlbedoTable(table.values, table.layout, metadata=metadata)
    named.save(tmp_path / f"t.{suffix}")
    assert AlbedoTable.load(tmp_path / f"t.{suffix}").metadata == metadata


@pytest.mark.parametrize("suffix", ["exr", "npz", "half"])
def test_missing_folder(tmp_path, table, suffix):
    path = tmp_path / "nowhere" / f"t.{suffix}"
    with pytest.raises(InputError, match=rf"nowhere.t\.{suffix}' \(No such file"):
        table.save(path)


def test_files_of_something_else(tmp_path, table):
    with (tmp_path / "bare.npz").open("wb") as file:
        np.save(file, table.values)
    with pytest.raises(InputError, match="single array without a name"):
        AlbedoTable.load(tmp_path / "bare.npz")
    table.save(tmp_path / "t.half")
    (tmp_path / "t.half.json").write_bytes(b"{\xff\xfe}")
    with pytest.raises(InputError, match=r"cannot read .*t\.half\.json' .*utf-8"):
        AlbedoTable.load(tmp_path / "t.half")


def test_values_that_are_no_albedos():
    layout = Layout(4, 4)
    for value, words in ((np.nan, "16 are not finite"), (1e300, "not finite"), (1j, "complex128")):
        with pytest.raises(InputError, match=words):
            AlbedoTable(np.full((4, 4, 1), value), layout)
    with pytest.raises(InputError, match="layout=None"):
        AlbedoTable(np.zeros((4, 4, 1)), None)
    for f, words in (
        (lambda c: np.full((len(c), 2), np.nan), "not finite"),
        (lambda c: np.ones((len(c), 2)) * 1j, "complex128"),
    ):
        with pytest.raises(InputError, match=words):
            AlbedoTable.bake(f, size=4)


# --- Mitsuba -------------------------------------------------------------------------------------


@pytest.mark.parametrize("terms", [3, 4, 6])
def test_mitsuba_textures(variant, terms):
    """Texture2f and `bitmap` textures give what the table gives."""
    import drjit as dr
    import mitsuba as mi

    from fresnel_decomp.mitsuba.albedo_texture import AlbedoTexture, bitmap_textures

    small = AlbedoTable.bake(load_basis("talk", terms), size=(12, 8), quadrature=(8, 8))
    mu, alpha = [0.0, 0.003, 0.4, 1.0, 2.0], [0.0, 1.0, 0.3, 0.01, -1.0]
    bitmaps = [mi.load_dict(texture) for texture in bitmap_textures(small)]
    textures = AlbedoTexture(small)
    for m, a in zip(mu, alpha, strict=True):
        expected = small.lookup(m, a)
        result = [np.ravel(np.array(v))[0] for v in textures.lookup(m, a)]
        np.testing.assert_allclose(result, expected, atol=1e-5)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.uv = mi.Point2f(*map(float, small.layout.texture_coordinates(m, a)))
        channels = [np.ravel(np.array(texture.eval_3(si))) for texture in bitmaps]
        np.testing.assert_allclose(np.concatenate(channels)[:terms], expected, atol=1e-5)
