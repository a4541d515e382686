"""The delayed force without Python: the compiled step does what the step of a session's baseline does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lap import MS, Lap

from foretouch.messages import Telemetry
from foretouch.session.steps import baseline, leader, leading
from foretouch.session.steps.delaying import Delaying, tick_delayed

FIELDS = ("rendered_force", "position", "velocity", "mediated_force", "energy")


class Twin(Lap):
    """A session whose leader renders the delayed force, beside one without Python."""

    def start_leader(self, name: str, epoch: int) -> Any:
        one = super().start_leader(name, epoch)
        one.state = baseline.start(replace(self.settings, baseline="delayed"), holder=name, epoch=epoch)
        twin = leader.start(self.settings, holder=name, epoch=epoch).records.copy()
        motions = Delaying.new()

        def watched(now_ns: int) -> leader.Outputs:
            arrived = one.returned.pop_due(now_ns)
            one.begun = one.begun if one.begun >= 0 else now_ns
            inputs = leader.Inputs(one.hand.read(now_ns - one.begun), arrived, MS, 0)
            one.state, outputs = leader.step(one.state, inputs, now_ns)
            one.hand.render(outputs.record.rendered_force)
            for m in arrived:
                if isinstance(m, Telemetry):
                    said = m.run, m.sequence, m.epoch, m.status, m.position, m.desired_position, m.force, m.in_contact
                    leading.hear.entry(twin[0], *said)
            tick_delayed.entry(twin[0], motions[0], now_ns, inputs.position, MS, False, False)
            for field in FIELDS:
                known = np.float64(getattr(outputs.record, field))
                assert np.float64(twin["shown"][0][field]).tobytes() == known.tobytes(), field
            one.records.append(outputs.record)
            return outputs

        one.step = watched  # type: ignore[method-assign]
        return one


@pytest.mark.parametrize("material", ["hunt-crossley", "foam"])
@pytest.mark.first
def test_the_delayed_force_without_python_gives_the_same_bits(material: str) -> None:
    lap = Twin.led(3.0, material=material, grip="normal", force_delay=0.15, position_delay=0.15)
    assert max(record.rendered_force for record in lap.leaders[0].records) > 0.2
