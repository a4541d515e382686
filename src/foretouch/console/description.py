"""What the newest model is, in a few lines."""

from __future__ import annotations

from foretouch.errors import InputError
from foretouch.messages import ModelUpdate
from foretouch.models import ContactMap, make_model, summarise_map
from foretouch.quantities import measured

__all__ = ["describe"]

SYMBOLS = {"stiffness": "k", "damping": "λ", "exponent": "n", "switching": "α"}


def describe(update: ModelUpdate) -> tuple[str, ...]:
    """The law's numbers, a contact map's shares, what was visited and how stiff it is, and what there is to know.

    Args:
        update: As it came; one that cannot be run is described by its reason alone.
    """
    reason = (update.reason,) if update.reason else ()
    if not update.valid:
        return reason
    try:
        model = make_model(update.law, update.parameters, update.map)
    except InputError:
        return reason
    named = zip(model.parameter_names, model.parameters, strict=True)
    numbers = "law: " + ", ".join(f"{SYMBOLS.get(name, name)} {measured(value, None)}" for name, value in named)
    return (numbers, *(_map_lines(model) if isinstance(model, ContactMap) else ()), *reason)


def _map_lines(model: ContactMap) -> tuple[str, ...]:
    summary = summarise_map(model)
    shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in summary.shares.items())
    lines = [f"map: {shares}; visited {1e3 * summary.depth_visited:.1f} mm, {1e3 * summary.speed_visited:.0f} mm/s"]
    if summary.depths:
        values = ", ".join(f"{value:.0f}" for value in summary.stiffnesses)
        lines.append(f"stiffness: {values} N/m at {', '.join(f'{1e3 * depth:.1f}' for depth in summary.depths)} mm")
    return tuple(lines)
