"""Room `report`."""

from foretouch.report.scores import STATUSES, Scores, delayed, lowest_mean, score

__all__ = ["STATUSES", "Scores", "delayed", "lowest_mean", "score"]
