"""foretouch: feel what the remote robot touches before the network can tell you.

The public interface; what is not here may change without notice. Names are imported when they are first used, so that
`import foretouch` costs nothing.

- Recordings: `Recording`, `read_recording`, `read_with_notes`, `read_session`, `excerpt`, `fetch_dataset`
- Contact laws: `ContactModel`, `advance`; `KelvinVoigt`, `HuntCrossley`, `ThresholdSwitching`, `ContinuousSwitching`,
  `ContactMapModel`
- Estimators: `Estimator`, `ContactSample`, `ContactSamples`; `ContactMap`, the default; `FPRLS`, `FPRLSOptions`,
  `RobustFPRLS`, `KelvinVoigtRLS`, `HuntCrossleyLogRLS`, `ExactContinuousSwitching`, `ExactHuntCrossley`,
  `ExactKelvinVoigt`
- In a loop of your own: `Learner`, `Predictor`, `Renderer`, and `warm_up` before it
- Of a recording: `identify`, `predict`, `delayed_force`, `score_prediction`; `compare` of many
- Sessions: `SessionSettings`, `Frame`, `SpatialFrame`, `SensorFault`, `ImageFault`, `simulate`, `make_robot`,
  `make_operator`, `SessionLog`, `session_report`, `SessionReport`
- Errors: `ForetouchError`
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from foretouch.comparison import compare
    from foretouch.errors import ForetouchError
    from foretouch.identification import (
        FPRLS,
        ContactMap,
        ContactSample,
        ContactSamples,
        Estimator,
        ExactContinuousSwitching,
        ExactHuntCrossley,
        ExactKelvinVoigt,
        FPRLSOptions,
        HuntCrossleyLogRLS,
        KelvinVoigtRLS,
        Learner,
        RobustFPRLS,
        identify,
        predict,
    )
    from foretouch.messages import SessionLog
    from foretouch.models import (
        ContactMapModel,
        ContactModel,
        ContinuousSwitching,
        HuntCrossley,
        KelvinVoigt,
        Predictor,
        ThresholdSwitching,
        advance,
    )
    from foretouch.quantities import Frame, Recording, SpatialFrame
    from foretouch.recordings import excerpt, fetch_dataset, read_recording, read_session, read_with_notes
    from foretouch.rendering import Renderer
    from foretouch.report import SessionReport, delayed_force, score_prediction, session_report
    from foretouch.robot import SensorFault, make_robot
    from foretouch.session import SessionSettings, make_operator, simulate, warm_up
    from foretouch.vision import ImageFault

__version__ = "0.1.0"

_ROOMS = {
    "comparison": "compare",
    "errors": "ForetouchError",
    "identification": "FPRLS ContactMap ContactSample ContactSamples Estimator ExactContinuousSwitching "
    "ExactHuntCrossley ExactKelvinVoigt FPRLSOptions HuntCrossleyLogRLS KelvinVoigtRLS Learner RobustFPRLS "
    "identify predict",
    "messages": "SessionLog",
    "models": "ContactMapModel ContactModel ContinuousSwitching HuntCrossley KelvinVoigt Predictor "
    "ThresholdSwitching advance",
    "quantities": "Frame Recording SpatialFrame",
    "recordings": "excerpt fetch_dataset read_recording read_session read_with_notes",
    "rendering": "Renderer",
    "report": "SessionReport delayed_force score_prediction session_report",
    "robot": "SensorFault make_robot",
    "session": "SessionSettings make_operator simulate warm_up",
    "vision": "ImageFault",
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names.split()}

__all__ = [
    "FPRLS",
    "ContactMap",
    "ContactMapModel",
    "ContactModel",
    "ContactSample",
    "ContactSamples",
    "ContinuousSwitching",
    "Estimator",
    "ExactContinuousSwitching",
    "ExactHuntCrossley",
    "ExactKelvinVoigt",
    "FPRLSOptions",
    "ForetouchError",
    "Frame",
    "HuntCrossley",
    "HuntCrossleyLogRLS",
    "ImageFault",
    "KelvinVoigt",
    "KelvinVoigtRLS",
    "Learner",
    "Predictor",
    "Recording",
    "Renderer",
    "RobustFPRLS",
    "SensorFault",
    "SessionLog",
    "SessionReport",
    "SessionSettings",
    "SpatialFrame",
    "ThresholdSwitching",
    "__version__",
    "advance",
    "compare",
    "delayed_force",
    "excerpt",
    "fetch_dataset",
    "identify",
    "make_operator",
    "make_robot",
    "predict",
    "read_recording",
    "read_session",
    "read_with_notes",
    "score_prediction",
    "session_report",
    "simulate",
    "warm_up",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'foretouch' has no attribute {name!r}")
    return getattr(importlib.import_module(f"foretouch.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
