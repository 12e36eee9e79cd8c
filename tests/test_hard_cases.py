"""The hostile table of reference values, and every model at its limits, on every backend."""

from __future__ import annotations

import csv
from dataclasses import dataclass

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import conductor, load_basis, reflectance_components, transmittance
from fresnel_decomp.models import F82, Decomposition, Exact, Gulbrandsen, Lazanyi, Schlick
from oracles import central_difference, ulps
from tolerances import GRADIENT, NATIVE_P_FLOOR, NATIVE_P_ULP, NATIVE_ULP, WIDE_ULP

QUANTITIES = ("R", "T", "R_s", "R_p", "T_s", "T_p")
INPUTS = ("cos_theta", "eta", "k")


@dataclass
class Cases:
    """Rows of `hard_cases.csv`: exact inputs, reference values, derivatives (NaN: none exists)."""

    region: np.ndarray
    inputs: np.ndarray
    values: dict[str, np.ndarray]
    gradients: dict[str, np.ndarray]

    def where(self, mask):
        def pick(columns):
            return {name: column[mask] for name, column in columns.items()}

        return Cases(
            self.region[mask], self.inputs[:, mask], pick(self.values), pick(self.gradients)
        )

    def at(self, i):
        return f"{self.region[i]}: cos_theta, eta, k = {self.inputs[:, i].tolist()}"


@pytest.fixture(scope="module")
def all_cases(reference):
    with open(reference / "hard_cases.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))

    def column(name):
        return np.array([float(row[name] or "nan") for row in rows])

    inputs = np.array([[float.fromhex(row[f"{name}_hex"]) for row in rows] for name in INPUTS])
    cases = Cases(
        np.array([f"{row['precision']} {row['region']}" for row in rows]),
        inputs,
        {name: column(name) for name in QUANTITIES},
        {name: column(f"dR_d{name}") for name in ("cos", "eta", "k")},
    )
    assert len(rows) == 1182
    return cases


def cases_for(all_cases, dtype):
    if dtype == "float64":
        return all_cases
    single = np.char.startswith(all_cases.region, "f32")
    cases = all_cases.where(single)
    np.testing.assert_array_equal(cases.inputs, cases.inputs.astype(np.float32))
    assert len(cases.region) == 1063
    return cases


def evaluate(arguments, precision):
    values = dict(
        zip(
            ("R_s", "R_p", "T_s", "T_p"),
            reflectance_components(*arguments, precision=precision),
            strict=True,
        )
    )
    values["R"] = conductor(*arguments, precision=precision)
    values["T"] = transmittance(*arguments, precision=precision)
    return values


def normal(values, dtype):
    """Neither denormal nor out of range: what Dr.Jit's worker threads can represent."""
    magnitude, limits = np.abs(values), np.finfo(dtype)
    return (magnitude == 0.0) | ((magnitude >= limits.tiny) & (magnitude <= limits.max))


PRECISIONS = [("float32", "wide"), ("float32", "native"), ("float64", "wide")]


def check_values(cases, values, dtype, precision, mask):
    for name, value in values.items():
        assert value.dtype == dtype
        assert np.isfinite(value).all()
        assert ((value >= 0.0) & (value <= 1.0)).all()
        exact = cases.values[name]
        error = np.where(mask(exact), ulps(value, exact), 0.0)
        if (dtype, precision) == ("float32", "wide"):
            limit = WIDE_ULP
        elif name == "R_p":
            limit = NATIVE_P_ULP
            error[exact <= NATIVE_P_FLOOR] = 0.0
            absolute = np.abs(value - exact)[exact <= NATIVE_P_FLOOR]
            assert absolute.max() <= 1e-14
        else:
            limit = NATIVE_ULP
        worst = int(np.argmax(error))
        assert error[worst] <= limit, f"{name} {error[worst]:.2f} ulp at {cases.at(worst)}"
    for R, T in (("R", "T"), ("R_s", "T_s"), ("R_p", "T_p")):
        total = values[R].astype(np.longdouble) + values[T]
        assert np.abs(total - 1.0).max() <= np.finfo(dtype).eps


@pytest.mark.parametrize(("dtype", "precision"), PRECISIONS)
def test_values_in_numpy(all_cases, dtype, precision):
    cases = cases_for(all_cases, dtype)
    values = evaluate(cases.inputs.astype(dtype), precision)
    check_values(cases, values, dtype, precision, lambda exact: np.isfinite(exact))


def test_values_as_python_floats(all_cases):
    arrays = evaluate(all_cases.inputs, "wide")
    for i in range(0, len(all_cases.region), 7):
        scalars = evaluate(all_cases.inputs[:, i].tolist(), "wide")
        for name, value in scalars.items():
            assert type(value) is float
            assert value == arrays[name][i]


@pytest.mark.parametrize(("dtype", "precision"), PRECISIONS)
@pytest.mark.parametrize("backend", BACKENDS)
def test_values_in_drjit(all_cases, backend, dtype, precision):
    Float = float_type(backend, dtype)
    cases = cases_for(all_cases, dtype)
    cases = cases.where(normal(cases.inputs, dtype).all(axis=0))
    arguments = [Float(row.astype(dtype)) for row in cases.inputs]
    if backend != "scalar":
        import drjit as dr

        dr.make_opaque(arguments)
    values = {name: np.array(value) for name, value in evaluate(arguments, precision).items()}
    check_values(cases, values, dtype, precision, lambda exact: normal(exact, dtype))


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients(all_cases, backend, dtype, mode):
    import drjit as dr

    Float = float_type(backend, dtype)
    cases = cases_for(all_cases, dtype)
    cases = cases.where(normal(cases.inputs, dtype).all(axis=0))
    for i, (name, exact) in enumerate(cases.gradients.items()):
        arguments = [Float(row.astype(dtype)) for row in cases.inputs]
        dr.make_opaque(arguments)
        dr.enable_grad(arguments[i])
        R = conductor(*arguments)
        T = transmittance(*arguments)
        if mode == "forward":
            dr.forward(arguments[i])
            of_R, of_T = np.array(dr.grad(R)), np.array(dr.grad(T))
        else:
            dr.backward(R)
            of_R = np.array(dr.grad(arguments[i]))
            dr.set_grad(arguments[i], 0.0)
            dr.backward(T)
            of_T = np.array(dr.grad(arguments[i]))
        np.testing.assert_array_equal(of_T, -of_R)
        beyond = np.abs(exact) > np.finfo(dtype).max
        assert np.isfinite(of_R[~beyond]).all()
        compared = normal(exact, dtype) & np.isfinite(exact)
        assert compared.sum() > 0.9 * len(exact)
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.abs(of_R - exact) / np.maximum(np.abs(exact), np.finfo(dtype).tiny)
        error = np.where(compared, error, 0.0)
        worst = int(np.argmax(error))
        assert error[worst] <= GRADIENT[dtype], f"dR/d{name} {error[worst]:.2g}, {cases.at(worst)}"


# --- every model -----------------------------------------------------------------------------

# exact in float32, so that an error is the model's own
MATERIALS = {
    "glass": (1.5, 0.0),
    "gold": (0.1875, 3.375),
    "nearly matched": (1.0 + 2.0**-13, 0.0),
    "weakly absorbing": (1.5, 2.0**-27),
    "nearly a mirror": (1.5, 500.0),
    "low index": (0.3125, 0.875),
    "high index": (4.0, 1.0),
}
COSINES = [1.0, 1.0 - 2.0**-20, 0.5, 1.0 / 7.0, 1e-3, 1e-7, 0.0]
INNER_COSINES = [0.9, 0.5, 0.13, 0.03]


def decomposed(*coefficients):
    """The decomposition from one array per coefficient."""
    if all(isinstance(c, float | np.ndarray) for c in coefficients):
        return Decomposition(np.stack(coefficients, axis=-1), load_basis())
    return Decomposition(coefficients, load_basis())


def parameters(kind, eta, k):
    """How to make a model, and the floats it is stored as."""
    if kind == "decomposition":
        return decomposed, load_basis().coefficients(eta, k).tolist()
    model, names = {
        "exact": (Exact, ("eta", "k")),
        "schlick": (Schlick, ("f0",)),
        "lazanyi": (Lazanyi, ("f0", "a", "exponent")),
        "f82": (F82, ("f0", "f82")),
        "gulbrandsen": (Gulbrandsen, ("r", "g")),
    }[kind]
    fitted = model.from_ior(eta, k)
    return model, [float(getattr(fitted, name)) for name in names]


MODEL_ERROR = {
    "exact": 0.0,
    "schlick": 0.35,
    "lazanyi": 0.1,
    "f82": 0.15,
    "gulbrandsen": 0.0,
    "decomposition": 0.05,
}
KINDS = list(MODEL_ERROR)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", ["numpy", *BACKENDS])
def test_every_model_at_its_limits(backend, dtype, kind, material):
    make, values = parameters(kind, *MATERIALS[material])
    cos_theta = np.array(COSINES, dtype)
    if backend == "numpy":
        F = np.asarray(make(*values)(cos_theta))
    else:
        Float = float_type(backend, dtype)
        F = np.array(make(*(Float(v) for v in values))(Float(cos_theta)))
    assert np.isfinite(F).all()
    # three roundings of numbers up to 1; r = F0 near 1 is where (r, g) loses digits
    eps = float(np.finfo(F.dtype).eps)
    f0 = float(conductor(1.0, *MATERIALS[material]))
    assert F[0] == pytest.approx(f0, abs=4.0 * eps + 1e-12)
    assert F[-1] == pytest.approx(1.0, abs=4.0 * eps + 1e-12)
    # what each model is off by is measured elsewhere; here nothing may be wild
    exact = conductor(np.array(COSINES), *MATERIALS[material])
    limit = MODEL_ERROR[kind]
    if material == "nearly matched" and kind not in ("exact", "gulbrandsen"):
        # R is steep below cos = .1, where no model follows it
        assert np.abs(F - exact)[exact < 0.01].max() <= 0.5
        limit = 1.0
    elif material == "low index" and kind == "gulbrandsen":
        limit = 0.15  # |m| < 1 has no (r, g): g = 1 is the nearest
    elif material == "nearly matched" and kind == "gulbrandsen":
        limit = 1e3 * eps  # r = 3.7e-9 gives eta, whose type leaves that many digits to eta - 1
    elif material == "nearly a mirror" and kind == "gulbrandsen":
        limit = 1e4 * eps  # r = .999976 leaves that many of its digits to 1 - r
    assert np.abs(F - exact).max() <= limit + 10.0 * eps + 1e-9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_every_model_has_right_gradients(backend, kind):
    import drjit as dr

    Float = float_type(backend, "float64")
    for eta, k in MATERIALS.values():
        make, values = parameters(kind, eta, k)
        cos_theta = np.array(INNER_COSINES)
        arguments = [cos_theta, *(np.full(cos_theta.shape, value) for value in values)]

        def reflectance(*arguments, make=make):
            return make(*arguments[1:])(arguments[0])

        for i, argument in enumerate(arguments):
            if kind == "exact" and argument[0] == 0.0:
                continue  # k = 0, one-sided: the table above has it
            if kind == "gulbrandsen" and not 1e-9 < argument[0] < 1.0:
                continue  # g at its ends, one-sided: see test_models

            def along(x, i=i, arguments=arguments, reflectance=reflectance):
                return reflectance(*arguments[:i], x, *arguments[i + 1 :])

            if kind == "gulbrandsen":
                step = 1e-4 * np.minimum(argument, 1.0 - argument)
            else:
                step = np.where(np.abs(argument) < 1e-3, 0.2, 1e-6) * np.abs(argument)
            step = np.where(step == 0.0, 1e-6, step)
            expected = central_difference(along, argument, step)
            found = []
            for mode in ("forward", "backward"):
                jit = [Float(a) for a in arguments]
                dr.enable_grad(jit[i])
                F = reflectance(*jit)
                if mode == "forward":
                    dr.forward(jit[i])
                    found.append(np.array(dr.grad(F)))
                else:
                    dr.backward(F)
                    found.append(np.array(dr.grad(jit[i])))
            np.testing.assert_allclose(found[0], found[1], rtol=1e-7, atol=1e-300)
            scale = np.abs(expected).max()
            noise = 4.0 * np.finfo(np.float64).eps / step.min()  # of the difference quotient
            np.testing.assert_allclose(
                found[0], expected, rtol=1e-5, atol=3e-7 * scale + 1e-8 + noise
            )
