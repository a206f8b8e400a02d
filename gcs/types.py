"""Types of arrays and JSON values, which every layer uses."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # of any shape; each use states it
JsonObject = dict[str, Any]  # what json.dumps writes as an object, or json.loads made of one
