"""What a bank of experts remembers from sample to sample, by its place in one flat array.

All that one compiled call needs stands in one array: each array that a call takes costs as much as a short step.
"""

from __future__ import annotations

from foretouch.identification.contact_map.regression import regression_size
from foretouch.identification.exact.law import SETTINGS, STATE_SIZE
from foretouch.models.contact_map.layout import LARGEST_FEATURES, MEMORY, SIZE

# --- notes beside the map --------------------------------------------------------------------------------------------

LEARNT_AT = 0  # time of the newest sample learnt from [s]
PEAK = 1  # largest force since the beginning or the last change [N]
CONTACT = 2  # time in contact since then [s]
SCORES = 3  # sum of squared late errors of each expert, fading [N^2 s]
SCORED = 6  # time over which they were summed, fading [s]
ALARMS = 7  # mean squared errors at once of coarse and fine map [N^2]
MOMENTS = 9  # sums over late predictions, fading: products of what the doubt depends on, in pairs
TARGETS = 18  # and with the squared error
SPREAD = 21  # by how much the standard deviation from the moments is to be multiplied
FADED = 22  # time in contact since the covariance faded last [s]
SNAPSHOTS = 23  # taken so far
SNAPPED_AT = 24  # time of the newest [s]
ABSENT = 25  # for each expert 1 where it is not to be asked
PATIENCE = 28  # contact without a change before the next can be called [s]
IN_A_ROW = 29  # time for which no map explained the force [s]
BEFORE = 30  # force at the sample before [N]
HORIZON = 31  # how late a prediction is that is scored [s]
TIME = 32  # of the newest sample [s], NaN before the first
TOUCHED = 33  # 1 from the first contact on
UPDATES = 34  # samples learnt from since the last reset
BEGUN = 35  # how many they were when the map began
CHANGES = 36  # sudden changes since the last reset
NOTES = 37

RING = 128
"""Snapshots of the map that are kept to be scored on what came later."""

# --- the array: where each part begins -------------------------------------------------------------------------------

BEGIN_FLAT = 0  # the map, as it crosses the network
BEGIN_MEMORY = BEGIN_FLAT + SIZE  # what the material remembers
BEGIN_NOTES = BEGIN_MEMORY + MEMORY
BEGIN_RATES = BEGIN_NOTES + NOTES  # scratch: how far the averages go in one sample
BEGIN_VALUES = BEGIN_RATES + MEMORY  # scratch: the features, then what each expert says
BEGIN_LAW = BEGIN_VALUES + LARGEST_FEATURES + 3  # the exact estimator
BEGIN_SETTINGS = BEGIN_LAW + STATE_SIZE  # of that
BEGIN_TIMES = BEGIN_SETTINGS + len(SETTINGS)  # of the snapshots, together: they are walked
BEGIN_RING = BEGIN_TIMES + RING  # rows of SIZE + 1: a map and its time in contact
BEGIN_COARSE = BEGIN_RING + RING * (SIZE + 1)
BEGIN_FINE = BEGIN_COARSE + regression_size(0)
TOTAL = BEGIN_FINE + regression_size(1)
