"""Types of arrays and JSON values, which every layer uses."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # of any shape; each use states it
AnyArray = NDArray[Any]  # of a dtype that only its user knows
JsonObject = dict[str, Any]  # what json.dumps writes as an object, or json.loads made of one
Scalar = Any  # a component in an equation that is written once for arrays, CasADi symbols and Taylor models


class Maths(Protocol):
    """The functions of such equations, as their argument `xp`: NumPy, CasADi, or those of Taylor models."""

    def sin(self, x: Scalar, /) -> Scalar: ...  # noqa: D102
    def cos(self, x: Scalar, /) -> Scalar: ...  # noqa: D102
    def sqrt(self, x: Scalar, /) -> Scalar: ...  # noqa: D102
    def arctan2(self, y: Scalar, x: Scalar, /) -> Scalar: ...  # noqa: D102
