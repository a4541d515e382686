"""The bound on the time of a sample: its formula, and that latencies of a machine are measured."""

from __future__ import annotations

import pytest
from numba import config

from foretouch.bench.peers import CHAINS, LINKS, Latencies, measure_latencies


def test_the_bound_counts_the_operations_of_the_chain() -> None:
    latencies = Latencies(sum=1.0, product=10.0, fma=100.0, divide=1000.0)
    assert latencies.fused_bound == 2 + 30 + 300 + 1000
    assert latencies.unfused_bound == 5 + 40 + 1000


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="interpreted, there are no latencies to measure")
def test_latencies_are_those_of_operations_that_wait_for_each_other() -> None:
    """None was left out by the compiler: a divide takes longer than a sum on every processor."""
    result = measure_latencies(rounds=5)
    assert 0.05 < result.sum < result.divide < 1000.0
    assert 0.05 < result.product < result.divide
    assert 0.05 < result.fma < result.divide


def test_the_chains_compute_what_they_time() -> None:
    sums, products, fmas, divides = (chain(2.0, 3.0, 5) for chain in CHAINS)
    assert (sums, products, divides) == (17.0, 486.0, 1.5)
    assert fmas == pytest.approx(486.0)
    assert LINKS > 10_000
