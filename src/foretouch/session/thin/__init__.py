"""A thin link between leader and follower: only what can be felt crosses it, within a budget of bytes a second."""

from foretouch.session.thin.ends import FollowerEnd, LeaderEnd, end_of

__all__ = ["FollowerEnd", "LeaderEnd", "end_of"]
