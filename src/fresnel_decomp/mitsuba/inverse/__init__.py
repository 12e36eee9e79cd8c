"""Inverse rendering: what a metal is made of, from images of it under known light.

`recover` has three routes. "linear" renders the basis and solves constrained least squares;
"gradient" descends with Mitsuba's `prb` integrator; "hybrid" solves linearly inside a search for
what images are not linear in. All of them say how sure they are of each number. `recover_texture`
does the linear solve for a conductor that varies over its surface.
"""

from .gradient import NonFiniteGradientError
from .recovery import ROUTES, recover
from .result import Recovered, Step, curve
from .texture import RecoveredTexture, recover_texture

__all__ = [
    "ROUTES",
    "NonFiniteGradientError",
    "Recovered",
    "RecoveredTexture",
    "Step",
    "curve",
    "recover",
    "recover_texture",
]
