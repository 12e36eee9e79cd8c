"""How many floating-point operations a kernel has, counted in what Dr.Jit compiles."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi

from .._check import input_error

__all__ = ["count_gathers", "count_operations", "count_vector_operations"]

_LLVM = re.compile(
    r"= (?:call (?:fast )?<.*?@llvm\.(?!masked)(?P<call>[a-z]+)[\w.]*\.v\d+f\d+"
    r"|(?P<plain>f(?:add|sub|mul|div|neg))\b)"
)
_PTX = re.compile(
    r"^\s*(?P<plain>add|sub|mul|div|fma|sqrt|rsqrt|rcp|min|max|neg|abs)\.(?:\w+\.)*f\d+"
)
_VECTOR = re.compile(
    r"= (?:call (?:fast )?<.*?@llvm\.(?P<call>[a-z]+)"
    r"|(?P<plain>f(?:add|sub|mul|div|neg|cmp|pext|ptrunc|ptosi|ptoui)|[su]itofp|icmp|select"
    r"|and|or|xor|add|sub|mul|shl|lshr|ashr|sext|zext|trunc)\b[^,]*<\d+ x )"
)
_BITS = {"double": 64, "float": 32, "half": 16}


def count_operations(function: Callable[..., Any], *arguments: float) -> Counter[str]:
    """Arithmetic operations of `function` in the active variant, by their names in its kernel.

    Loads, stores, selections, comparisons and conversions are not counted; a fused multiply-add
    counts as one. In LLVM variants one operation works on a whole packet of numbers.

    Parameters
    ----------
    function : callable
        Of Dr.Jit arrays; what it returns is evaluated.
    arguments : float
        Each becomes an array `mi.Float` that the kernel reads from memory.

    Raises
    ------
    InputError
        In scalar variants, which have no kernels.

    Examples
    --------
    >>> import mitsuba as mi
    >>> from fresnel_decomp.mitsuba.operations import count_operations
    >>> mi.set_variant("llvm_ad_rgb")
    >>> count_operations(lambda x: (x + 1.0) / x, 0.5).total()
    2
    """
    if not dr.is_jit_v(mi.Float):
        raise input_error(
            f"variant {mi.variant()}", "an llvm_ad or cuda_ad variant", "Scalar code has no kernel."
        )
    pattern = _LLVM if str(mi.variant()).startswith("llvm") else _PTX
    matches = map(pattern.search, _lines(function, arguments))
    return Counter(next(filter(None, match.groups())) for match in matches if match)


def count_vector_operations(
    function: Callable[..., Any], *arguments: float
) -> Counter[tuple[str, int]]:
    """All operations on packets of numbers in the kernel of `function`, LLVM variants only.

    Beyond `count_operations`, that is comparisons, selections, conversions and those on masks and
    integers; neither loads, stores and constants nor reinterpretations, which are no instructions.

    Parameters
    ----------
    function, arguments
        As for `count_operations`.

    Returns
    -------
    Counts by name and by bits of the widest number that takes part (1: masks alone). A packet of
    float64 fills twice as many registers as one of float32.

    Raises
    ------
    InputError
        In other variants.

    Examples
    --------
    >>> import drjit as dr
    >>> import mitsuba as mi
    >>> from fresnel_decomp.mitsuba.operations import count_vector_operations
    >>> mi.set_variant("llvm_ad_rgb")
    >>> def doubled(x):
    ...     return dr.select(x > 0.0, 2.0 * mi.Float64(x), 1.0)
    >>> sorted(count_vector_operations(doubled, 0.5).items())
    [(('fcmp', 32), 1), (('fmul', 64), 1), (('fpext', 64), 1), (('select', 64), 1)]
    """
    _llvm_only()
    found: Counter[tuple[str, int]] = Counter()
    for line in _lines(function, arguments):
        match = _VECTOR.search(line)
        if match and match["call"] != "masked":  # a load
            kinds = re.findall(r"<\d+ x (\w+)>", line)
            bits = max(_BITS.get(kind) or int(kind.removeprefix("i")) for kind in kinds)
            found[next(filter(None, match.groups())), bits] += 1
    return found


def count_gathers(function: Callable[..., Any], *arguments: float) -> int:
    """Loads from places that differ within a packet, LLVM variants only: a table's.

    Parameters, errors: as for `count_vector_operations`.

    Examples
    --------
    >>> import mitsuba as mi
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.mitsuba.operations import count_gathers
    >>> mi.set_variant("llvm_ad_rgb")
    >>> count_gathers(load_basis().table(64), 0.5)  # three functions between two samples
    6
    """
    _llvm_only()
    return sum(
        "= call" in line and "@llvm.masked.gather" in line for line in _lines(function, arguments)
    )


def _llvm_only() -> None:
    if not str(mi.variant()).startswith("llvm"):
        raise input_error(
            f"variant {mi.variant()}", "an llvm_ad variant", "Choose one with mi.set_variant."
        )


def _lines(function: Callable[..., Any], arguments: tuple[float, ...]) -> list[str]:
    """The text of all kernels that evaluate `function`."""
    inputs = [dr.opaque(mi.Float, value, 64) for value in arguments]
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        # the first time also makes what the function keeps, such as a table
        dr.eval(inputs, function(*inputs))
        dr.kernel_history_clear()
        dr.eval(function(*inputs))
        kernels = dr.kernel_history([dr.KernelType.JIT])
    return [line for kernel in kernels for line in kernel["ir"].getvalue().splitlines()]
