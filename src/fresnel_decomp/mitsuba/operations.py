"""How many floating-point operations a kernel has, counted in what Dr.Jit compiles."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi

from .._check import input_error

__all__ = ["count_operations"]

_LLVM = re.compile(
    r"= (?:call (?:fast )?<.*?@llvm\.(?P<call>[a-z]+)[\w.]*\.v\d+f\d+"
    r"|(?P<plain>f(?:add|sub|mul|div|neg))\b)"
)
_PTX = re.compile(
    r"^\s*(?P<plain>add|sub|mul|div|fma|sqrt|rsqrt|rcp|min|max|neg|abs)\.(?:\w+\.)*f\d+"
)


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
    inputs = [dr.opaque(mi.Float, value, 64) for value in arguments]
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.eval(inputs)
        dr.kernel_history_clear()
        dr.eval(function(*inputs))
        kernels = dr.kernel_history([dr.KernelType.JIT])
    pattern = _LLVM if str(mi.variant()).startswith("llvm") else _PTX
    found: Counter[str] = Counter()
    for kernel in kernels:
        for line in kernel["ir"].getvalue().splitlines():
            match = pattern.search(line)
            if match:
                found[next(filter(None, match.groups()))] += 1
    return found
