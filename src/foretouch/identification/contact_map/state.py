"""All that a contact map's learner remembers, in one record: each array that a call takes costs like a short step."""

from __future__ import annotations

from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core.records import Record
from foretouch.identification.contact_map.regression import Regression
from foretouch.identification.exact.kernel import Filter
from foretouch.models.contact_map.layout import EXPERTS, LARGEST_FEATURES, MEMORY, Map

Field = NDArray[Any]

LEVELS = 20  # Number of powers of two of a force whose outermost positions are kept
RING = 128  # Number of snapshots of the map that are kept to be scored on later samples

EARLY = 64  # Largest number of samples by which a map from before is placed

NOT_GIVEN, HELD, DROPPED = range(3)
"""State of a map from before: there is none; it is part of what is published; it was contradicted."""


class Stay(Record):
    """A stay out of contact, in which something may pull; positions are from the origin [m]."""

    place: float  # of the newest sample, in contact too
    force: float  # of that sample [N]
    left: float  # where contact was left
    pull: float  # largest so far [N], 0 once it was too far away
    held: float  # outermost position with half of that


class Present(Record):
    """Sums of squared errors before samples in contact are learnt [N^2 s]."""

    coarse: float  # of the coarse map, where the fine one has knots
    fine: float  # and of the fine one
    time: float  # over which these were summed [s]
    law: float  # of the law, fading
    law_time: float  # over which that was summed, fading [s]


class Wrong(Record):
    """Late predictions that have been wrong by far more than expected without a pause."""

    time: float  # for which they have, in contact [s]
    product: float  # sum of what was predicted times what was measured [N^2 s]
    square: float  # and of its square


class Notes(Record):
    """What is noted beside the map; a reset sets all to 0. Only 64-bit numbers, so that it is one flat array, too."""

    learnt_at: float  # time of the newest sample learnt from [s]
    peak: float  # largest force since the beginning or the last change [N]
    lowest: float  # least position since the beginning or the last change [m]
    contact: float  # time in contact since the beginning or the last change [s]
    scores: Annotated[Field, float, 2]  # sums of squared late errors of the law and of the maps, fading [N^2 s]
    scored: float  # time over which they were summed, fading [s]
    present: Present
    errors: float  # sum of absolute late errors, relative to the forces, fading [s]
    wrong: Wrong
    faded: float  # time in contact since the covariance faded last [s]
    snapshots: int  # taken so far
    snapped_at: float  # time of the newest snapshot [s]
    time: float  # of the newest sample [s], NaN before the first
    touch_unit: float  # a sixteenth of the first force in contact [N]
    outermost: Annotated[Field, float, LEVELS]  # position at which this force, twice it and so on were felt [m]
    stay: Stay
    entered: int  # 1 once no contact was seen, 2 once contact came after that
    touched: int  # 1 from the first contact on
    updates: int  # samples learnt from since the last reset
    begun: int  # value of `updates` when the map began


class Early(Record):
    """A sample from the time in which it is found where a map from before lies."""

    position: float  # from the origin [m]
    velocity: float  # [m/s]
    force: float  # less the offset [N]
    values: Annotated[Field, float, LARGEST_FEATURES]  # the features


class Remembered(Record):
    """A map of the same material from before, and what it adds to the one that is learnt."""

    state: int  # NOT_GIVEN, HELD or DROPPED
    given: Annotated[Field, Map, 1]  # as it came; its positions count from the surface
    placed: Annotated[Field, Map, 1]  # the same, moved to where the material was touched now
    shown: Annotated[Field, Map, 1]  # the map that is learnt and what is left of the one from before
    ring: Annotated[Field, Map, RING]  # that at each snapshot
    since: float  # time from which on it is part of what is published [s]
    count: int  # number of samples below
    first: Annotated[Field, Early, EARLY]  # the first ones in contact
    against: float  # cumulative sum of how much worse late predictions are with it than without [N^2 s]


class Bank(Record):
    """The map as it is learnt, its regressions, the law's estimator, and snapshots of the map."""

    map: Annotated[Field, Map, 1]
    memory: Annotated[Field, float, MEMORY]  # of the material
    notes: Annotated[Field, Notes, 1]
    horizon: float  # delay of the predictions that are scored [s]
    changes: int  # sudden changes since the last reset from outside
    values: Annotated[Field, float, LARGEST_FEATURES]  # scratch: the features
    law: Annotated[Field, Filter, 1]  # the exact estimator
    times: Annotated[Field, float, RING]  # of the snapshots [s], together for the search
    contacts: Annotated[Field, float, RING]  # their times in contact [s]
    ranges: Annotated[Field, float, (RING, 2)]  # least and largest position since the beginning or the last change [m]
    ring: Annotated[Field, Map, RING]  # the snapshots
    coarse: Regression
    fine: Regression
    absent: Annotated[Field, int, EXPERTS]  # 1 for the experts that are not used
    remembered: Remembered
