"""Taylor models: a polynomial of scaled time plus a remainder, which together enclose a quantity over a whole interval.

f(m + r s) lies within `remainder` of c_0 + c_1 s + ... + c_K s^K for every s in [-1, 1]. Sums, products and smooth
functions of enclosed quantities are enclosed again (K. Makino and M. Berz, Taylor models, 2003). So a bound of the
result is a bound at every instant, not only at the sampled ones.

Arithmetic rounds at about 1e-16 of a value. `ROUNDING` covers thousands of such errors in every bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, reduce

import numpy as np

from gcs.types import Array

ROUNDING = 1e-11  # share of the terms' sizes


class Taylor:
    """Taylor models of many quantities at once: coefficients (K+1, ...) and remainders (...) >= 0."""

    c: Array
    remainder: Array

    __array_ufunc__ = None  # so that array * Taylor comes here

    def __init__(self, coefficients: Array, remainder: Array) -> None:
        self.c = coefficients
        self.remainder = remainder

    @property
    def order(self) -> int:
        """The highest power K."""
        return len(self.c) - 1

    @property
    def middle(self) -> Array:
        """The polynomial (...) in the middle of the interval; the quantity itself where the remainder is 0."""
        return np.asarray(self.c[0])

    def __getitem__(self, index: object) -> Taylor:
        """A part of the quantities, by an index into their shape."""
        chosen = index if isinstance(index, tuple) else (index,)
        return Taylor(self.c[(slice(None), *chosen)], self.remainder[chosen])

    def deviation(self) -> Array:
        """The largest distance (...) from the middle value over the interval."""
        return np.asarray(np.abs(self.c[1:]).sum(axis=0) + self.remainder)

    def range(self) -> tuple[Array, Array]:
        """The least and the largest value (...) over the interval: the parabola exactly, the rest by its size."""
        c0, c1 = self.c[0], self.c[1]
        c2 = self.c[2] if self.order > 1 else np.zeros_like(c0)
        rest = np.abs(self.c[3:]).sum(axis=0) + self.remainder
        rest = rest + ROUNDING * (np.abs(c0) + np.abs(c1) + np.abs(c2) + rest)
        ends = np.abs(c1)
        inside = ends < 2.0 * np.abs(c2)  # the vertex is within the interval
        vertex = np.where(inside, -(c1 * c1) / (4.0 * np.where(inside, c2, 1.0)), 0.0)
        low = c0 + np.where(inside & (c2 > 0.0), vertex, c2 - ends)
        high = c0 + np.where(inside & (c2 < 0.0), vertex, c2 + ends)
        return np.asarray(low - rest), np.asarray(high + rest)

    def low(self) -> Array:
        """The least value (...) over the interval."""
        return self.range()[0]

    def size(self) -> Array:
        """The largest absolute value (...) over the interval."""
        low, high = self.range()
        return np.maximum(-low, high)

    def __neg__(self) -> Taylor:
        return Taylor(-self.c, self.remainder)

    def __add__(self, other: Taylor | Array | float) -> Taylor:
        if isinstance(other, Taylor):
            return Taylor(self.c + other.c, self.remainder + other.remainder)
        c = np.array(np.broadcast_arrays(self.c, np.asarray(other)[None] + 0.0 * self.c)[0])
        c[0] = c[0] + other
        return Taylor(c, self.remainder + np.zeros(c.shape[1:]))

    __radd__ = __add__

    def __sub__(self, other: Taylor | Array | float) -> Taylor:
        return self + (-other)

    def __rsub__(self, other: Array | float) -> Taylor:
        return (-self) + other

    def __mul__(self, other: Taylor | Array | float) -> Taylor:
        if not isinstance(other, Taylor):
            return Taylor(self.c * other, self.remainder * np.abs(other))
        a, b, top = self.c, other.c, self.order
        c = np.empty(np.broadcast_shapes(a.shape, b.shape))
        for n in range(top + 1):
            c[n] = a[0] * b[n]
            for i in range(1, n + 1):
                c[n] += a[i] * b[n - i]
        size_a, size_b = np.abs(a), np.abs(b)
        # Powers above K: what is left of the whole product of sizes.
        tail = np.zeros(c.shape[1:])
        above = size_b[top]
        for i in range(1, top + 1):
            tail = tail + size_a[i] * above
            if i < top:
                above = above + size_b[top - i]
        if np.any(self.remainder) or np.any(other.remainder):
            whole_a, whole_b = size_a.sum(axis=0), size_b.sum(axis=0)
            tail = tail + self.remainder * (whole_b + other.remainder) + other.remainder * whole_a
        return Taylor(c, tail)

    __rmul__ = __mul__

    def square(self) -> Taylor:
        """The square (...)."""
        return self * self

    def __truediv__(self, other: Taylor | Array | float) -> Taylor:
        if isinstance(other, Taylor):
            return self * other.reciprocal()
        return self * (1.0 / np.asarray(other))

    def __rtruediv__(self, other: Array | float) -> Taylor:
        return self.reciprocal() * other

    @cached_property
    def _powers(self) -> list[Taylor]:
        """The powers 1 .. K of the difference from the middle value."""
        c = self.c.copy()
        c[0] = 0.0
        found = [Taylor(c, self.remainder)]
        while len(found) < self.order:
            found.append(found[-1] * found[0])
        return found

    def _composed(self, derivatives: Sequence[Array], highest: Array) -> Taylor:
        """A function of this: its derivatives at the middle value up to the K-th, and a bound of the next one."""
        top = self.order + 1
        c = np.zeros_like(self.c)
        remainder = highest * self.deviation() ** top / math.factorial(top)
        for n, power in enumerate(self._powers, start=1):
            factor = derivatives[n] / math.factorial(n)
            c[1:] += factor * power.c[1:]
            remainder = remainder + np.abs(factor) * power.remainder
        c[0] = derivatives[0]
        return Taylor(c, remainder)

    def sin(self) -> Taylor:
        """The sine (...)."""
        s, c = np.sin(self.c[0]), np.cos(self.c[0])
        turns = (s, c, -s, -c)
        return self._composed([turns[n % 4] for n in range(self.order + 1)], np.ones_like(s))

    def cos(self) -> Taylor:
        """The cosine (...)."""
        s, c = np.sin(self.c[0]), np.cos(self.c[0])
        turns = (c, -s, -c, s)
        return self._composed([turns[n % 4] for n in range(self.order + 1)], np.ones_like(s))

    def exp(self) -> Taylor:
        """The exponential (...)."""
        value = np.exp(self.c[0])
        return self._composed([value] * (self.order + 1), value * np.exp(self.deviation()))

    def power(self, exponent: float) -> Taylor:
        """A power (...) of a quantity above 0; infinitely wide where it cannot be shown to be above 0."""
        low = self.c[0] - self.deviation()
        positive = low > 0.0
        base, least = np.where(self.c[0] > 0.0, self.c[0], 1.0), np.where(positive, low, 1.0)
        factor, derivatives = 1.0, []
        for n in range(self.order + 1):
            derivatives.append(factor * base ** (exponent - n))
            factor *= exponent - n
        highest = np.abs(factor) * least ** (exponent - self.order - 1)
        result = self._composed(derivatives, np.asarray(highest))
        result.remainder = np.where(positive, result.remainder, np.inf)
        return result

    def __pow__(self, exponent: float) -> Taylor:
        return self.power(exponent)

    def sqrt(self) -> Taylor:
        """The square root (...) of a quantity above 0."""
        return self.power(0.5)

    def reciprocal(self) -> Taylor:
        """One over a quantity (...) that does not change its sign."""
        sign = np.where(self.c[0] < 0.0, -1.0, 1.0)
        return (self * sign).power(-1.0) * sign

    def atan(self) -> Taylor:
        """The arc tangent (...) of a quantity near 0, as `arctan2` makes it."""
        x = self.c[0]
        # The n-th derivative is (n-1)! cos^n(y) sin(n (y + pi/2)) with y = atan(x): nowhere above (n-1)!.
        y = np.arctan(x)
        derivatives = [y]
        for n in range(1, self.order + 1):
            derivatives.append(math.factorial(n - 1) * np.cos(y) ** n * np.sin(n * (y + 0.5 * np.pi)))
        return self._composed(derivatives, np.full_like(x, float(math.factorial(self.order))))


def arctan2(y: Taylor, x: Taylor) -> Taylor:
    """The angle of (x, y), rad, relative to its direction at the middle of the interval: it does not jump.

    Infinitely wide where a turn of 90 degrees cannot be excluded.
    """
    middle = np.arctan2(y.c[0], x.c[0])
    c, s = np.cos(middle), np.sin(middle)
    across: Taylor = y * c - x * s
    ahead: Taylor = x * c + y * s
    seen: Taylor = across / ahead
    angle: Taylor = seen.atan() + middle
    return angle


def stacked(parts: Sequence[Taylor]) -> Taylor:
    """Several quantities of one shape (...) as one (n, ...)."""
    return Taylor(np.stack([p.c for p in parts], axis=1), np.stack([p.remainder for p in parts]))


def total(parts: Sequence[Taylor]) -> Taylor:
    """The sum of quantities (...)."""
    found: Taylor = reduce(Taylor.__add__, parts)
    return found


def constant(value: Array, order: int) -> Taylor:
    """A quantity (...) that does not change."""
    c = np.zeros((order + 1, *np.shape(value)))
    c[0] = value
    return Taylor(c, np.zeros(np.shape(value)))


class _Functions:
    """The functions that the equations of `gcs.physics` need, as their argument `xp`."""

    @staticmethod
    def sin(x: Taylor) -> Taylor:
        return x.sin()

    @staticmethod
    def cos(x: Taylor) -> Taylor:
        return x.cos()

    @staticmethod
    def sqrt(x: Taylor) -> Taylor:
        return x.sqrt()

    @staticmethod
    def arctan2(y: Taylor, x: Taylor) -> Taylor:
        return arctan2(y, x)


FUNCTIONS = _Functions()
