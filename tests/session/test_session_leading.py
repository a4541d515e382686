"""A leader without Python: the compiled step along a line does what the step of a session does, to the last bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from commanded import SCENES  # noqa: F401  # the folder's helpers are found
from hypothesis import given
from hypothesis import strategies as st
from lap import MS, Lap

from foretouch.errors import InputError
from foretouch.identification.registry import default_estimator
from foretouch.messages import LeaderState, Message, ModelUpdate, Telemetry
from foretouch.models import LAWS, law_kernel, make_model
from foretouch.session.steps import leader, leading


class WithoutPython:
    """A leader that is driven by compiled code alone, from the same initial record."""

    def __init__(self, state: leader.State) -> None:
        self.records = state.records.copy()

    def take(self, message: Message) -> None:
        record = self.records[0]
        if isinstance(message, Telemetry):
            m = message
            leading.hear.entry(
                record, m.run, m.sequence, m.epoch, m.status, m.position, m.desired_position, m.force, m.in_contact
            )
        elif isinstance(message, ModelUpdate):
            received = self.records["received"][0]
            for name in ("run", "sequence", "epoch", "command_sequence", "surface", "valid"):
                received[name] = getattr(message, name)
            names, numbers = law_kernel.LAW_NAMES, np.frombuffer(message.map, "<f4")
            received["law"] = names.index(message.law) if message.law in names else -1
            for name, values in (("parameters", message.parameters), ("state", message.state)):
                received[name][: len(values)] = values[: received[name].size]
                received[f"{name.rstrip('s')}_count"] = len(values)
            received["map"][: numbers.size], received["map_count"] = numbers, numbers.size
            leading.adopt.entry(record)

    def tick(self, inputs: leader.Inputs, now_ns: int) -> None:
        leading.tick.entry(self.records[0], now_ns, inputs.position, inputs.period_ns, inputs.clutched, inputs.stopping)


class Twin(Lap):
    """A session whose leader has a twin without Python, which is compared with it in every tick."""

    def start_leader(self, name: str, epoch: int) -> Any:
        one = super().start_leader(name, epoch)
        twin, step = WithoutPython(one.state), leader.step

        def watched(now_ns: int) -> leader.Outputs:
            arrived = one.returned.pop_due(now_ns)
            begun = one.begun if one.begun >= 0 else now_ns
            one.begun = begun
            clutched = (now_ns // MS) % 900 > 840
            inputs = leader.Inputs(one.hand.read(now_ns - begun), arrived, MS, 0, clutched, stopping=one.stopping)
            one.state, outputs = step(one.state, inputs, now_ns)
            one.hand.render(outputs.record.rendered_force)
            for message in arrived:
                twin.take(message)
            twin.tick(inputs, now_ns)
            compare(twin.records, one.state, outputs)
            one.records.append(outputs.record)
            return outputs

        one.step = watched  # type: ignore[method-assign]
        return one


FIELDS = ("rendered_force", "position", "velocity", "predicted_force", "mediated_force", "energy", "rendered_share")


def compare(records: np.ndarray, state: leader.State, outputs: leader.Outputs) -> None:
    shown, record = records["shown"][0], outputs.record
    assert isinstance(record, LeaderState)
    for name in FIELDS:
        assert np.float64(shown[name]).tobytes() == np.float64(getattr(record, name)).tobytes(), name
    assert bool(shown["engaged"]) == record.engaged
    assert records["sequence"][0] == outputs.command.sequence
    assert records["predictions"]["message"][0, 0] == outputs.command.acknowledged_model
    assert records["views"]["run"][0, 0] == outputs.command.run


@pytest.mark.parametrize("material", ["hunt-crossley", "foam"])
@pytest.mark.parametrize("grip", ["none", "normal"])
@pytest.mark.first
def test_a_leader_without_python_gives_the_same_bits(material: str, grip: str) -> None:
    lap = Twin.led(4.0, material=material, grip=grip)
    assert max(abs(record.rendered_force) for record in lap.leaders[0].records) > 0.2


@pytest.mark.long
def test_also_where_the_follower_is_another_and_where_the_emergency_stop_is_pressed() -> None:
    lap = Twin.led(2.5, grip="normal")
    lap.start_follower(2, robot=True)
    lap.run(1.5)
    lap.stop = "somebody pressed it"
    lap.leaders[0].stopping = True
    lap.run(0.5)
    lap.leaders[0].stopping, lap.release = False, True
    lap.run(1.0)
    assert lap.leaders[0].state.follower_view.run == 2


@pytest.mark.parametrize("model", ["kelvin-voigt", "threshold-switching", "continuous-switching"])
@pytest.mark.first
def test_also_with_a_law_of_the_paper(model: str) -> None:
    lap = Twin.led(3.0, model=model, estimator=default_estimator(model))
    assert max(record.rendered_force for record in lap.leaders[0].records) > 0.2


NUMBER = st.one_of(
    st.floats(1e-3, 1e4), st.sampled_from([0.0, -0.0, -1.0, 1e15, 1.1e15, math.inf, -math.inf, math.nan])
)


@given(st.sampled_from(sorted(set(LAWS) - {"contact-map"})), st.lists(NUMBER, min_size=2, max_size=6))
def test_compiled_code_takes_the_parameters_that_python_takes(law: str, parameters: list[float]) -> None:
    six = (*parameters, *(7.0,) * law_kernel.PARAMETERS)[: law_kernel.PARAMETERS]
    good, *form = law_kernel.form_of_wire.entry(law_kernel.LAW_NAMES.index(law), six, len(parameters))
    try:
        model = make_model(law, parameters)
    except InputError:
        assert not good
        return
    assert good
    assert tuple(form) == law_kernel.form_of(model)[:2]
