"""foretouch: feel what the remote robot touches before the network can tell you.

The public interface; what is not here may change without notice. Names are imported when they are first used, so that
`import foretouch` costs nothing.

- Recordings: `Recording`, `read_recording`, `read_with_notes`, `read_session`, `excerpt`, `fetch`
- Contact models: `ContactModel`, `advance`, `make_model`
- In a loop of your own: `Predictor`, `Renderer`, and `warm_up` before it
- Identification: `make_estimator`, `Learner`, `identify`, `predict`
- Scoring: `score`, `delayed`; `compare`, `file_case`
- Sessions: `SessionSettings`, `simulate`, `make_robot`, `make_operator`, `session_report`, `SessionLog`
- Errors: `ForetouchError`
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from foretouch.comparison import compare, file_case
    from foretouch.errors import ForetouchError
    from foretouch.identification import Learner, identify, make_estimator, predict
    from foretouch.messages import SessionLog
    from foretouch.models import ContactModel, Predictor, advance, make_model
    from foretouch.quantities import Recording
    from foretouch.recordings import excerpt, fetch, read_recording, read_session, read_with_notes
    from foretouch.rendering import Renderer
    from foretouch.report import delayed, score, session_report
    from foretouch.robot import make_robot
    from foretouch.session import SessionSettings, make_operator, simulate, warm_up

__version__ = "0.1.0"

_HOME = {
    "ForetouchError": "errors",
    "compare": "comparison",
    "file_case": "comparison",
    "Recording": "quantities",
    "read_recording": "recordings",
    "read_session": "recordings",
    "read_with_notes": "recordings",
    "excerpt": "recordings",
    "fetch": "recordings",
    "ContactModel": "models",
    "advance": "models",
    "make_model": "models",
    "Predictor": "models",
    "Renderer": "rendering",
    "make_estimator": "identification",
    "Learner": "identification",
    "identify": "identification",
    "predict": "identification",
    "score": "report",
    "delayed": "report",
    "session_report": "report",
    "SessionLog": "messages",
    "SessionSettings": "session",
    "simulate": "session",
    "warm_up": "session",
    "make_operator": "session",
    "make_robot": "robot",
}

__all__ = [
    "ContactModel",
    "ForetouchError",
    "Learner",
    "Predictor",
    "Recording",
    "Renderer",
    "SessionLog",
    "SessionSettings",
    "__version__",
    "advance",
    "compare",
    "delayed",
    "excerpt",
    "fetch",
    "file_case",
    "identify",
    "make_estimator",
    "make_model",
    "make_operator",
    "make_robot",
    "predict",
    "read_recording",
    "read_session",
    "read_with_notes",
    "score",
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
