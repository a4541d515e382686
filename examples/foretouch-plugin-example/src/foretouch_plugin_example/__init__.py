"""A device and an estimator for foretouch."""
