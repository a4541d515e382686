"""The console's gate: who may open its page, and what a page may say. All that knows the viewer's insides is here."""

from foretouch.console.gate.entrance import Entrance
from foretouch.console.gate.serving import make_gated_server

__all__ = ["Entrance", "make_gated_server"]
