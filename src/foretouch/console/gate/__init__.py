"""The console's gate: admission to its page, and messages that a page may send. Viewer internals are used only here."""

from foretouch.console.gate.entrance import Entrance
from foretouch.console.gate.serving import make_gated_server

__all__ = ["Entrance", "make_gated_server"]
