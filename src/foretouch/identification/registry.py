"""Which laws can be identified, and by which estimators."""

from __future__ import annotations

from foretouch.errors import SettingError, UnknownNameError
from foretouch.errors.checks import require_type
from foretouch.identification.classic.least_squares import HuntCrossleyLogRLS, HuntCrossleyTwoStage, KelvinVoigtRLS
from foretouch.identification.classic.steepest_descent import (
    SteepestDescent,
    SteepestDescentHuntCrossley,
    SteepestDescentKelvinVoigt,
)
from foretouch.identification.classic.threshold_switching import ThresholdSwitching
from foretouch.identification.contact_map.bank import ContactMap
from foretouch.identification.estimator import Estimator
from foretouch.identification.exact.recursive import ExactContinuousSwitching, ExactHuntCrossley, ExactKelvinVoigt
from foretouch.identification.linear.estimators import FPRLS, RLS, ForgettingRLS, RobustFPRLS, SelfPerturbingRLS
from foretouch.identification.offline import OfflineContinuousSwitching, OfflineHuntCrossley, OfflineKelvinVoigt
from foretouch.identification.offline_contact_map import OfflineContactMap
from foretouch.plugins import PluginError, load_plugin, make_plugin, plugin_names

ESTIMATORS: dict[str, dict[str, type[Estimator]]] = {}
"""Estimators by name of the law, then by their own name."""

_KINDS: tuple[type[Estimator], ...] = (
    RLS,
    ForgettingRLS,
    SelfPerturbingRLS,
    FPRLS,
    RobustFPRLS,
    KelvinVoigtRLS,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    ThresholdSwitching,
    SteepestDescent,
    SteepestDescentKelvinVoigt,
    SteepestDescentHuntCrossley,
    OfflineContinuousSwitching,
    OfflineKelvinVoigt,
    OfflineHuntCrossley,
    ExactContinuousSwitching,
    ExactKelvinVoigt,
    ExactHuntCrossley,
    ContactMap,
    OfflineContactMap,
)

for _kind in _KINDS:
    ESTIMATORS.setdefault(_kind.model_name, {})[_kind.name] = _kind


DEFAULT_ESTIMATORS: dict[str, str] = {
    "continuous-switching": "fprls",
    "kelvin-voigt": "rls",
    "hunt-crossley": "log-rls",
    "threshold-switching": "switching",
    "contact-map": "bank",
}
"""Default estimator of each law: the paper's, or the one it compares with."""

BUILT_IN_ESTIMATORS = frozenset(kind.name for kind in _KINDS)
"""Names, whatever the law, that no other package may take."""


def default_estimator(model: str) -> str:
    """The estimator of a law where none is named; of another package's law the first by name.

    Raises:
        UnknownNameError: No such law.
    """
    return DEFAULT_ESTIMATORS.get(model) or min(_estimators_of(model))


def _estimators_of(model: str) -> dict[str, type[Estimator]]:
    known = all_estimators()
    if model not in known:
        raise UnknownNameError("model", model, known)
    return known[model]


def make_estimator(model: str, estimator: str = "") -> Estimator:
    """A fresh estimator with its defaults, of this package or of another; one with options is made of its class.

    Args:
        model: Name of the law.
        estimator: Name of the estimator, one of those that `ESTIMATORS` has for this law; empty for the law's own
            (`DEFAULT_ESTIMATORS`).

    Raises:
        UnknownNameError: No such law, or no such estimator for it: the line lists those that there are.
        SettingError: Another package's, which learns another law.
        PluginError: Another package's, which cannot be made.
        ArgumentTypeError: A name that is no text.
    """
    require_type("model", model, str, "the name of a law, such as 'contact-map'")
    require_type("estimator", estimator, str, "the name of an estimator; leave it out for the law's own")
    estimator = estimator or default_estimator(model)
    if model in ESTIMATORS and estimator in ESTIMATORS[model]:
        return ESTIMATORS[model][estimator]()
    other = None if estimator in BUILT_IN_ESTIMATORS else load_estimator(estimator)
    if other is None:
        raise UnknownNameError(f"estimator for {model}", estimator, _estimators_of(model))
    if other.model_name != model:
        rule = f"learns the law {other.model_name} and not {model}: give --model {other.model_name} with it"
        raise SettingError("estimator", estimator, rule)
    made = make_plugin("estimator", estimator, Estimator)
    assert made is not None  # it was there a moment ago
    return made


def load_estimator(name: str) -> type[Estimator] | None:
    """The class that another package brings under this name; None where none does.

    Raises:
        PluginError: It cannot be imported, or is no estimator that says this name and its law.
    """
    loaded = load_plugin("estimator", name, built_in=BUILT_IN_ESTIMATORS)
    if loaded is None:
        return None
    plugin, kind = loaded
    if not (isinstance(kind, type) and issubclass(kind, Estimator)):
        raise PluginError(plugin, "is no class that derives from foretouch.identification.Estimator")
    own, law = getattr(kind, "name", None), getattr(kind, "model_name", None)
    if own != name:
        raise PluginError(plugin, f"has name = {own!r}: the same as the entry point's is needed")
    if not isinstance(law, str) or not law:
        raise PluginError(plugin, f"has model_name = {law!r}: the name of its law is needed")
    return kind


def all_estimators() -> dict[str, dict[str, type[Estimator]]]:
    """`ESTIMATORS`, with those that other packages bring and that can be used; the others are left out."""
    known = {model: dict(kinds) for model, kinds in ESTIMATORS.items()}
    for name in plugin_names("estimator"):
        try:
            kind = load_estimator(name)
        except PluginError:
            continue  # `foretouch plugins` says why
        if kind is not None:
            known.setdefault(kind.model_name, {})[name] = kind
    return known
