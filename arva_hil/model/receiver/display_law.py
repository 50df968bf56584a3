"""The measured law of a display: d over the field."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass


@dataclass(frozen=True)
class DisplayLaw:
    """A table of fields, which rise, and of the d that the display shows at each, which falls.

    `source`: the file. `field_na_m`: at the antennas that count [nA/m]. `d_m`: metres.
    """

    source: str
    field_na_m: tuple[float, ...]
    d_m: tuple[float, ...]

    def d(self, field_na_m: float) -> float:
        """Return d [m] at a field, linear in the logarithms; beyond the table it is that of the table's end."""
        after = bisect_right(self.field_na_m, field_na_m)
        if after == 0:
            return self.d_m[0]
        if after == len(self.d_m):
            return self.d_m[-1]
        low, high = self.field_na_m[after - 1], self.field_na_m[after]
        share = math.log(field_na_m / low) / math.log(high / low)
        return self.d_m[after - 1] * math.exp(share * math.log(self.d_m[after] / self.d_m[after - 1]))
