"""Boxes around all returns that begin in a span of instants, at all times of a span since they began.

The motion is that of `gcs.mission.returns.routed_motion`: brake, climb, follow the way, descend. Its knots are computed
with spans in place of numbers, from the brakes' Taylor models and from ways whose corners are known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.mission.proving.break_off import Braking
from gcs.mission.proving.number_span import NumberSpan, spanned
from gcs.mission.returns.routed_motion import ACCEL_MPS2, CORNER_M
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.plan.verification.proof.subdivision import Rows
from gcs.types import Array

_CHORD = 1.42  # a chord of an angle below 90 degrees, as a share of its sine, at most
_TINY = 1e-12
_DOWN = 2


@dataclass(frozen=True, eq=False)
class Rest:
    """From rest to rest over a length (F,): as fast as `ACCEL_MPS2` and the top speed allow."""

    length: NumberSpan
    top_mps: float

    @property
    def duration_s(self) -> NumberSpan:
        """How long (F,) it takes."""
        return NumberSpan(*(_duration_s(each, self.top_mps) for each in (self.length.low, self.length.high)))

    def left_m(self, after_s: NumberSpan) -> NumberSpan:
        """What is left (F,) of the length so long after the begin: less the later, and the shorter it is."""
        return NumberSpan(
            _left_m(after_s.high, self.length.low, self.top_mps), _left_m(after_s.low, self.length.high, self.top_mps)
        )


def _duration_s(length_m: Array, top_mps: float) -> Array:
    is_long = length_m >= top_mps**2 / ACCEL_MPS2
    return np.where(is_long, length_m / top_mps + top_mps / ACCEL_MPS2, 2.0 * np.sqrt(length_m / ACCEL_MPS2))


def _left_m(after_s: Array, length_m: Array, top_mps: float) -> Array:
    peak = np.minimum(top_mps, np.sqrt(ACCEL_MPS2 * length_m))
    faster_s, whole_s = peak / ACCEL_MPS2, _duration_s(length_m, top_mps)
    left_s = np.maximum(whole_s - after_s, 0.0)
    begun = length_m - 0.5 * ACCEL_MPS2 * np.maximum(after_s, 0.0) ** 2
    even = length_m - 0.5 * peak * faster_s - peak * (after_s - faster_s)
    ended = 0.5 * ACCEL_MPS2 * left_s**2
    return np.asarray(np.where(after_s <= faster_s, begun, np.where(left_s >= faster_s, even, ended)))


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces (F, P) of the flight along ways (F): each of constant acceleration, from a time since the ways' begin."""

    begin_s: NumberSpan  # (F, P)
    lasts_s: NumberSpan
    place: NumberSpan  # (F, P, 2) at its begin
    velocity: NumberSpan
    acceleration: NumberSpan
    whole_s: NumberSpan  # (F,)
    end: Array  # (F, 2)

    def places(self, option: Rows, after_s: NumberSpan, cruise_mps: float) -> NumberSpan:
        """Boxes (R, 2) of options (R,) at all times (R,) since the ways' begin."""
        begin, lasts = self.begin_s[option], self.lasts_s[option]
        low_s, high_s = after_s.low[:, None], after_s.high[:, None]
        inside = (high_s >= begin.low) & (low_s <= begin.high + lasts.high)
        since = NumberSpan(np.clip(low_s - begin.high, 0.0, lasts.high), np.clip(high_s - begin.low, 0.0, lasts.high))
        half = 0.5 * (since * since)
        run = self.velocity[option] * since[..., None] + self.acceleration[option] * half[..., None]
        box = self.place[option] + run
        low = np.where(inside[..., None], box.low, np.inf).min(axis=1)
        high = np.where(inside[..., None], box.high, -np.inf).max(axis=1)
        end = self.end[option]
        arrived = (after_s.high >= self.whole_s.low[option])[:, None]
        low, high = np.where(arrived, np.minimum(low, end), low), np.where(arrived, np.maximum(high, end), high)
        # The end is as near as it can be braked for.
        left_s = np.maximum(self.whole_s.high[option] - after_s.low, 0.0)[:, None]
        left_m = np.minimum(0.5 * ACCEL_MPS2 * left_s**2, cruise_mps * left_s)
        return NumberSpan(np.maximum(low, end - left_m), np.minimum(high, end + left_m))


def pieces_of(points: Array, reach_m: Array, cruise_mps: float) -> Pieces:
    """The pieces of ways (F, W, 2) whose first points may be anywhere within a reach (F,), as `_follow` makes them."""
    legs = np.diff(points, axis=1)
    lengths = np.linalg.norm(legs, axis=2)
    unit = legs / np.maximum(lengths, _TINY)[..., None]
    turned = np.where(reach_m < 0.9 * lengths[:, 0], _CHORD * reach_m / np.maximum(lengths[:, 0] - reach_m, _TINY), 2.0)
    count = legs.shape[1]
    length = [spanned(lengths[:, leg], reach_m if leg == 0 else 0.0).most(0.0) for leg in range(count)]
    along = [spanned(unit[:, leg], np.minimum(turned, 2.0)[:, None] if leg == 0 else 0.0) for leg in range(count)]
    none = np.zeros(len(points))
    cut, speed = [NumberSpan(none, none)], [NumberSpan(none, none)]
    for leg in range(count - 1):
        half = 0.5 * np.linalg.norm(unit[:, leg + 1] - unit[:, leg], axis=1)
        turn = spanned(half, 0.5 * turned if leg == 0 else 0.0).most(1e-9).least(1.0)
        shorter = length[leg].least(length[leg + 1])
        around = (2.0 * CORNER_M / turn).least(0.5 * shorter).least(cruise_mps**2 / ACCEL_MPS2 * turn)
        cut.append(around)
        speed.append((ACCEL_MPS2 * around / turn).root().least(cruise_mps))
    cut.append(NumberSpan(none, none))
    speed.append(NumberSpan(none, none))
    straight = [(length[leg] - cut[leg] - cut[leg + 1]).most(0.0) for leg in range(count)]
    for leg in range(count):
        speed[leg + 1] = speed[leg + 1].least((speed[leg] * speed[leg] + 2.0 * ACCEL_MPS2 * straight[leg]).root())
    for leg in reversed(range(count)):
        speed[leg] = speed[leg].least((speed[leg + 1] * speed[leg + 1] + 2.0 * ACCEL_MPS2 * straight[leg]).root())
    begin, found = NumberSpan(none, none), []
    for leg in range(count):
        corner = spanned(points[:, leg], reach_m[:, None] if leg == 0 else 0.0)
        first, last, ahead = speed[leg], speed[leg + 1], along[leg]
        peak, (faster_s, even_s, slower_s) = _straight(straight[leg], first, last, cruise_mps)
        start = corner + cut[leg][:, None] * ahead
        run = 0.5 * ((first + peak) * faster_s)
        stay = (run + peak * even_s).within(straight[leg] - 0.5 * ((peak + last) * slower_s))
        rate = ACCEL_MPS2 * ahead
        for lasts_s, place, velocity, acceleration in (
            (faster_s, start, first[:, None] * ahead, rate),
            (even_s, start + run[:, None] * ahead, peak[:, None] * ahead, 0.0 * rate),
            (slower_s, start + stay[:, None] * ahead, peak[:, None] * ahead, -1.0 * rate),
        ):
            found.append((begin, lasts_s, place, velocity, acceleration))
            begin = begin + lasts_s
        if leg + 1 < count:
            around, other = cut[leg + 1], along[leg + 1]
            lasts_s = 2.0 * around / last.most(_TINY)
            change = (other - ahead) * (last * last / (2.0 * around).most(_TINY))[:, None]
            place = spanned(points[:, leg + 1], 0.0) - around[:, None] * ahead
            found.append((begin, lasts_s, place, last[:, None] * ahead, change))
            begin = begin + lasts_s
    columns = [
        NumberSpan(np.stack([row[n].low for row in found], axis=1), np.stack([row[n].high for row in found], axis=1))
        for n in range(5)
    ]
    return Pieces(columns[0], columns[1], columns[2], columns[3], columns[4], begin, points[:, -1])


def _straight(
    length: NumberSpan, first: NumberSpan, last: NumberSpan, top_mps: float
) -> tuple[NumberSpan, tuple[NumberSpan, NumberSpan, NumberSpan]]:
    """The peak speed of a straight piece, and how long it is faster, even and slower; each changes in one sense."""

    def peak(length_m: Array, begin: Array, end: Array) -> Array:
        free = np.sqrt(ACCEL_MPS2 * length_m + 0.5 * (begin**2 + end**2))
        return np.asarray(np.maximum(np.minimum(top_mps, free), np.maximum(begin, end)))

    def even_s(length_m: Array, begin: Array, end: Array) -> Array:
        slow_m = (2.0 * top_mps**2 - begin**2 - end**2) / (2.0 * ACCEL_MPS2)
        return np.maximum(length_m - slow_m, 0.0) / top_mps

    low, high = (length.low, first.low, last.low), (length.high, first.high, last.high)
    faster_s = NumberSpan(
        (peak(length.low, first.high, last.low) - first.high) / ACCEL_MPS2,
        (peak(length.high, first.low, last.high) - first.low) / ACCEL_MPS2,
    )
    slower_s = NumberSpan(
        (peak(length.low, first.low, last.high) - last.high) / ACCEL_MPS2,
        (peak(length.high, first.high, last.low) - last.low) / ACCEL_MPS2,
    )
    return NumberSpan(peak(*low), peak(*high)), (
        faster_s.most(0.0),
        NumberSpan(even_s(*low), even_s(*high)),
        slower_s.most(0.0),
    )


@dataclass(frozen=True, eq=False)
class ReturnTubes:
    """Options (F,) of returns: their brakes, the heights between which they climb and descend, and their ways."""

    braking: Braking  # (F,)
    rest_s: NumberSpan
    climb: Rest
    top: NumberSpan  # NED down
    sink: Rest
    low: NumberSpan
    pieces: tuple[Pieces, ...]
    which: Rows  # (F,) the pieces of each option, and its number there
    number: Rows
    speeds: ReturnSpeeds

    @classmethod
    def of(
        cls, braking: Braking, ways: list[Array], top_down_m: Array, end_down_m: Array, speeds: ReturnSpeeds
    ) -> ReturnTubes:
        """Options with brakes (F,), ways of any numbers of points, return heights (F,) and heights of the ends (F,)."""
        stop = braking.share(np.ones(len(ways)), np.ones(len(ways)))
        deviation = stop.deviation()
        reach_m = np.hypot(deviation[0], deviation[1])
        height = NumberSpan(stop.middle[_DOWN] - deviation[_DOWN], stop.middle[_DOWN] + deviation[_DOWN])
        top = height.least(top_down_m)
        climb = Rest((height - spanned(top_down_m, 0.0)).most(0.0), speeds.climb_mps)
        low = top.most(end_down_m)
        sink = Rest((spanned(end_down_m, 0.0) - top).most(0.0), speeds.sink_mps)
        counts = np.array([len(way) for way in ways])
        which, number = np.zeros((2, len(ways)), dtype=np.intp)
        pieces: list[Pieces] = []
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts == count)
            which[rows], number[rows] = len(pieces), np.arange(len(rows))
            pieces.append(pieces_of(np.stack([ways[row] for row in rows]), reach_m[rows], speeds.cruise_mps))
        rest_s = NumberSpan(*braking.rest_s)
        return cls(braking, rest_s, climb, top, sink, low, tuple(pieces), which, number, speeds)

    @property
    def leaves_s(self) -> NumberSpan:
        """When (F,) the way begins."""
        return self.rest_s + self.climb.duration_s

    @property
    def sinks_s(self) -> NumberSpan:
        """When (F,) the descent begins."""
        return self.leaves_s + self._whole_s

    @property
    def ends_s(self) -> NumberSpan:
        """When (F,) the return has ended."""
        return self.sinks_s + self.sink.duration_s

    @property
    def _whole_s(self) -> NumberSpan:
        low, high = np.zeros((2, len(self.which)))
        for kind, pieces in enumerate(self.pieces):
            rows = np.flatnonzero(self.which == kind)
            low[rows], high[rows] = (each[self.number[rows]] for each in (pieces.whole_s.low, pieces.whole_s.high))
        return NumberSpan(low, high)

    def boxes(self, option: Rows, begin_s: Array, until_s: Array) -> NumberSpan:
        """Boxes (R, 3) of options (R,) at all times from `begin_s` to `until_s` (R,) after the breaking off."""
        braking = Braking(self.braking.place[:, option], self.braking.velocity[:, option], self.braking.brake_mps2)
        low, high = (bound.T for bound in braking.enclosed(begin_s, until_s).range())
        since = NumberSpan(begin_s, until_s)
        leaves, sinks, rest = self.leaves_s[option], self.sinks_s[option], self.rest_s[option]
        # Above its stop until it leaves, then on its way
        brakes, hovers = begin_s < rest.high, begin_s < leaves.high
        flies = until_s > leaves.low
        level = NumberSpan(
            np.where(hovers[:, None], low[:, :2], np.inf), np.where(hovers[:, None], high[:, :2], -np.inf)
        )
        for kind, pieces in enumerate(self.pieces):
            rows = np.flatnonzero(flies & (self.which[option] == kind))
            if len(rows):
                way = pieces.places(self.number[option[rows]], (since - leaves)[rows].most(0.0), self.speeds.cruise_mps)
                level.low[rows] = np.minimum(level.low[rows], way.low)
                level.high[rows] = np.maximum(level.high[rows], way.high)
        down = NumberSpan(np.where(brakes, low[:, _DOWN], np.inf), np.where(brakes, high[:, _DOWN], -np.inf))
        climb = Rest(self.climb.length[option], self.climb.top_mps)
        above = self.top[option] + climb.left_m((since - rest).most(0.0))
        sink = Rest(self.sink.length[option], self.sink.top_mps)
        below = self.low[option] - sink.left_m((since - sinks).most(0.0))
        for inside, span in (
            ((until_s > rest.low) & (begin_s < sinks.high), above),
            (until_s > sinks.low, below),
        ):
            down = NumberSpan(
                np.where(inside, np.minimum(down.low, span.low), down.low),
                np.where(inside, np.maximum(down.high, span.high), down.high),
            )
        return NumberSpan(
            np.concatenate([level.low, down.low[:, None]], axis=1),
            np.concatenate([level.high, down.high[:, None]], axis=1),
        )
