"""Models over a thin link: when one can be felt, and in how few bytes."""
