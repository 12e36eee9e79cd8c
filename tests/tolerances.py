"""Tolerances of the exact equations, by precision: the only place that states them."""

WIDE_ULP = 0.51
"""float32 in and out, float64 inside: correctly rounded."""

NATIVE_ULP = 10.0
"""R, R_s, T, T_s, T_p computed in the type of the input."""

NATIVE_P_ULP = 16.0
"""R_p in the type of the input, above `NATIVE_P_FLOOR`."""

NATIVE_P_FLOOR = 1e-12
"""Near Brewster's angle R_p is a squared difference: below this only absolute errors count."""

GRADIENT = {"float32": 1e-6, "float64": 1e-9}
"""Relative error of closed-form derivatives with precision="wide"; 1e-14 is typical in float64,
whose products are not computed wider."""
