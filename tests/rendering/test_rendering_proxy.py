"""The proxy: coupled, let go, indexed, yielding, and brought back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.rendering import Proxy

places = st.floats(-0.1, 0.1)
scales = st.floats(0.05, 20.0)


@given(scales, places, places, st.lists(places, max_size=20))
def test_coupling_moves_nothing_and_afterwards_the_scale_holds(scale, hand, position, hands):
    proxy = Proxy(scale)
    assert math.isnan(proxy.follow(hand))
    proxy.engage(hand, position)
    assert proxy.position == pytest.approx(position, abs=1e-12)
    for there in hands:
        assert proxy.follow(there) == pytest.approx(position + scale * (there - hand), abs=1e-12)
    assert proxy.apart == 0.0


@given(scales, places, places, places)
def test_while_let_go_the_hand_moves_alone(scale, hand, position, there):
    proxy = Proxy(scale)
    proxy.engage(hand, position)
    proxy.release()
    assert not proxy.engaged
    assert proxy.follow(there) == proxy.position == pytest.approx(position, abs=1e-12)
    proxy.engage(there, proxy.position)
    assert proxy.position == pytest.approx(position, abs=1e-12)
    assert proxy.follow(there + 0.01) == pytest.approx(position + 0.01 * scale, abs=1e-12)


def test_without_a_place_the_scale_alone_puts_it():
    proxy = Proxy(0.5)
    proxy.engage(0.02)
    assert proxy.position == 0.01


@given(scales, st.floats(0.0, 1.0), st.floats(0.0, 0.05))
def test_what_yielded_comes_back_on_the_leaving_work_of(scale, share, way):
    """With one share, in and out are the same way."""
    proxy = Proxy(scale)
    proxy.engage(0.0, 0.0)
    inwards = [proxy.follow(way * number / 8, share) for number in range(9)]
    assert inwards[-1] == pytest.approx(share * scale * way, abs=1e-12)
    assert proxy.yielded == pytest.approx((1.0 - share) * scale * way, abs=1e-12)
    outwards = [proxy.follow(way * number / 8, share) for number in range(8, -1, -1)]
    assert outwards[::-1] == pytest.approx(inwards, abs=1e-12)
    assert proxy.yielded == pytest.approx(0.0, abs=1e-12)


@given(st.lists(st.tuples(places, st.floats(0.0, 1.0)), max_size=30))
def test_the_proxy_never_leaves_later_than_the_hand(motion):
    """Whatever the shares, it is never further in than the hand would have it, and no further moved than the hand."""
    proxy = Proxy(1.0)
    proxy.engage(0.0, 0.0)
    hand = before = 0.0
    for there, share in motion:
        place = proxy.follow(there, share)
        assert proxy.yielded >= 0.0
        assert place <= there + 1e-12
        assert abs(place - before) <= abs(there - hand) + 1e-12
        assert (place - before) * (there - hand) >= -1e-12
        hand, before = there, place


def test_indexed_is_given_back_first_and_what_yielded_only_when_asked():
    proxy = Proxy(2.0)
    proxy.engage(0.0, 0.0)
    proxy.follow(0.01, 0.25)
    proxy.index(0.004)
    assert (proxy.position, proxy.yielded, proxy.indexed) == pytest.approx((0.001, 0.015, 0.004))
    assert proxy.apart == pytest.approx(0.019)
    proxy.give_back(0.003, yielded=False)
    assert (proxy.position, proxy.indexed) == pytest.approx((0.004, 0.001))
    proxy.give_back(0.003, yielded=False)
    assert (proxy.position, proxy.indexed, proxy.yielded) == pytest.approx((0.005, 0.0, 0.015))
    proxy.index(0.001)
    proxy.give_back(0.003, yielded=True)
    assert (proxy.position, proxy.indexed, proxy.yielded) == pytest.approx((0.007, 0.0, 0.013))
    proxy.give_back(1.0, yielded=True)
    assert (proxy.position, proxy.apart) == (0.02, 0.0)


def test_a_new_coupling_forgets_what_was_apart():
    proxy = Proxy()
    proxy.engage(0.0, 0.0)
    proxy.index(0.004)
    proxy.follow(0.01, 0.5)
    place = proxy.position
    proxy.release()
    proxy.engage(0.03, place)
    assert proxy.apart == 0.0
    assert proxy.position == pytest.approx(place)


@pytest.mark.parametrize("hand", [math.nan, math.inf])
def test_a_hand_that_is_nowhere_moves_nothing(hand):
    proxy = Proxy()
    proxy.engage(0.0, 0.002)
    proxy.follow(0.001)
    assert proxy.follow(hand, 0.5) == pytest.approx(0.003)
    assert proxy.follow(0.002) == pytest.approx(0.004)


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, math.inf])
def test_a_scale_must_be_positive(scale):
    with pytest.raises(SettingError, match="position_scale"):
        Proxy(scale)
